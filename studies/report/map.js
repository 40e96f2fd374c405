// A plane of scenes: a cell for each, in the colour of a figure; pointing at one tells all of it.

const OTHER = ["#0072b2", "#e69f00", "#009e73", "#d55e00", "#a6dcf7", "#7f7f7f"];
const EDGE = { left: 58, right: 10, top: 10, bottom: 46 };

class PlaneMap {
  constructor(box) {
    this.points = Points.of(box.getAttribute("data-of"));
    this.plane = this.points.plane;
    this.canvas = box.querySelector("canvas");
    this.legend = box.querySelector(".legend");
    this.panel = box.querySelector(".cell");
    this.said = box.querySelector(".said");
    this.at = this.points.shape.map(() => 0);
    const [x, y] = [this.plane.x, this.plane.y];
    this.at[x] = this.points.shape[x] >> 1;
    this.at[y] = this.points.shape[y] >> 1;
    this.choose(box.querySelector(".choose"));
    this.listen();
    this.recolour();
    this.tell();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  row() {
    return this.at.reduce((sum, place, dim) => sum + place * this.points.strides[dim], 0);
  }

  choose(box) {
    const figure = element("select");
    this.points.columns.forEach((column, k) => {
      if (column.dim === null && column.name !== "error") figure.append(element("option", column.name, { value: k }));
    });
    this.column = this.points.place.get(this.plane.first);
    figure.value = String(this.column);
    figure.addEventListener("change", () => { this.column = Number(figure.value); this.recolour(); this.draw(); });
    box.append(this.labelled("Colour", figure));
    this.points.axes.forEach((axis, dim) => {
      if (dim === this.plane.x || dim === this.plane.y || axis.values.length < 2) return;
      const select = element("select");
      axis.values.forEach((_, k) => select.append(element("option", this.read(dim, k), { value: k })));
      select.addEventListener("change", () => { this.at[dim] = Number(select.value); this.draw(); this.tell(); });
      box.append(this.labelled(axis.label || axis.name, select));
    });
  }

  labelled(text, control) {
    const label = element("label", text);
    label.append(control);
    return label;
  }

  // A value of an axis in the unit of its label.
  read(dim, place) {
    const axis = this.points.axes[dim];
    return String(Number((axis.values[place] * (axis.factor || 1)).toPrecision(4)));
  }

  recolour() {
    const column = this.points.columns[this.column];
    this.legend.replaceChildren();
    const seen = new Set();
    let [low, high] = [Infinity, -Infinity];
    for (let row = 0; row < this.points.count; row += 1) {
      const value = this.points.value(row, this.column);
      seen.add(value);
      if (typeof value === "number") [low, high] = [Math.min(low, value), Math.max(high, value)];
    }
    const words = column.words ? column.words.filter((word) => seen.has(word)) : null;
    const stable = column.name === "growth_rate";
    if (words) {
      const colours = new Map(words.map((word, k) => [word, this.plane.colours[word] || OTHER[k % OTHER.length]]));
      this.colour = (value) => colours.get(value);
      for (const [word, colour] of colours) this.key(colour, word);
    } else {
      if (stable) low = 0;
      const shades = this.plane.shades;
      const span = high - low || 1;
      this.colour = (value) => {
        if (typeof value !== "number") return undefined;
        if (stable && value <= 0) return this.plane.stable;
        return shades[Math.min(Math.floor(((value - low) / span) * shades.length), shades.length - 1)];
      };
      if (stable) this.key(this.plane.stable, "stable");
      if (low <= high) {
        const bar = this.key("", "", "bar");
        bar.firstChild.style.background = `linear-gradient(to right, ${shades.join(", ")})`;
        bar.prepend(element("b", shown(low)));
        bar.append(element("b", `${shown(high)} ${column.units}`));
      }
    }
    if (seen.has(null)) this.key("", "no value");
    this.canvas.setAttribute("data-colour", column.name);
  }

  key(colour, text, kind) {
    const item = element("span");
    const swatch = element("i", null, kind ? { class: kind } : {});
    swatch.style.background = colour || "transparent";
    item.append(swatch);
    if (text) item.append(text);
    this.legend.append(item);
    return item;
  }

  draw() {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (!width) return;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    const context = this.canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const ink = getComputedStyle(this.canvas).color;
    const [x, y] = [this.plane.x, this.plane.y];
    const [across, up] = [this.points.shape[x], this.points.shape[y]];
    this.box = { left: EDGE.left, top: EDGE.top, width: width - EDGE.left - EDGE.right, height: height - EDGE.top - EDGE.bottom };
    const [w, h] = [this.box.width / across, this.box.height / up];
    const at = [...this.at];
    for (at[x] = 0; at[x] < across; at[x] += 1) {
      for (at[y] = 0; at[y] < up; at[y] += 1) {
        const row = at.reduce((sum, place, dim) => sum + place * this.points.strides[dim], 0);
        const [a, b] = this.corner(at[x], at[y]);
        const [c, d] = this.corner(at[x] + 1, at[y] - 1);
        const colour = this.colour(this.points.value(row, this.column));
        if (colour) {
          context.fillStyle = colour;
          context.fillRect(a, b, c - a, d - b);
        }
        if (this.points.named(row, "status") === "failed") {
          context.strokeStyle = "#7f7f7f";
          context.lineWidth = 1;
          context.beginPath();
          context.moveTo(a, b); context.lineTo(c, d);
          context.moveTo(c, b); context.lineTo(a, d);
          context.stroke();
        }
      }
    }
    context.strokeStyle = ink;
    context.fillStyle = ink;
    context.lineWidth = 1;
    context.strokeRect(this.box.left, this.box.top, this.box.width, this.box.height);
    this.scales(context, w, h, height);
    const [a, b] = [this.box.left + this.at[x] * w, this.box.top + (up - 1 - this.at[y]) * h];
    context.lineWidth = 4; context.strokeStyle = "#fff";
    context.strokeRect(a - 2, b - 2, w + 4, h + 4);
    context.lineWidth = 2; context.strokeStyle = "#000";
    context.strokeRect(a - 2, b - 2, w + 4, h + 4);
  }

  // Upper left corner of a cell, on a whole pixel, so that no seam shows.
  corner(across, up) {
    const ratio = window.devicePixelRatio || 1;
    const [x, y] = [this.plane.x, this.plane.y];
    const left = this.box.left + (across * this.box.width) / this.points.shape[x];
    const top = this.box.top + ((this.points.shape[y] - 1 - up) * this.box.height) / this.points.shape[y];
    return [Math.round(left * ratio) / ratio, Math.round(top * ratio) / ratio];
  }

  scales(context, w, h, height) {
    const [x, y] = [this.plane.x, this.plane.y];
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    for (const k of this.ticks(x, this.box.width / 64)) {
      context.fillText(this.read(x, k), this.box.left + (k + 0.5) * w, this.box.top + this.box.height + 16);
    }
    const axes = this.points.axes;
    context.fillText(axes[x].label || axes[x].name, this.box.left + this.box.width / 2, height - 6);
    context.textAlign = "right";
    for (const k of this.ticks(y, this.box.height / 32)) {
      const middle = this.box.top + (this.points.shape[y] - k - 0.5) * h;
      context.fillText(this.read(y, k), this.box.left - 6, middle + 4);
    }
    context.save();
    context.translate(12, this.box.top + this.box.height / 2);
    context.rotate(-Math.PI / 2);
    context.textAlign = "center";
    context.fillText(axes[y].label || axes[y].name, 0, 0);
    context.restore();
  }

  ticks(dim, room) {
    const count = this.points.shape[dim];
    const step = Math.max(1, Math.ceil(count / Math.max(room, 2)));
    return Array.from({ length: Math.ceil(count / step) }, (_, k) => k * step);
  }

  listen() {
    const point = (event) => {
      const place = this.canvas.getBoundingClientRect();
      const across = (event.clientX - place.left - this.box.left) / this.box.width;
      const up = 1 - (event.clientY - place.top - this.box.top) / this.box.height;
      if (across < 0 || across >= 1 || up < 0 || up >= 1) return;
      this.move(Math.floor(across * this.points.shape[this.plane.x]), Math.floor(up * this.points.shape[this.plane.y]));
    };
    // A click holds the cell, so that its lines can be reached; another one lets go.
    this.canvas.addEventListener("pointerdown", (event) => {
      this.held = event.pointerType === "mouse" && !this.held;
      point(event);
    });
    this.canvas.addEventListener("pointermove", (event) => { if (!this.held) point(event); });
    this.canvas.addEventListener("keydown", (event) => {
      const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
      const far = event.shiftKey ? 10 : 1;
      if (!steps[event.key]) return;
      event.preventDefault();
      const [dx, dy] = steps[event.key];
      this.move(this.at[this.plane.x] + far * dx, this.at[this.plane.y] + far * dy);
    });
  }

  move(across, up) {
    const [x, y] = [this.plane.x, this.plane.y];
    const within = (place, dim) => Math.min(Math.max(place, 0), this.points.shape[dim] - 1);
    const [a, b] = [within(across, x), within(up, y)];
    if (a === this.at[x] && b === this.at[y]) return;
    this.at[x] = a;
    this.at[y] = b;
    this.draw();
    this.tell();
  }

  tell() {
    const row = this.row();
    const scene = element("dl");
    const add = (list, name, value) => list.append(element("dt", name), element("dd", value));
    this.points.axes.forEach((axis, dim) => add(scene, axis.label || axis.name, this.read(dim, this.at[dim])));
    for (const [name, value] of Object.entries(this.plane.held)) {
      add(scene, name, value);
    }
    const found = element("dl");
    for (const [k, column] of this.points.columns.entries()) {
      const value = this.points.value(row, k);
      if (column.dim === null && value !== "" && value !== null) add(found, column.name, `${shown(value)} ${column.units}`.trim());
    }
    const value = this.points.value(row, this.column);
    this.said.textContent = [...scene.children].map((each) => each.textContent).join(" ")
      + `; ${this.points.columns[this.column].name}: ${shown(value)}`;
    const more = element("div", null, { class: "more", tabindex: "0", role: "region", "aria-label": "What was found" });
    more.append(found);
    const lines = Object.entries(this.plane.lines).flatMap(([name, line]) => [element("p", name), commandLine(this.written(line, row))]);
    this.panel.replaceChildren(element("h4", "The scene"), scene, element("h4", "What was found"), more, ...lines);
  }

  // A line with the values of this point in it, with all digits that the page has.
  written(line, row) {
    return line.replace(/\{(\w+)\}/g, (slot, name) => (this.points.place.has(name) ? String(this.points.named(row, name)) : slot));
  }
}

for (const box of document.querySelectorAll(".plane")) new PlaneMap(box);
