// Tables and maps of points. Texts of files reach the page as text, never as markup.

const read = (value, factor, digits = 6) =>
  value === null ? "–" : typeof value === "number" ? String(Number((value * factor).toPrecision(digits))) : value;

const isText = (values) => values.some((value) => typeof value === "string");

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

// All places of a grid, the last dimension first.
function* places(sizes) {
  const count = sizes.reduce((a, b) => a * b, 1);
  for (let row = 0; row < count; row += 1) {
    let rest = row;
    const at = sizes.toReversed().map((size) => [rest % size, (rest = Math.floor(rest / size))][0]);
    yield at.reverse();
  }
}

// A text that the page has compressed.
async function unpacked(id) {
  const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

// The points of a result: columns over a grid of rows.
class Points {
  static async of(id) {
    return Object.assign(new Points(), JSON.parse(await unpacked(id)));
  }

  value(column, at) {
    return column.values[column.dims.reduce((place, dim) => place * this.shape[dim] + at[dim], 0)];
  }

  // The coordinate of a dimension; its entries are counted where it has none.
  axis(dim) {
    const head = this.dims[dim], counted = { head, factor: 1, values: Array.from({ length: this.shape[dim] }, (_, k) => k + 1) };
    return this.columns.find(({ name }) => name === head) || counted;
  }

  // What computes a point alone: the command, and the same in Python.
  again(at) {
    const own = this.columns.filter(({ parameter }) => parameter);
    const quoted = (text) => (/^[\w.+-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\"'\"'")}'`);
    const set = ({ name, ...column }) => ` --set ${name}=${quoted(String(this.value(column, at)))}`;
    const python = ({ name, ...column }) => `, ${name}=${JSON.stringify(this.value(column, at))}`;
    return [this.command + own.map(set).join(""), `import studies\n${this.python}${own.map(python).join("")})`];
  }
}

const dark = matchMedia("(prefers-color-scheme: dark)");
const follow = () => document.documentElement.classList.toggle("dark", dark.matches);
follow();
dark.addEventListener("change", follow);

// DataTables, from the copy in this page.
let library = null;
async function dataTables() {
  return (await import(URL.createObjectURL(new Blob([await unpacked("library")], { type: "text/javascript" })))).default;
}

async function fill(box) {
  library ??= dataTables();
  const DataTable = await library, points = await Points.of(box.dataset.points);
  const escaped = (text) => element("i", {}, text).innerHTML;
  const render = (factor) => (value, type) => {
    if (type === "export") return value === null ? "" : read(value, factor, 15);
    if (type !== "display" && type !== "filter") return value;
    return type === "display" && typeof value === "string" ? escaped(value) : read(value, factor);
  };
  const heads = points.columns.map(({ head, about }) => element("th", { title: about }, head));
  const table = element("table", { class: "display compact" }, element("thead", {}, element("tr", {}, ...heads)));
  box.append(table);
  const csv = { extend: "csv", text: "Save as CSV", filename: box.dataset.name };
  csv.exportOptions = { orthogonal: "export", stripHtml: false, decodeEntities: false };
  new DataTable(table, {
    data: [...places(points.shape)].map((at) => points.columns.map((column) => points.value(column, at))),
    columns: points.columns.map(({ factor, values }) => ({ render: render(factor), className: isText(values) ? "dt-left" : "dt-right" })),
    ...{ order: [], pageLength: 25, autoWidth: false },
    layout: { topStart: { buttons: [csv, { extend: "colvis", text: "Columns" }, "searchBuilder"] } },
    language: { searchBuilder: { button: { 0: "Filter", _: "Filter (%d)" } } },
  });
}

// A plane of points in the colours of a column; a click shows all of a point.
const LIGHTNESS = ["#00224e", "#575d6d", "#a59c74", "#fee838"], SIGNS = ["#0072b2", "#f7f7f7", "#d55e00"];
const OTHERS = ["#0072b2", "#e69f00", "#009e73", "#d55e00", "#a6dcf7", "#7f7f7f"];

function mixed(stops, share) {
  const place = Math.min(Math.max(share, 0), 1) * (stops.length - 1), k = Math.min(Math.floor(place), stops.length - 2);
  const part = (stop, at) => parseInt(stop.slice(at, at + 2), 16);
  const mix = (at) => Math.round(part(stops[k], at) + (place - k) * (part(stops[k + 1], at) - part(stops[k], at)));
  return `rgb(${mix(1)},${mix(3)},${mix(5)})`;
}

class PlaneMap {
  constructor(box, points) {
    this.points = points;
    [this.x, this.y] = this.points.plane;
    this.at = this.points.shape.map((size) => size >> 1);
    this.results = this.points.columns.filter(({ parameter, dims }) => !parameter && dims.length >= 2);
    const names = this.results.map(({ head }, k) => element("option", { value: k }, head));
    this.choice = element("select", {}, ...names);
    this.choice.value = Math.max(this.results.findIndex(({ name }) => ["regime", "growth_rate"].includes(name)), 0);
    this.canvas = element("canvas", { role: "img", "aria-label": "Map; the sliders below it choose a point" });
    this.mark = element("div", { class: "mark" });
    this.legend = element("p", { class: "legend" });
    this.cell = element("div", { class: "cell", "aria-live": "polite", tabindex: 0 });
    this.sliders = this.points.shape.map((size, dim) => this.slider(size, dim));
    const wide = this.sliders.filter((_, dim) => this.points.shape[dim] > 1);
    box.append(
      element("label", {}, "Colour ", this.choice), this.legend,
      element("div", { class: "beside" },
        element("div", {},
          element("div", { class: "plane" }, this.ticks(this.y, "bottom"), element("div", { class: "field" }, this.canvas, this.mark),
            element("span"), this.ticks(this.x, "left")),
          element("p", { class: "paper" }, `${this.points.axis(this.x).head} across, ${this.points.axis(this.y).head} up; click a cell.`),
          ...wide.map(([label]) => label)),
        this.cell),
    );
    this.choice.addEventListener("change", () => {
      const same = this.twin?.results.findIndex(({ head }) => head === this.column.head) ?? -1;
      if (same >= 0) this.twin.choice.value = same;
      this.draw();
    });
    this.canvas.addEventListener("click", ({ offsetX, offsetY }) => {
      const place = (share, dim) => Math.min(Math.max(Math.floor(share * this.points.shape[dim]), 0), this.points.shape[dim] - 1);
      this.at[this.x] = place(offsetX / this.canvas.clientWidth, this.x);
      this.at[this.y] = place(1 - offsetY / this.canvas.clientHeight, this.y);
      this.tell();
    });
    this.draw();
  }

  slider(size, dim) {
    const input = element("input", { type: "range", min: 0, max: size - 1, "aria-label": this.points.axis(dim).head }), value = element("output");
    input.addEventListener("input", () => {
      this.at[dim] = Number(input.value);
      if (dim === this.x || dim === this.y) this.tell();
      else this.draw();
    });
    return [element("label", {}, input, value), input, value];
  }

  ticks(dim, side) {
    const size = this.points.shape[dim], { values, factor } = this.points.axis(dim), count = Math.min(size, 5);
    const places = Array.from({ length: count }, (_, k) => Math.round((k * (size - 1)) / (count - 1)));
    const texts = places.map((place) => {
      const text = element("span", {}, read(values[place], factor, 3));
      text.style[side] = `${(100 * (place + 0.5)) / size}%`;
      return text;
    });
    return element("div", { class: `ticks ${side}` }, ...texts);
  }

  get column() {
    return this.results[this.choice.value];
  }

  // The plane of the chosen point: each cell's place and value.
  cells(column = this.column) {
    const sizes = this.points.shape.map((size, dim) => (dim === this.x || dim === this.y ? size : 1));
    return [...places(sizes)].map((place) => {
      const at = place.map((k, dim) => (dim === this.x || dim === this.y ? k : this.at[dim]));
      return [at[this.x], at[this.y], this.points.value(column, at)];
    });
  }

  // The colour of a value, and entries of the legend.
  colours(values, factor) {
    const known = new Set(values.filter((value) => value !== null));
    if (isText([...known])) {
      const words = [...known].sort(), colour = (word) => this.points.colours[word] || OTHERS[words.indexOf(word) % OTHERS.length];
      return [colour, words.map((word) => [colour(word), word])];
    }
    const low = Math.min(...known), high = Math.max(...known), most = Math.max(-low, high);
    const [stops, from, to] = low < 0 && high > 0 ? [SIGNS, -most, most] : [LIGHTNESS, low, high];
    const colour = (value) => (value === null ? "transparent" : mixed(stops, (value - from) / (to - from || 1)));
    const ends = low > high ? [] : [...new Set([low, ...(low < 0 && high > 0 ? [0] : []), high])];
    return [colour, ends.map((end) => [colour(end), read(end, factor, 4)])];
  }

  draw(first = true) {
    const { column, twin } = this, cells = this.cells(), others = twin?.column.head === column.head ? twin.cells() : [];
    const [colour, entries] = this.colours([...cells, ...others].map(([, , value]) => value), column.factor);
    [this.canvas.width, this.canvas.height] = [this.points.shape[this.x], this.points.shape[this.y]];
    const context = this.canvas.getContext("2d");
    for (const [x, y, value] of cells) {
      context.fillStyle = colour(value);
      context.fillRect(x, this.canvas.height - 1 - y, 1, 1);
    }
    this.legend.replaceChildren(...entries.map(([shade, text]) => {
      const swatch = element("i");
      swatch.style.background = shade;
      return element("span", {}, swatch, text);
    }));
    this.tell(first);
  }

  // The point of another map nearest to its own, where they have a parameter in common.
  follow({ points, at }) {
    for (const [dim, name] of this.points.dims.entries()) {
      const theirs = points.dims.indexOf(name), { values } = this.points.axis(dim);
      if (theirs < 0) continue;
      const value = points.axis(theirs).values[at[theirs]];
      const off = values.map((each) => (each === value ? 0 : Math.abs(each - value) || Infinity));
      this.at[dim] = off.indexOf(Math.min(...off));
    }
    this.draw(false);
  }

  tell(first = true) {
    const { points, at, mark, x, y } = this, share = (dim, k) => `${(100 * k) / points.shape[dim]}%`;
    Object.assign(mark.style, { left: share(x, at[x]), bottom: share(y, at[y]), width: share(x, 1), height: share(y, 1) });
    for (const [dim, [, input, value]] of this.sliders.entries()) {
      const axis = points.axis(dim);
      [input.value, value.textContent] = [at[dim], ` ${axis.head}: ${read(axis.values[at[dim]], axis.factor)}`];
    }
    const pairs = points.columns.map((column) => [column.head, read(points.value(column, at), column.factor)]);
    const list = element("dl", {}, ...pairs.flatMap(([head, text]) => [element("dt", {}, head), element("dd", {}, text)]));
    const unbroken = (text) => text.split(/(--\w+)/).map((part, k) => (k % 2 ? element("span", {}, part) : part));
    const code = points.command ? points.again(at).map((text) => element("pre", {}, element("code", {}, ...unbroken(text)))) : [];
    this.cell.replaceChildren(element("p", {}, points.scene), ...(code.length ? ["This point again:", ...code] : []), list);
    if (first) this.twin?.follow(this);
  }
}

// How long ago something was, beside its date.
function age(time) {
  const minutes = (Date.now() - Date.parse(time.dateTime)) / 6e4, units = [[1, "minute"], [60, "hour"], [1440, "day"]];
  const [size, unit] = units.findLast(([each]) => minutes >= 2 * each) ?? units[0];
  if (minutes >= 0) time.textContent = ` (${new Intl.RelativeTimeFormat("en", { numeric: "auto" }).format(-Math.round(minutes / size), unit)})`;
}

// What a piece of the page needs of this script.
function furnish(piece) {
  const all = (css) => piece.querySelectorAll(css);
  for (const box of all(".points")) box.addEventListener("toggle", () => fill(box), { once: true });
  for (const box of all(".map")) Points.of(box.dataset.points).then((points) => new PlaneMap(box, points));
  for (const box of all(".player")) unpacked(box.dataset.moving).then((text) => new Player(box, JSON.parse(text)));
  for (const time of all("time")) age(time);
  // Words are flush left, numbers flush right.
  for (const cell of all(".numbers :is(td, th)")) {
    if (!/^[-+<>≤≥]?[\d.]|^-?$/.test(cell.textContent)) cell.classList.add("text");
  }
}

// Two maps that are chosen from all of the page.
function compare(place) {
  const maps = [...document.querySelectorAll(".map")], pair = element("div", { class: "pair" });
  if (maps.length < 2) return place.append(element("p", {}, "There are no two maps on this page."));
  const options = () => maps.map(({ dataset }) => element("option", { value: dataset.points }, dataset.name));
  const choices = ["Left", "Right"].map((side) => element("select", { "aria-label": side }, element("option", {}, side), ...options()));
  place.append(element("p", {}, ...choices), pair);
  place.addEventListener("change", async ({ target }) => {
    if (!choices.includes(target) || choices.some(({ selectedIndex }) => !selectedIndex)) return;
    const boxes = choices.map(() => element("div", { class: "map" }));
    const points = await Promise.all(choices.map(({ value }) => Points.of(value)));
    const [left, right] = boxes.map((box, k) => new PlaneMap(box, points[k]));
    [left.twin, right.twin] = [right, left];
    left.choice.dispatchEvent(new Event("change"));
    pair.replaceChildren(...boxes);
  });
}

const pieces = (page) => [...page.querySelectorAll("body > header, .columns > nav, main > *")];
const texts = (all) => all.map((piece) => piece.outerHTML);
let written = texts(pieces(document));

// A page that `fiv report --watch` serves takes what changed from a newer one; what did not change keeps its state.
async function renew(version) {
  try {
    const now = (await fetch("", { method: "HEAD", cache: "no-store" })).headers.get("Last-Modified");
    if (version && now !== version) {
      const page = new DOMParser().parseFromString(await (await fetch("", { cache: "no-store" })).text(), "text/html");
      const [newer, older] = [page, document].map(pieces), fresh = texts(newer);
      if (newer.length !== older.length) return location.reload();
      for (const [k, piece] of newer.entries()) {
        if (fresh[k] === written[k]) continue;
        older[k].replaceWith(piece);
        furnish(piece);
      }
      written = fresh;
    }
    setTimeout(renew, 2000, now);
  } catch {
    document.querySelector("header").append(element("p", { class: "note" }, "fiv report --watch has ended: this page is as it was then."));
  }
}

furnish(document);
compare(document.getElementById("compare"));
if (["127.0.0.1", "localhost"].includes(location.hostname)) renew();
