// What moves, frame by frame: a canvas with a button and a slider. It starts by itself unless less motion is wanted,
// and moves only where it can be seen.

const still = matchMedia("(prefers-reduced-motion: reduce)");
const STRIP = 0.16, MARGIN = 0.07; // of the width

class Player {
  constructor(box, data) {
    Object.assign(this, data, { box, at: 0, last: null, wanted: !still.matches, seen: false });
    const caption = box.querySelector("figcaption").textContent;
    this.canvas = element("canvas", { role: "img", "aria-label": `Animation: ${caption}` });
    this.button = element("button", { type: "button" });
    this.slider = element("input", { type: "range", min: 0, max: this.frames.length - 1, "aria-label": "Frame" });
    box.prepend(this.canvas, element("p", {}, this.button, this.slider));
    this.button.addEventListener("click", () => this.play(!this.wanted));
    this.slider.addEventListener("input", () => {
      this.at = Number(this.slider.value);
      this.play(false);
    });
    still.addEventListener("change", () => still.matches && this.play(false));
    document.addEventListener("visibilitychange", () => this.go());
    dark.addEventListener("change", () => this.draw());
    new ResizeObserver(() => this.draw()).observe(box);
    new IntersectionObserver(([{ isIntersecting }]) => {
      this.seen = isIntersecting;
      this.go();
    }).observe(this.canvas);
    this.play(this.wanted);
  }

  play(wanted) {
    this.wanted = wanted;
    this.button.textContent = wanted ? "Pause" : "Play";
    this.draw();
    this.go();
  }

  // Starts or stops the clock.
  go() {
    cancelAnimationFrame(this.next);
    this.last = null;
    if (this.wanted && this.seen && !document.hidden) this.next = requestAnimationFrame((now) => this.step(now));
  }

  step(now) {
    if (!this.box.isConnected) return;
    const count = this.frames.length;
    if (this.last !== null) this.at = (this.at + ((now - this.last) / 1000 / this.loop) * count) % count;
    this.last = now;
    this.draw();
    this.next = requestAnimationFrame((time) => this.step(time));
  }

  draw() {
    const { canvas, size, series, frames } = this, width = Math.min(this.box.clientWidth, 736), names = Object.keys(series);
    if (!width) return;
    const pad = MARGIN * width, strip = Math.max(STRIP * width, 70);
    const unit = Math.min((width - 2 * pad) / size[0], width / size[1]), height = size[1] * unit + 2 * pad;
    const sharp = devicePixelRatio || 1, style = getComputedStyle(canvas), colour = (name) => style.getPropertyValue(`--${name}`);
    canvas.style.width = `${width}px`;
    [canvas.width, canvas.height] = [width, height + strip * names.length].map((each) => Math.round(each * sharp));
    const context = canvas.getContext("2d"), k = Math.floor(this.at), word = this.states[this.state[k]];
    context.scale(sharp, sharp);
    context.font = `13px ${style.fontFamily}`;
    context.lineJoin = "round";
    const left = (width - size[0] * unit) / 2, place = (nodes, node) => [left + unit * nodes[2 * node], pad + unit * nodes[2 * node + 1]];
    const now = frames[k], next = frames[(k + 1) % frames.length], share = this.at - k;
    // Between two frames, but not from the last back to the first of what does not close.
    const between = k + 1 < frames.length || !names.length ? now.map((each, i) => each + share * (next[i] - each)) : now;
    const stroke = (points, shade, thick, dash = []) => {
      context.beginPath();
      for (const point of points) context.lineTo(...point);
      context.setLineDash(dash);
      [context.strokeStyle, context.lineWidth] = [shade, thick];
      context.stroke();
    };
    context.fillStyle = colour("ink");
    for (const [name, nodes] of this.lines) {
      stroke(nodes.map((node) => place(this.still, node)), colour("soft"), 1, [4, 4]);
      stroke(nodes.map((node) => place(between, node)), colour("ink"), 3);
      const [x, y] = place(this.still, nodes.at(name === "P2" ? -1 : 0));
      context.fillText(name, x + 6, y - 8);
    }
    const [x, y] = place(between, this.tip);
    mark(context, x, y, 7, word, colour(word));
    context.fillStyle = colour("ink");
    context.fillText("C", x + 10, y + 18);
    mark(context, 12, 12, 6, word, colour(word));
    context.fillStyle = colour("ink");
    context.fillText(word, 24, 16);
    for (const [row, name] of names.entries()) {
      const values = series[name], low = Math.min(...values, 0), high = Math.max(...values, 0), top = height + row * strip + 18;
      const x = (i) => 6 + ((width - 12) * i) / values.length, y = (value) => top + (strip - 24) * (1 - (value - low) / (high - low || 1));
      context.fillText(`${name}, from ${read(low, 1, 3)} to ${read(high, 1, 3)}`, 6, top - 5);
      stroke([[x(0), y(0)], [x(values.length), y(0)]], colour("line"), 1);
      // A part of the curve for each stretch of one state.
      for (let begin = 0, end = 1; begin < values.length - 1; begin = end, end += 1) {
        while (end < values.length - 1 && this.state[end] === this.state[begin]) end += 1;
        stroke(values.slice(begin, end + 1).map((value, i) => [x(begin + i), y(value)]), colour(this.states[this.state[begin]]), 2);
      }
      stroke([[x(this.at), top], [x(this.at), top + strip - 24]], colour("accent"), 1.5);
    }
    this.slider.value = k;
  }
}

// The contact: a square in stick, a disc in slip, a ring in separation, so that it does not need its colour.
function mark(context, x, y, size, word, shade) {
  context.beginPath();
  if (word === "stick") context.rect(x - size, y - size, 2 * size, 2 * size);
  else context.arc(x, y, size, 0, 2 * Math.PI);
  context.setLineDash([]);
  [context.fillStyle, context.strokeStyle, context.lineWidth] = [shade, shade, 3];
  if (word === "separation") context.stroke();
  else context.fill();
}

