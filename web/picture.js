// What of the map stays as it is until it changes, kept as a picture somewhat larger than the panel, so that following the
// robot only moves it.

import { colour } from "./canvas.js";

const MARGIN = 0.3; // of the panel's size, beyond each edge

export class Picture {
  constructor() {
    this.canvas = null;
    this.key = "";
    this.centre = [0, 0];
  }

  forget() {
    this.key = "";
  }

  /** Put the picture of a view's still `layers` under the view, drawing it first if need be. */
  paint(context, view, layers) {
    const { width, height } = view.drawing;
    if (!this.isGood(view)) this.draw(view, layers);
    const x = (this.centre[0] - view.centre[0]) * view.scale - MARGIN * width;
    const y = (view.centre[1] - this.centre[1]) * view.scale - MARGIN * height;
    context.drawImage(this.canvas, x, y, (1 + 2 * MARGIN) * width, (1 + 2 * MARGIN) * height);
  }

  isGood(view) {
    const { width, height } = view.drawing;
    if (this.key !== keyOf(view)) return false;
    const [x, y] = [this.centre[0] - view.centre[0], this.centre[1] - view.centre[1]];
    return Math.abs(x) * view.scale < MARGIN * width && Math.abs(y) * view.scale < MARGIN * height;
  }

  draw(view, layers) {
    const { width, height } = view.drawing;
    const pixels = devicePixelRatio || 1;
    const size = [width, height].map((length) => Math.max(1, Math.round((1 + 2 * MARGIN) * length * pixels)));
    if (this.canvas?.width !== size[0] || this.canvas?.height !== size[1]) this.canvas = new OffscreenCanvas(...size);
    this.key = keyOf(view);
    this.centre = [...view.centre];
    const context = this.canvas.getContext("2d");
    context.resetTransform();
    context.clearRect(0, 0, ...size);
    context.scale(pixels, pixels);
    context.lineCap = context.lineJoin = "round";
    context.translate((0.5 + MARGIN) * width, (0.5 + MARGIN) * height);
    context.scale(view.scale, -view.scale);
    context.translate(-view.centre[0], -view.centre[1]);
    const reach = [(0.5 + MARGIN) * width * view.pixel, (0.5 + MARGIN) * height * view.pixel];
    view.bounds = [view.centre[0] - reach[0], view.centre[1] - reach[1], view.centre[0] + reach[0], view.centre[1] + reach[1]];
    for (const layer of layers) view.drawLayer(context, layer);
  }
}

function keyOf(view) {
  return [view.scale, view.drawing.width, view.drawing.height, colour("wall")].join();
}
