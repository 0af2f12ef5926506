// A canvas that shows a piece of a plan: drag to move it, scroll or pinch to zoom, arrow keys, plus and minus as well.

import { Drawing, colour, polyline } from "./canvas.js";

const MIN_SCALE = 2; // pixels per metre
const MAX_SCALE = 400;
const CLICK_SLACK = 6; // pixels that a click may move
const STEP = 60; // pixels that an arrow key moves the plan
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class Viewport {
  constructor(canvas) {
    this.canvas = canvas;
    this.scale = 40; // pixels per metre
    this.centre = [0, 0]; // m
    this.pointers = new Map();
    this.drawing = new Drawing(canvas, (...args) => this.draw(...args));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0016)), event.offsetX, event.offsetY);
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, { x: event.offsetX, y: event.offsetY, moved: 0 });
    });
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    canvas.addEventListener("pointerup", (event) => this.release(event));
    canvas.addEventListener("pointercancel", (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener("keydown", (event) => this.press(event));
  }

  /** A click at a place; for who extends this. */
  click() {}

  /** Draw in metres, y up; for who extends this. */
  paint() {}

  toWorld(x, y) {
    const { width, height } = this.drawing;
    return [this.centre[0] + (x - width / 2) / this.scale, this.centre[1] - (y - height / 2) / this.scale];
  }

  /** Show a box [left, bottom, right, top] whole. */
  fit([left, bottom, right, top]) {
    const { width, height } = this.drawing;
    this.centre = [(left + right) / 2, (bottom + top) / 2];
    this.scale = clamp(Math.min((width - 40) / (right - left + 0.5), (height - 60) / (top - bottom + 0.5)));
    this.drawing.request();
  }

  zoom(factor, x = this.drawing.width / 2, y = this.drawing.height / 2) {
    const before = this.toWorld(x, y);
    this.scale = clamp(this.scale * factor);
    const after = this.toWorld(x, y);
    this.centre = [this.centre[0] + before[0] - after[0], this.centre[1] + before[1] - after[1]];
    this.drawing.request();
  }

  drag(event) {
    const pointer = this.pointers.get(event.pointerId);
    if (!pointer) return;
    const [dx, dy] = [event.offsetX - pointer.x, event.offsetY - pointer.y];
    pointer.moved += Math.hypot(dx, dy);
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      const apart = Math.hypot(pointer.x - other.x, pointer.y - other.y);
      const now = Math.hypot(event.offsetX - other.x, event.offsetY - other.y);
      this.zoom(now / Math.max(1, apart), (event.offsetX + other.x) / 2, (event.offsetY + other.y) / 2);
    } else if (pointer.moved >= CLICK_SLACK) {
      this.canvas.classList.add("dragging");
      this.move(dx, -dy);
    }
    [pointer.x, pointer.y] = [event.offsetX, event.offsetY];
  }

  release(event) {
    const pointer = this.pointers.get(event.pointerId);
    const isClick = pointer && pointer.moved < CLICK_SLACK && this.pointers.size === 1 && event.button === 0;
    this.pointers.delete(event.pointerId);
    this.canvas.classList.remove("dragging");
    if (isClick) this.click(this.toWorld(event.offsetX, event.offsetY));
  }

  /** Keys of a focused plan move the plan, and never the robot. */
  press(event) {
    const step = STEPS[event.code];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (step) this.move(-STEP * step[0], -STEP * step[1]);
    else if (event.key === "+" || event.key === "=") this.zoom(1.35);
    else if (event.key === "-") this.zoom(1 / 1.35);
    else if (event.key === "Enter") this.click(this.centre);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** Move the plan by pixels, right and up. */
  move(right, up) {
    this.centre = [this.centre[0] - right / this.scale, this.centre[1] - up / this.scale];
    this.drawing.request();
  }

  draw(context, width, height) {
    context.save();
    context.translate(width / 2, height / 2);
    context.scale(this.scale, -this.scale);
    context.translate(-this.centre[0], -this.centre[1]);
    this.paint(context, 1 / this.scale);
    context.restore();
    drawScale(context, this.scale, width, height);
  }
}

function clamp(scale) {
  return Math.min(MAX_SCALE, Math.max(MIN_SCALE, scale));
}

function drawScale(context, scale, width, height) {
  const metres = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50].findLast((length) => length * scale < 110) ?? 0.1;
  const left = width - 16 - metres * scale;
  context.strokeStyle = context.fillStyle = colour("muted");
  context.lineWidth = 2;
  polyline(context, [[left, height - 20], [left, height - 15], [width - 16, height - 15], [width - 16, height - 20]]);
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "center";
  context.fillText(`${metres} m`, (left + width - 16) / 2, height - 22);
}
