"use strict";
// What tables and maps of this page share. All text reaches the page as text, never as markup.

function element(name, text = null, attributes = {}) {
  const made = document.createElement(name);
  if (text !== null) made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

// The points of a result: rows in the order of its grid, columns by number.
class Points {
  constructor(id) {
    const { axes, columns, plane, settings } = JSON.parse(document.getElementById(id).textContent);
    Object.assign(this, { axes, plane, settings });
    this.shape = axes.map((axis) => axis.values.length);
    this.count = this.shape.reduce((product, size) => product * size, 1);
    this.columns = [
      ...axes.map((axis, dim) => ({ ...axis, dim, axis: true })),
      ...axes.flatMap((axis, dim) =>
        axis.names ? [{ name: axis.name + "_name", kind: "text", units: "", about: axis.about, dim, values: axis.names }] : []),
      ...columns.map((column) => ({ ...column, dim: null })),
    ];
    this.place = new Map(this.columns.map((column, k) => [column.name, k]));
    this.strides = this.shape.map((_, dim) => this.shape.slice(dim + 1).reduce((product, size) => product * size, 1));
  }

  value(row, column) {
    const { dim, values, at, fill } = this.columns[column];
    if (dim !== null) return values[Math.floor(row / this.strides[dim]) % this.shape[dim]];
    if (values) return values[row];
    return Object.hasOwn(at, row) ? at[row] : fill;
  }

  named(row, name) {
    return this.value(row, this.place.get(name));
  }

  static of(id) {
    if (!Points.known.has(id)) Points.known.set(id, new Points(id));
    return Points.known.get(id);
  }
}
Points.known = new Map();

function shown(value) {
  if (value === null) return "–";
  if (typeof value !== "number") return String(value);
  return String(Number(value.toPrecision(6)));
}

function headed(column) {
  return column.units ? `${column.name} (${column.units})` : column.name;
}

function copying(button) {
  const line = button.parentElement.querySelector("code");
  button.hidden = false;
  button.setAttribute("aria-label", "Copy this line");
  button.addEventListener("click", async () => {
    try {
      await navigator.clipboard.writeText(line.textContent);
      button.textContent = "Copied";
      setTimeout(() => { button.textContent = "Copy"; }, 1500);
    } catch {
      // Without a clipboard the line is marked, ready for the keyboard.
      getSelection().selectAllChildren(line);
    }
  });
}

function commandLine(text) {
  const box = document.getElementById("command").content.firstElementChild.cloneNode(true);
  // Broken before an option, if at all.
  const [begin, ...options] = text.split(" --");
  box.querySelector("code").replaceChildren(begin, ...options.flatMap((part) => [" ", element("span", "--" + part)]));
  copying(box.querySelector("button"));
  return box;
}

for (const button of document.querySelectorAll(".copy")) copying(button);
