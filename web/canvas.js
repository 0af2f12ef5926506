// What all drawings share: sharp canvases that follow their panel's size, and the stylesheet's colours.

const probe = document.createElement("span");
probe.hidden = true;
document.documentElement.append(probe);

let known = new Map();

/** A colour of the stylesheet (`--name`) as the present theme resolves it. */
export function colour(name) {
  if (!known.has(name)) {
    probe.style.color = `var(--${name})`;
    known.set(name, getComputedStyle(probe).color);
  }
  return known.get(name);
}

/** Red, green and blue (0 to 255) of a colour of the stylesheet. */
export function channels(name) {
  return colour(name).match(/[\d.]+/g).slice(0, 3).map(Number);
}

const drawings = new Set();

/** Draw everything anew, with the theme's colours asked for again. */
export function forgetColours() {
  known = new Map();
  for (const drawing of drawings) drawing.request();
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", forgetColours);

/** A canvas that calls `draw(context, width, height)` in CSS pixels, at most once per animation frame. */
export class Drawing {
  constructor(canvas, draw) {
    this.canvas = canvas;
    this.draw = draw;
    this.isDue = false;
    this.width = this.height = 1;
    drawings.add(this);
    new ResizeObserver(() => this.resize()).observe(canvas);
  }

  resize() {
    const { width, height } = this.canvas.getBoundingClientRect();
    const scale = devicePixelRatio || 1;
    this.width = width;
    this.height = height;
    this.canvas.width = Math.max(1, Math.round(width * scale));
    this.canvas.height = Math.max(1, Math.round(height * scale));
    this.request();
  }

  request() {
    if (this.isDue) return;
    this.isDue = true;
    requestAnimationFrame(() => {
      this.isDue = false;
      const scale = devicePixelRatio || 1;
      const context = this.canvas.getContext("2d");
      context.setTransform(scale, 0, 0, scale, 0, 0);
      context.clearRect(0, 0, this.width, this.height);
      context.lineCap = context.lineJoin = "round";
      this.draw(context, this.width, this.height);
    });
  }
}

/** Stroke a polyline of [x, y]. */
export function polyline(context, points) {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.stroke();
}

/** A disc around [x, y]. */
export function dot(context, [x, y], radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
  context.fill();
}

/** A circle around [x, y]. */
export function ring(context, [x, y], radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
  context.stroke();
}

/** Upright text at [x, y] in a context scaled to metres, y up; `pixel` is the size of a pixel there. */
export function write(context, text, [x, y], pixel) {
  context.save();
  context.translate(x, y);
  context.scale(pixel, -pixel);
  context.fillText(text, 0, 0);
  context.restore();
}

/** An arrow from (0, 0) to (x, y) with a filled head of `size`. */
export function arrow(context, x, y, size) {
  const angle = Math.atan2(y, x);
  const neck = [x - size * Math.cos(angle), y - size * Math.sin(angle)];
  polyline(context, [[0, 0], neck]);
  context.beginPath();
  context.moveTo(x, y);
  for (const side of [-1, 1]) {
    context.lineTo(neck[0] + side * 0.55 * size * Math.sin(angle), neck[1] - side * 0.55 * size * Math.cos(angle));
  }
  context.fill();
}

/** The robot seen from above, forward along +x, in a context scaled to metres. */
let shape = "crunch";

/** Draw robots as this one from now on. */
export function shapeAs(name) {
  shape = name;
}

export function robotGlyph(context, ink, front) {
  context.fillStyle = ink;
  if (shape === "maze_runner") return plateGlyph(context, ink, front);
  if (shape === "bumper_cart") return cartGlyph(context, ink, front);
  for (const side of [-1, 1]) context.fillRect(-0.05, side * 0.095 - 0.0125, 0.1, 0.025);
  context.beginPath();
  context.arc(0, 0, 0.076, 0, 7);
  context.fill();
  context.fillStyle = front;
  context.beginPath();
  context.moveTo(0.066, 0);
  context.lineTo(-0.03, 0.042);
  context.lineTo(-0.012, 0);
  context.lineTo(-0.03, -0.042);
  context.fill();
}

/** A plate with its corners cut off, a wheel on either side, and the laser in front. */
function plateGlyph(context, ink, front) {
  for (const side of [-1, 1]) context.fillRect(-0.035, side * 0.1 - 0.012, 0.07, 0.024);
  context.beginPath();
  for (const [x, y] of [[0.1, 0.05], [0.06, 0.085], [-0.09, 0.085], [-0.12, 0.05], [-0.12, -0.05], [-0.09, -0.085], [0.06, -0.085], [0.1, -0.05]]) context.lineTo(x, y);
  context.closePath();
  context.fill();
  context.fillStyle = front;
  context.beginPath();
  context.arc(0.05, 0, 0.028, 0, 7);
  context.fill();
}

/** A brick on two wheels, and the bumper ahead, as wide as all of it. */
function cartGlyph(context, ink, front) {
  for (const side of [-1, 1]) context.fillRect(-0.02, side * 0.032 - 0.006, 0.04, 0.012);
  context.fillRect(-0.025, -0.022, 0.1, 0.044);
  context.fillStyle = front;
  context.fillRect(0.08, -0.0381, 0.01, 0.0762);
}
