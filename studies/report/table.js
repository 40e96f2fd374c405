// The table of all points: sorted by its heads, filtered by an expression.

const PAGE = 25;

class PointTable {
  constructor(box) {
    this.points = Points.of(box.getAttribute("data-of"));
    const status = this.points.place.get("status");
    this.all = [];
    for (let row = 0; row < this.points.count; row += 1) {
      if (this.points.value(row, status) !== "skipped") this.all.push(row);
    }
    this.rows = this.all;
    this.size = PAGE;
    this.order = null;
    this.build(box);
    this.fill();
  }

  build(box) {
    const form = element("form");
    const label = element("label", 'Filter, for example: status == "done" and mu > 0.2');
    if (!this.points.place.has("mu")) label.textContent = 'Filter, for example: status == "done"';
    this.input = element("input", null, { type: "search", spellcheck: "false", autocomplete: "off" });
    label.append(this.input);
    form.append(label);
    form.addEventListener("submit", (event) => event.preventDefault());
    this.input.addEventListener("input", () => this.filtered());
    this.message = element("p", null, { role: "status" });
    const table = element("table");
    table.append(element("caption", "All points", { class: "hidden" }));
    const heads = element("tr");
    this.heads = this.points.columns.map((column, k) => {
      const head = element("th", null, { scope: "col", "aria-sort": "none", title: column.about || "" });
      if (typeof this.points.value(0, k) === "string") head.classList.add("text");
      const button = element("button", headed(column), { type: "button" });
      button.addEventListener("click", () => this.sorted(k));
      head.append(button);
      heads.append(head);
      return head;
    });
    const head = element("thead");
    head.append(heads);
    this.body = element("tbody");
    table.append(head, this.body);
    const scroll = element("div", null, { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of points" });
    scroll.append(table);
    this.more = element("button", "", { type: "button" });
    this.more.addEventListener("click", () => { this.size += 4 * PAGE; this.fill(); });
    box.append(form, this.message, scroll, this.more);
  }

  filtered() {
    this.problem = "";
    this.rows = this.all;
    this.input.removeAttribute("aria-invalid");
    try {
      if (this.input.value.trim()) {
        const { test, notes } = filter(this.points, this.input.value);
        this.rows = this.all.filter(test);
        this.problem = notes.map((note) => `${note}. `).join("");
      }
    } catch (error) {
      this.input.setAttribute("aria-invalid", "true");
      this.problem = `${error.message}; all are shown. `;
    }
    this.size = PAGE;
    this.fill();
  }

  sorted(column) {
    const down = this.order && this.order.column === column && !this.order.down;
    this.order = { column, down };
    this.heads.forEach((head, k) => {
      head.setAttribute("aria-sort", k !== column ? "none" : down ? "descending" : "ascending");
    });
    this.fill();
  }

  inOrder() {
    if (!this.order) return this.rows;
    const { column, down } = this.order;
    const value = (row) => this.points.value(row, column);
    // What has no value comes last, whichever way; equals stay in the order of the grid.
    return [...this.rows].sort((a, b) => {
      const [left, right] = [value(a), value(b)];
      if (left === null || right === null) return (left === null) - (right === null) || a - b;
      const side = left < right ? -1 : left > right ? 1 : 0;
      return (down ? -side : side) || a - b;
    });
  }

  fill() {
    const rows = this.inOrder().slice(0, this.size);
    this.body.replaceChildren(...rows.map((row) => this.line(row)));
    const left = this.rows.length - rows.length;
    this.message.textContent = `${this.problem || ""}${this.rows.length} of ${this.all.length} points; ${rows.length} shown.`;
    this.more.hidden = left === 0;
    this.more.textContent = `Show ${Math.min(left, 4 * PAGE)} more`;
  }

  line(row) {
    const line = element("tr");
    this.points.columns.forEach((column, k) => {
      const value = this.points.value(row, k);
      const cell = element(k === 0 ? "th" : "td", shown(value), k === 0 ? { scope: "row" } : {});
      if (typeof value === "string") cell.classList.add("text");
      if (value === "failed" || column.name === "error") cell.classList.add("bad");
      line.append(cell);
    });
    return line;
  }
}

for (const details of document.querySelectorAll("details")) {
  const box = details.querySelector(".points");
  // A table is made when it is first looked at.
  const make = () => { if (details.open && !box.firstChild) new PointTable(box); };
  if (box) details.addEventListener("toggle", make);
}
