"use strict";
// What tables and maps of this page share. All text reaches the page as text, never as markup.

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

const product = (numbers) => numbers.reduce((a, b) => a * b, 1);

// The points of a result: rows in the order of its grid, columns by number.
class Points {
  constructor(id) {
    const { axes, columns, plane, settings } = JSON.parse(document.getElementById(id).textContent);
    Object.assign(this, { axes, plane, settings });
    this.shape = axes.map((axis) => axis.values.length);
    this.count = product(this.shape);
    this.columns = [...axes.map((axis, dim) => ({ ...axis, dim, axis: true })), ...columns];
    this.place = new Map(this.columns.map((column, k) => [column.name, k]));
    this.strides = this.shape.map((_, dim) => product(this.shape.slice(dim + 1)));
  }

  value(row, column) {
    const { axis, dim, values } = this.columns[column];
    return values[axis ? Math.floor(row / this.strides[dim]) % this.shape[dim] : row];
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

// A text as one word of a shell.
function quoted(text) {
  return /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\"'\"'")}'`;
}

// A command, or lines of Python: broken before an option, if at all, with a button that copies it.
function command(text, box = element("div", { class: "command" })) {
  const [begin, ...options] = text.split(" --");
  const code = element("code", {}, begin, ...options.flatMap((part) => [" ", element("span", {}, "--" + part)]));
  const button = element("button", { type: "button", "aria-label": "Copy this line" }, "Copy");
  button.addEventListener("click", async () => {
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "Copied";
      setTimeout(() => { button.textContent = "Copy"; }, 1500);
    } catch {
      // Without a clipboard the line is marked, ready for the keyboard.
      getSelection().selectAllChildren(code);
    }
  });
  box.replaceChildren(element("pre", {}, code), button);
  return box;
}

for (const box of document.querySelectorAll(".command")) command(box.textContent, box);

// What is folded opens where a link leads to it, and for a print.
function unfold(within) {
  for (const fold of within ? within.querySelectorAll("details.fold") : []) fold.open = true;
}
addEventListener("hashchange", () => unfold(document.getElementById(location.hash.slice(1))));
addEventListener("beforeprint", () => unfold(document));
unfold(document.getElementById(location.hash.slice(1)));

// The list of sections marks the one that is read.
const links = new Map([...document.querySelectorAll(".index a")].map((link) => [link.getAttribute("href").slice(1), link]));
const watch = new IntersectionObserver((entries) => {
  for (const { isIntersecting, target } of entries) {
    if (!isIntersecting) continue;
    for (const link of links.values()) link.removeAttribute("aria-current");
    links.get(target.id).setAttribute("aria-current", "true");
  }
}, { rootMargin: "-20% 0px -75% 0px" });
for (const section of document.querySelectorAll("main > [id]")) if (links.has(section.id)) watch.observe(section);
