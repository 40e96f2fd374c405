// A plane of scenes: a cell for each, in the colour of a column; pointing at one shows all of it.

const OTHER = ["#0072b2", "#e69f00", "#009e73", "#d55e00", "#a6dcf7", "#7f7f7f"];
const EDGE = { left: 58, right: 10, top: 10, bottom: 46 };

class PlaneMap {
  constructor(box) {
    this.points = Points.of(box.getAttribute("data-of"));
    this.plane = this.points.plane;
    [this.x, this.y] = [this.plane.x, this.plane.y];
    [this.across, this.up] = [this.points.shape[this.x], this.points.shape[this.y]];
    for (const name of ["canvas", ".legend", ".cell", ".said"]) this[name.replace(".", "")] = box.querySelector(name);
    this.at = this.points.shape.map((size, dim) => (dim === this.x || dim === this.y ? size >> 1 : 0));
    this.column = this.points.place.get(this.plane.first);
    this.choose(box.querySelector(".choose"));
    this.listen();
    this.recolour();
    this.show();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  row(at) {
    return at.reduce((sum, place, dim) => sum + place * this.points.strides[dim], 0);
  }

  // A choice of the column that colours the plane, and of the values of the axes that are not in it.
  choose(box) {
    const add = (text, options, changed) => {
      const select = element("select", {}, ...options.map(([name, value]) => element("option", { value }, name)));
      select.addEventListener("change", () => { changed(Number(select.value)); this.show(); });
      box.append(element("label", {}, text, select));
      return select;
    };
    const columns = [...this.points.columns.entries()].filter(([, column]) => !column.axis && column.name !== "error");
    const recolour = (column) => { this.column = column; this.recolour(); };
    add("Colour", columns.map(([k, column]) => [column.name, k]), recolour).value = String(this.column);
    this.points.axes.forEach((axis, dim) => {
      if (dim === this.x || dim === this.y || axis.values.length < 2) return;
      add(this.name(dim), axis.values.map((_, k) => [this.read(dim, k), k]), (place) => { this.at[dim] = place; });
    });
  }

  name(dim) {
    const axis = this.points.axes[dim];
    return axis.label || axis.name;
  }

  // A value of an axis in the unit of its label.
  read(dim, place) {
    const axis = this.points.axes[dim];
    return String(Number((axis.values[place] * (axis.factor || 1)).toPrecision(4)));
  }

  recolour() {
    const column = this.points.columns[this.column];
    const seen = new Set(Array.from({ length: this.points.count }, (_, row) => this.points.value(row, this.column)));
    this.legend.replaceChildren();
    if (column.words) {
      const words = column.words.filter((word) => seen.has(word));
      const colours = new Map(words.map((word, k) => [word, this.plane.colours[word] || OTHER[k % OTHER.length]]));
      this.colour = (value) => colours.get(value);
      for (const [word, colour] of colours) this.key(colour, word);
    } else {
      this.shade(column, [...seen].filter((value) => typeof value === "number"));
    }
    if (seen.has(null)) this.key("", "no value");
  }

  // Numbers as lightness; of a growth rate only what grows.
  shade(column, numbers) {
    const { shades, stable } = this.plane;
    const grows = column.name === "growth_rate";
    const low = grows ? 0 : numbers.reduce((a, b) => Math.min(a, b), Infinity);
    const high = numbers.reduce((a, b) => Math.max(a, b), -Infinity);
    const span = high - low || 1;
    this.colour = (value) => {
      if (typeof value !== "number") return undefined;
      if (grows && value <= 0) return stable;
      return shades[Math.min(Math.floor(((value - low) / span) * shades.length), shades.length - 1)];
    };
    if (grows) this.key(stable, "stable");
    if (low > high) return;
    const ends = [shown(low), `${shown(high)} ${column.units}`].map((end) => element("b", {}, end));
    this.key(`linear-gradient(to right, ${shades.join(", ")})`, ends[1], "bar").prepend(ends[0]);
  }

  // An entry of the legend.
  key(colour, text, look = "") {
    const swatch = element("i", { class: look });
    swatch.style.background = colour || "transparent";
    const item = element("span", {}, swatch, text);
    this.legend.append(item);
    return item;
  }

  show() {
    this.draw();
    this.tell();
  }

  draw() {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (!width) return;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.box = { width: width - EDGE.left - EDGE.right, height: height - EDGE.top - EDGE.bottom };
    const context = this.canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const [w, h] = [this.box.width / this.across, this.box.height / this.up];
    // Corners of cells are on whole pixels, so that no seam shows.
    const left = (k) => Math.round((EDGE.left + k * w) * ratio) / ratio;
    const top = (k) => Math.round((EDGE.top + (this.up - 1 - k) * h) * ratio) / ratio;
    const at = [...this.at];
    for (at[this.x] = 0; at[this.x] < this.across; at[this.x] += 1) {
      for (at[this.y] = 0; at[this.y] < this.up; at[this.y] += 1) {
        const row = this.row(at);
        const [a, b, c, d] = [left(at[this.x]), top(at[this.y]), left(at[this.x] + 1), top(at[this.y] - 1)];
        context.fillStyle = this.colour(this.points.value(row, this.column)) || "transparent";
        context.fillRect(a, b, c - a, d - b);
        if (this.points.named(row, "status") === "failed") {
          context.strokeStyle = "#7f7f7f";
          context.stroke(new Path2D(`M${a} ${b}L${c} ${d}M${c} ${b}L${a} ${d}`));
        }
      }
    }
    context.strokeStyle = context.fillStyle = getComputedStyle(this.canvas).color;
    context.strokeRect(EDGE.left, EDGE.top, this.box.width, this.box.height);
    this.scales(context, w, h, height);
    for (const [line, colour] of [[4, "#fff"], [2, "#000"]]) {
      [context.lineWidth, context.strokeStyle] = [line, colour];
      context.strokeRect(EDGE.left + this.at[this.x] * w - 2, EDGE.top + (this.up - 1 - this.at[this.y]) * h - 2, w + 4, h + 4);
    }
  }

  scales(context, w, h, height) {
    const bottom = EDGE.top + this.box.height;
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "right";
    for (const [k, text] of this.ticks(this.y, this.box.height / 32)) {
      context.fillText(text, EDGE.left - 6, bottom - (k + 0.5) * h + 4);
    }
    context.textAlign = "center";
    for (const [k, text] of this.ticks(this.x, this.box.width / 64)) {
      context.fillText(text, EDGE.left + (k + 0.5) * w, bottom + 16);
    }
    context.fillText(this.name(this.x), EDGE.left + this.box.width / 2, height - 6);
    context.save();
    context.translate(12, EDGE.top + this.box.height / 2);
    context.rotate(-Math.PI / 2);
    context.fillText(this.name(this.y), 0, 0);
    context.restore();
  }

  // Places along an axis, counted in cells, and their labels: every cell's where there is room, otherwise round values.
  ticks(dim, room) {
    const axis = this.points.axes[dim];
    const values = axis.values.map((value) => value * (axis.factor || 1));
    const cells = values.map((_, k) => [k, this.read(dim, k)]);
    if (cells.length <= room) return cells;
    if (!values.every((value, k) => k === 0 || value > values[k - 1])) {
      return cells.filter((_, k) => k % Math.ceil(cells.length / room) === 0);
    }
    return round(values[0], values.at(-1), room, values[values.length >> 1]).map((value) => {
      const above = Math.max(values.findIndex((one) => one >= value), 1);
      const [low, high] = [values[above - 1], values[above]];
      return [above - 1 + (value - low) / (high - low), String(value)];
    });
  }

  listen() {
    const point = (event) => {
      const place = this.canvas.getBoundingClientRect();
      const across = (event.clientX - place.left - EDGE.left) / this.box.width;
      const up = 1 - (event.clientY - place.top - EDGE.top) / this.box.height;
      if (across < 0 || across >= 1 || up < 0 || up >= 1) return;
      this.move(Math.floor(across * this.across), Math.floor(up * this.up));
    };
    this.canvas.addEventListener("pointerdown", point);
    this.canvas.addEventListener("pointermove", (event) => { if (event.buttons) point(event); });
    this.canvas.addEventListener("keydown", (event) => {
      const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
      if (!steps[event.key]) return;
      event.preventDefault();
      const [dx, dy] = steps[event.key].map((step) => (event.shiftKey ? 10 : 1) * step);
      this.move(this.at[this.x] + dx, this.at[this.y] + dy);
    });
  }

  move(across, up) {
    this.at[this.x] = Math.min(Math.max(across, 0), this.across - 1);
    this.at[this.y] = Math.min(Math.max(up, 0), this.up - 1);
    this.show();
  }

  tell() {
    const [row, points] = [this.row(this.at), this.points];
    const list = (pairs) => element("dl", {}, ...pairs.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]));
    const scene = [...points.axes.map((_, dim) => [this.name(dim), this.read(dim, this.at[dim])]), ...Object.entries(this.plane.held)];
    const values = [...points.columns.entries()]
      .map(([k, column]) => [column, points.value(row, k)])
      .filter(([column, value]) => !column.axis && value !== "" && value !== null)
      .map(([column, value]) => [column.name, `${shown(value)} ${column.units}`.trim()]);
    this.said.textContent = `${scene.flat().join(" ")}; ${points.columns[this.column].name}: ${shown(points.value(row, this.column))}`;
    const more = element("div", { class: "more", tabindex: "0", role: "region", "aria-label": "What was found" }, list(values));
    // With the values of this point in them, with all digits that the page has.
    const lines = Object.entries(this.plane.lines).flatMap(([name, line]) => [
      element("p", {}, name), command(line.replace(/\{(\w+)\}/g, (slot, name) => (points.axes.some((axis) => axis.name === name) ? quoted(String(points.named(row, name))) : slot))),
    ]);
    this.cell.replaceChildren(element("h4", {}, "The scene"), list(scene), element("h4", {}, "What was found"), more, ...lines);
  }
}

// At most so many round values between two limits; of decades where the value in the middle says that these are even.
function round(low, high, most, middle) {
  const tidy = (value) => Number(value.toPrecision(12));
  if (low > 0 && middle < 0.25 * high) {
    const decades = Array.from({ length: Math.ceil(Math.log10(high / low)) + 2 }, (_, k) => 10 ** (Math.floor(Math.log10(low)) + k));
    const within = (factors) => decades.flatMap((ten) => factors.map((factor) => tidy(factor * ten))).filter((value) => value >= low && value <= high);
    return [[1, 2, 5], [1, 3], [1]].map(within).find((values) => values.length <= most) || within([1]);
  }
  const ten = 10 ** Math.floor(Math.log10((high - low) / most));
  const step = ten * ([1, 2, 5].find((factor) => (high - low) / (factor * ten) <= most) || 10);
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, k) => tidy((first + k) * step));
}

for (const box of document.querySelectorAll(".plane")) new PlaneMap(box);
