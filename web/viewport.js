// A canvas that shows a piece of a plane: drag to move it, scroll or pinch to zoom. Maps extend it.

import { Drawing, colour, polyline } from "./canvas.js";

const MIN_SCALE = 2; // pixels per metre
const MAX_SCALE = 400;
const FIT_SCALE = 120; // of a map of one place
const CLICK_SLACK = 6; // pixels that a click may move
const NEARER = { bumper_cart: 6 }; // times, a robot of a few centimetres and its map are looked at

/** From how much nearer than buildings the map of a robot of that name is looked at. */
export function closenessOf(robot) {
  return NEARER[robot] ?? 1;
}

export class Viewport {
  constructor(canvas) {
    this.canvas = canvas;
    this.scale = 40; // pixels per metre
    this.closeness = 1; // from how much nearer than a building what is shown is looked at
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
  }

  /** A click at a place [x, y]; for who extends this. */
  click() {}

  /** Draw in metres, y up; for who extends this. */
  paint() {}

  /** The size of a pixel in metres. */
  get pixel() {
    return 1 / this.scale;
  }

  toWorld(x, y) {
    const { width, height } = this.drawing;
    return [this.centre[0] + (x - width / 2) / this.scale, this.centre[1] - (y - height / 2) / this.scale];
  }

  toScreen([x, y]) {
    const { width, height } = this.drawing;
    return [width / 2 + (x - this.centre[0]) * this.scale, height / 2 - (y - this.centre[1]) * this.scale];
  }

  /** Show a box [left, bottom, right, top] whole. */
  show([left, bottom, right, top]) {
    const { width, height } = this.drawing;
    this.centre = [(left + right) / 2, (bottom + top) / 2];
    const [margin, nearest] = [1 / this.closeness, FIT_SCALE * this.closeness];
    this.scale = this.clamp(Math.min(nearest, 0.86 * width / (right - left + margin), 0.86 * height / (top - bottom + margin)));
    this.drawing.request();
  }

  zoom(factor, x = this.drawing.width / 2, y = this.drawing.height / 2) {
    const before = this.toWorld(x, y);
    this.scale = this.clamp(this.scale * factor);
    const after = this.toWorld(x, y);
    this.centre = [this.centre[0] + before[0] - after[0], this.centre[1] + before[1] - after[1]];
    this.drawing.request();
  }

  clamp(scale) {
    return Math.min(MAX_SCALE * this.closeness, Math.max(MIN_SCALE, scale));
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
    this.paint(context, this.pixel);
    context.restore();
    drawScale(context, this.scale, width, height);
  }
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
