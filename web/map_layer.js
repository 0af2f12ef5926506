// What of the map stays as it is until it changes: grid, walls and path, kept as a picture somewhat larger than the panel,
// so that following the robot only moves it.

import { channels, colour, polyline } from "./canvas.js";

const MARGIN = 0.3; // of the panel's size, beyond each edge

export class MapLayer {
  constructor() {
    this.picture = null;
    this.key = "";
    this.centre = [0, 0];
  }

  forget() {
    this.picture = null;
  }

  /** Put the picture of `map` (or of nothing) under a view, drawing it first if need be. */
  paint(context, view, map) {
    const { width, height } = view.drawing;
    if (!this.isGood(view)) this.draw(view, map);
    const x = (this.centre[0] - view.centre[0]) * view.scale - MARGIN * width;
    const y = (view.centre[1] - this.centre[1]) * view.scale - MARGIN * height;
    context.drawImage(this.picture, x, y, (1 + 2 * MARGIN) * width, (1 + 2 * MARGIN) * height);
  }

  isGood(view) {
    const { width, height } = view.drawing;
    if (!this.picture || this.key !== keyOf(view)) return false;
    const [x, y] = [this.centre[0] - view.centre[0], this.centre[1] - view.centre[1]];
    return Math.abs(x) * view.scale < MARGIN * width && Math.abs(y) * view.scale < MARGIN * height;
  }

  draw(view, map) {
    const { width, height } = view.drawing;
    const pixels = devicePixelRatio || 1;
    const [wide, high] = [(1 + 2 * MARGIN) * width, (1 + 2 * MARGIN) * height];
    this.picture = new OffscreenCanvas(Math.max(1, Math.round(wide * pixels)), Math.max(1, Math.round(high * pixels)));
    this.key = keyOf(view);
    this.centre = [...view.centre];
    const context = this.picture.getContext("2d");
    context.scale(pixels, pixels);
    context.translate(MARGIN * width, MARGIN * height);
    context.lineCap = context.lineJoin = "round";
    drawGrid(context, view, [-MARGIN * width, -MARGIN * height], [(1 + MARGIN) * width, (1 + MARGIN) * height]);
    context.translate(width / 2, height / 2);
    context.scale(view.scale, -view.scale);
    context.translate(-view.centre[0], -view.centre[1]);
    if (map) drawMap(context, view.scale, map);
  }
}

function keyOf(view) {
  return [view.scale, view.drawing.width, view.drawing.height, colour("wall")].join();
}

function drawGrid(context, view, [left, top], [right, bottom]) {
  const step = view.scale > 22 ? 1 : view.scale > 7 ? 5 : 10;
  const [west, north] = view.toWorld(left, top);
  const [east, south] = view.toWorld(right, bottom);
  context.strokeStyle = colour("line");
  context.lineWidth = 1;
  context.globalAlpha = 0.65;
  context.beginPath();
  for (let x = Math.ceil(west / step) * step; x <= east; x += step) {
    const column = Math.round(view.toScreen([x, 0])[0]) + 0.5;
    context.moveTo(column, top);
    context.lineTo(column, bottom);
  }
  for (let y = Math.ceil(south / step) * step; y <= north; y += step) {
    const row = Math.round(view.toScreen([0, y])[1]) + 0.5;
    context.moveTo(left, row);
    context.lineTo(right, row);
  }
  context.stroke();
  context.globalAlpha = 1;
}

/** The path's colour goes from settled to open with the share of particles that still differ at a vertex. */
function drawMap(context, scale, { walls, path, profile }) {
  const pixel = 1 / scale;
  context.strokeStyle = colour("wall");
  context.globalAlpha = 0.55;
  context.lineWidth = Math.max(1.7 * pixel, 0.018);
  context.stroke(walls);
  context.globalAlpha = 1;
  context.lineWidth = 2.4 * pixel;
  const shades = [channels("settled"), channels("open")];
  path.forEach((pose, vertex) => {
    context.strokeStyle = context.fillStyle = mix(shades, Math.sqrt(profile[vertex]));
    if (vertex > 0) polyline(context, [path[vertex - 1], pose]);
    if (scale > 24) dot(context, pose, 2.6 * pixel);
  });
  context.fillStyle = colour("settled");
  if (path.length) dot(context, path[0], 5 * pixel);
}

/** A colour between two, by a share of 0 to 1. */
function mix([from, to], share) {
  return `rgb(${from.map((level, k) => Math.round(level + (to[k] - level) * share)).join(" ")})`;
}

export function dot(context, [x, y], radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
  context.fill();
}
