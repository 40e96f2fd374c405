// The table of all points: sorted by its heads, filtered by an expression.

const PAGE = 25;

class PointTable {
  constructor(box) {
    this.points = Points.of(box.getAttribute("data-of"));
    this.all = [...Array(this.points.count).keys()].filter((row) => this.points.named(row, "status") !== "skipped");
    Object.assign(this, { rows: this.all, size: PAGE, order: null, problem: "" });
    this.build(box);
    this.fill();
  }

  build(box) {
    this.input = element("input", { type: "search", spellcheck: "false", autocomplete: "off" });
    this.input.addEventListener("input", () => this.choose());
    const example = `status == "done"${this.points.place.has("mu") ? " and mu > 0.2" : ""}`;
    this.message = element("p", { role: "status" });
    this.heads = this.points.columns.map((column, k) => {
      const button = element("button", { type: "button" }, column.name + (column.units && ` (${column.units})`));
      button.addEventListener("click", () => this.sort(k));
      const look = column.kind === "number" ? "" : "text";
      return element("th", { scope: "col", "aria-sort": "none", title: column.about, class: look }, button);
    });
    this.body = element("tbody");
    const caption = element("caption", { class: "hidden" }, "All points");
    const table = element("table", {}, caption, element("thead", {}, element("tr", {}, ...this.heads)), this.body);
    this.more = element("button", { type: "button" });
    this.more.addEventListener("click", () => { this.size += 4 * PAGE; this.fill(); });
    box.append(
      element("label", {}, `Filter, for example: ${example}`, this.input),
      this.message,
      element("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of points" }, table),
      this.more,
    );
  }

  // The rows that the expression chooses; all of them where it is none.
  choose() {
    Object.assign(this, { rows: this.all, size: PAGE, problem: "" });
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
    this.fill();
  }

  sort(column) {
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
    // What has no value comes last, whichever way; equals stay in the order of the grid.
    return [...this.rows].sort((a, b) => {
      const [left, right] = [this.points.value(a, column), this.points.value(b, column)];
      if (left === null || right === null) return (left === null) - (right === null) || a - b;
      return (down ? -1 : 1) * ((left > right) - (left < right)) || a - b;
    });
  }

  fill() {
    const rows = this.inOrder().slice(0, this.size);
    this.body.replaceChildren(...rows.map((row) => this.line(row)));
    const left = this.rows.length - rows.length;
    this.message.textContent = `${this.problem}${this.rows.length} of ${this.all.length} points; ${rows.length} shown.`;
    this.more.hidden = left === 0;
    this.more.textContent = `Show ${Math.min(left, 4 * PAGE)} more`;
  }

  line(row) {
    return element("tr", {}, ...this.points.columns.map((column, k) => {
      const value = this.points.value(row, k);
      const bad = value === "failed" || column.name === "error" ? " bad" : "";
      const look = { class: (column.kind === "number" ? "" : "text") + bad };
      return k ? element("td", look, shown(value)) : element("th", { scope: "row", ...look }, shown(value));
    }));
  }
}

// A table is made when it is first looked at.
for (const box of document.querySelectorAll(".points")) {
  box.closest("details").addEventListener("toggle", () => new PointTable(box), { once: true });
}
