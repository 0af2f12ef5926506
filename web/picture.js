// What of the map stays as it is until it changes, kept as a picture somewhat larger than the panel. Following the robot,
// dragging and zooming only move and stretch it, until there is time to draw it anew.

import { colour } from "./canvas.js";

const MARGIN = 0.3; // of the panel's size, beyond each edge
const REST = 200; // ms between two new pictures

export class Picture {
  constructor() {
    this.canvas = null;
    this.key = "";
    this.scale = 1; // pixels per metre, as it was drawn
    this.centre = [0, 0];
    this.size = [0, 0]; // in CSS pixels
    this.drawn = -Infinity; // performance.now()
    this.timer = null;
  }

  forget() {
    this.key = "";
  }

  /** Put the picture of a view's still `layers` under the view. */
  paint(context, view, layers) {
    if (!this.isGood(view)) this.renew(view, layers);
    const { width, height } = view.drawing;
    const stretch = view.scale / this.scale;
    const [wide, high] = [stretch * this.size[0], stretch * this.size[1]];
    const x = width / 2 + (this.centre[0] - view.centre[0]) * view.scale - wide / 2;
    const y = height / 2 + (view.centre[1] - this.centre[1]) * view.scale - high / 2;
    context.drawImage(this.canvas, x, y, wide, high);
  }

  isGood(view) {
    const { width, height } = view.drawing;
    if (this.key !== keyOf(view)) return false;
    const [x, y] = [this.centre[0] - view.centre[0], this.centre[1] - view.centre[1]];
    return Math.abs(x) * view.scale < MARGIN * width && Math.abs(y) * view.scale < MARGIN * height;
  }

  /** Draw it, now or when it has rested. */
  renew(view, layers) {
    const rest = this.drawn + REST - performance.now();
    if (rest <= 0) this.draw(view, layers);
    else this.timer ??= setTimeout(() => {
      this.timer = null;
      view.drawing.request();
    }, rest);
  }

  draw(view, layers) {
    const { width, height } = view.drawing;
    const pixels = devicePixelRatio || 1;
    this.size = [(1 + 2 * MARGIN) * width, (1 + 2 * MARGIN) * height];
    const [wide, high] = this.size.map((length) => Math.max(1, Math.round(length * pixels)));
    if (this.canvas?.width !== wide || this.canvas?.height !== high) this.canvas = new OffscreenCanvas(wide, high);
    this.key = keyOf(view);
    this.scale = view.scale;
    this.centre = [...view.centre];
    this.drawn = performance.now();
    const context = this.canvas.getContext("2d");
    context.resetTransform();
    context.clearRect(0, 0, wide, high);
    context.lineCap = context.lineJoin = "round";
    context.scale(pixels, pixels);
    context.translate(this.size[0] / 2, this.size[1] / 2);
    context.scale(view.scale, -view.scale);
    context.translate(-view.centre[0], -view.centre[1]);
    const [x, y] = this.size.map((length) => 0.5 * length * view.pixel);
    view.bounds = [view.centre[0] - x, view.centre[1] - y, view.centre[0] + x, view.centre[1] + y];
    for (const layer of layers) view.drawLayer(context, layer);
  }
}

function keyOf(view) {
  return [view.scale, view.drawing.width, view.drawing.height, colour("wall")].join();
}
