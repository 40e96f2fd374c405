// The table of all points: sorted by its heads, filtered by an expression.

const PAGE = 25;

class PointTable {
  constructor(box) {
    this.points = Points.of(box.getAttribute("data-of"));
    this.all = [...Array(this.points.count).keys()].filter((row) => this.points.named(row, "status") !== "skipped");
    Object.assign(this, { rows: this.all, size: PAGE, order: null, problem: "", where: "", used: new Set() });
    this.chosen = new Set(this.points.columns.keys());
    this.line = box.getAttribute("data-command");
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
    this.asked = element("div", { class: "command" });
    this.note = element("p", { class: "hint" });
    this.save = element("button", { type: "button" });
    this.save.addEventListener("click", () => this.download(box.getAttribute("data-name")));
    const caption = element("caption", { class: "hidden" }, "All points");
    const table = element("table", {}, caption, element("thead", {}, element("tr", {}, ...this.heads)), this.body);
    this.more = element("button", { type: "button" });
    this.more.addEventListener("click", () => { this.size += 4 * PAGE; this.fill(); });
    box.append(
      element("label", {}, `Filter, for example: ${example}`, this.input),
      this.message,
      this.chooser(),
      element("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of points" }, table),
      this.more,
      this.save,
      element("p", {}, "The same from the file, in full: "),
      this.asked,
      this.note,
    );
  }

  // A box for each column, and two that tick all or none.
  chooser() {
    const boxes = this.points.columns.map((column, k) => {
      const tick = element("input", { type: "checkbox" });
      tick.checked = true;
      tick.addEventListener("change", () => { this.chosen[tick.checked ? "add" : "delete"](k); this.fill(); });
      return [tick, element("label", {}, tick, column.name)];
    });
    const whole = (name, checked) => {
      const button = element("button", { type: "button" }, name);
      button.addEventListener("click", () => {
        for (const [tick] of boxes) tick.checked = checked;
        this.chosen = new Set(checked ? boxes.keys() : []);
        this.fill();
      });
      return button;
    };
    const all = element("div", { class: "ticks" }, whole("All", true), whole("None", false), ...boxes.map(([, label]) => label));
    return element("details", { class: "chooser" }, element("summary", {}, "Columns"), all);
  }

  get shownColumns() {
    return [...this.points.columns.entries()].filter(([k]) => this.chosen.has(k));
  }

  // The command that gives the rows and columns of the table from the file; null where the file has no such column.
  command() {
    const named = this.shownColumns.map(([, column]) => column), { order, points } = this;
    const some = named.length && named.length < points.columns.length ? named : [];
    const sorted = order ? points.columns[order.column] : null;
    const inFile = (column) => column.beside !== true;
    if (![...some, ...[...this.used].map((name) => points.columns[points.place.get(name)])].every(inFile)) return null;
    // Texts may stand in either quotes; these are none of the shell's.
    const where = this.where.includes('"') ? this.where : this.where.replaceAll("'", '"');
    return [
      `${this.line} --where ${quoted(where || 'status == "done"')}`,
      ...(some.length ? [`--show ${some.map((column) => column.name).join(",")}`] : []),
      ...(sorted && inFile(sorted) ? [`--sort ${order.down ? "-" : ""}${sorted.name}`] : []),
      "--format csv",
    ].join(" ");
  }

  // The rows that are chosen, all of them and in their order, as the page has them.
  csv() {
    const cell = (value) => (/[",\r\n]/.test(value) ? `"${value.replaceAll('"', '""')}"` : value);
    const line = (cells) => `${cells.map((value) => cell(value === null ? "" : String(value))).join(",")}\r\n`;
    const columns = this.shownColumns;
    const rows = this.inOrder().map((row) => line(columns.map(([k]) => this.points.value(row, k))));
    return [line(columns.map(([, column]) => column.name)), ...rows].join("");
  }

  download(name) {
    const address = URL.createObjectURL(new Blob([this.csv()], { type: "text/csv" }));
    element("a", { href: address, download: `${name}.csv` }).click();
    setTimeout(() => URL.revokeObjectURL(address), 1000);
  }

  // The rows that the expression chooses; all of them where it is none.
  choose() {
    Object.assign(this, { rows: this.all, size: PAGE, problem: "", where: "", used: new Set() });
    this.input.removeAttribute("aria-invalid");
    try {
      if (this.input.value.trim()) {
        const { test, notes, used } = filter(this.points, this.input.value);
        Object.assign(this, { rows: this.all.filter(test), where: this.input.value.trim(), used });
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
    this.heads.forEach((head, k) => { head.hidden = !this.chosen.has(k); });
    this.body.replaceChildren(...rows.map((row) => this.cells(row)));
    const left = this.rows.length - rows.length;
    this.message.textContent = `${this.problem}${this.rows.length} of ${this.all.length} points; ${rows.length} shown.`;
    this.more.hidden = left === 0;
    this.more.textContent = `Show ${Math.min(left, 4 * PAGE)} more`;
    this.save.textContent = `Save ${this.rows.length} rows as CSV`;
    const asked = this.command();
    this.asked.hidden = asked === null;
    if (asked !== null) command(asked, this.asked);
    this.note.textContent = asked === null ? "No command: a column of this page has no such name in the file." : "";
  }

  cells(row) {
    return element("tr", {}, ...this.shownColumns.map(([k, column], place) => {
      const value = this.points.value(row, k);
      const bad = value === "failed" || column.name === "error" ? " bad" : "";
      const look = { class: (column.kind === "number" ? "" : "text") + bad };
      return place ? element("td", look, shown(value)) : element("th", { scope: "row", ...look }, shown(value));
    }));
  }
}

// A table is made when it is first looked at.
for (const box of document.querySelectorAll(".points")) {
  box.closest("details").addEventListener("toggle", () => new PointTable(box), { once: true });
}
