// A saved map to be looked at: walls, path, its own axes, named places, and another map laid over it.

import { arrow, channels, colour, polyline } from "./canvas.js";
import { drawName } from "./labels.js";
import { compose, inverse, transform } from "./pose.js";
import { Viewport, closenessOf } from "./viewport.js";

const UNSURE = 0.5; // m of spread at which the path has fully the colour of an open one
const STEP = 60; // pixels that an arrow key moves the plan
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class Plan extends Viewport {
  constructor(canvas, onPlace) {
    super(canvas);
    canvas.addEventListener("keydown", (event) => this.press(event));
    this.onPlace = onPlace; // called with [x, y] in the map's frame while `isPlacing`
    this.isPlacing = false;
    this.clear();
  }

  clear() {
    this.map = null; // { path, settled, walls, box } in the frame that it was loaded in
    this.other = null; // the same of another map
    this.loaded = [0, 0, 0]; // that frame, in the robot's world
    this.frame = [0, 0, 0]; // the map's frame now, likewise
    this.otherPose = [0, 0, 0]; // of the other map's frame in the one that this was loaded in
    this.labels = [];
  }

  /** Take a map's document (map.json), which was made in `frame`. */
  take(content, frame) {
    this.map = drawable(content);
    this.closeness = closenessOf(content.robot);
    this.loaded = this.frame = frame;
    this.other = null;
    this.fit();
  }

  /** The map's axes stand elsewhere now. */
  turn(frame, labels) {
    this.frame = frame;
    this.labels = labels;
    this.drawing.request();
  }

  /** Lay another map's document over it, whose frame stands at `pose` in this one's; null takes it away. */
  overlay(content, pose) {
    this.other = content && drawable(content);
    if (content) this.otherPose = compose(inverse(this.shift), pose);
    this.fit();
  }

  /** Where the frame that the map was loaded in stands in its frame of now. */
  get shift() {
    return compose(inverse(this.frame), this.loaded);
  }

  fit() {
    if (!this.map) return;
    const corners = cornersOf(this.map.box).map((corner) => transform(this.shift, corner));
    if (this.other) corners.push(...cornersOf(this.other.box).map((corner) => transform(compose(this.shift, this.otherPose), corner)));
    const [xs, ys] = [corners.map(([x]) => x), corners.map(([, y]) => y)];
    this.show([Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)]);
  }

  click(place) {
    if (this.isPlacing) this.onPlace(place);
  }

  /** Keys of a focused plan move it, and never the robot. */
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

  /** Clicks choose a place; the keyboard's is the middle, under a cross. */
  choose(isPlacing) {
    this.isPlacing = isPlacing;
    this.canvas.classList.toggle("choosing", isPlacing);
    this.drawing.request();
  }

  paint(context, pixel) {
    if (!this.map) return;
    drawGrid(context, pixel, this);
    context.save();
    enter(context, this.shift);
    drawWalls(context, this.map, pixel, this.other ? ["settled", 4.2, 0.5] : ["wall", 1.8, 0.6]);
    if (!this.other) drawPath(context, this.map, pixel);
    if (this.other) {
      enter(context, this.otherPose);
      drawWalls(context, this.other, pixel, ["open", 1.6, 0.85]);
    }
    context.restore();
    drawAxes(context, pixel);
    for (const { text, x, y } of this.labels) drawName(context, pixel, text, x, y);
    if (this.isPlacing) drawCross(context, pixel, this.centre);
  }
}

function drawable({ path, walls, settled, spread }) {
  const lines = new Path2D();
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  const reach = (x, y) => {
    [box[0], box[1]] = [Math.min(box[0], x), Math.min(box[1], y)];
    [box[2], box[3]] = [Math.max(box[2], x), Math.max(box[3], y)];
  };
  for (const curve of walls) {
    curve.forEach(([x, y], index) => {
      reach(x, y);
      if (index) lines.lineTo(x, y);
      else lines.moveTo(x, y);
    });
  }
  for (const [x, y] of path) reach(x, y);
  return { path, settled, spread, walls: lines, box };
}

function cornersOf([left, bottom, right, top]) {
  return [[left, bottom], [right, bottom], [right, top], [left, top]];
}

function enter(context, [x, y, theta]) {
  context.translate(x, y);
  context.rotate(theta);
}

function drawWalls(context, { walls }, pixel, [tint, width, alpha]) {
  context.strokeStyle = colour(tint);
  context.lineWidth = width * pixel;
  context.globalAlpha = alpha;
  context.stroke(walls);
  context.globalAlpha = 1;
}

/** From settled to open, by how far the particles lie apart at a vertex; where that is not known, by what is settled. */
function drawPath(context, { path, settled, spread }, pixel) {
  const isOpen = (vertex) => (spread.length ? Math.min(1, spread[vertex] / UNSURE) : Number(vertex >= settled));
  const [from, to] = [channels("settled"), channels("open")];
  context.lineWidth = 2.2 * pixel;
  for (let vertex = 1; vertex < path.length; vertex++) {
    const levels = from.map((level, k) => Math.round(level + (to[k] - level) * isOpen(vertex)));
    context.strokeStyle = `rgb(${levels.join(" ")})`;
    polyline(context, [path[vertex - 1], path[vertex]]);
  }
}

function drawGrid(context, pixel, view) {
  const [left, top] = view.toWorld(0, 0);
  const [right, bottom] = view.toWorld(view.drawing.width, view.drawing.height);
  const step = view.scale > 220 ? 0.1 : view.scale > 22 ? 1 : view.scale > 7 ? 5 : 10;
  context.strokeStyle = colour("line");
  context.lineWidth = pixel;
  context.globalAlpha = 0.65;
  for (let x = Math.ceil(left / step) * step; x <= right; x += step) polyline(context, [[x, bottom], [x, top]]);
  for (let y = Math.ceil(bottom / step) * step; y <= top; y += step) polyline(context, [[left, y], [right, y]]);
  context.globalAlpha = 1;
}

/** The map's own axes: x points right, y up. */
function drawAxes(context, pixel) {
  const length = 46 * pixel;
  context.strokeStyle = context.fillStyle = colour("goal");
  context.lineWidth = 2.4 * pixel;
  arrow(context, length, 0, 9 * pixel);
  arrow(context, 0, length, 9 * pixel);
  context.beginPath();
  context.arc(0, 0, 3.5 * pixel, 0, 7);
  context.fill();
  context.save();
  context.scale(pixel, -pixel);
  context.font = "600 12px system-ui, sans-serif";
  context.fillText("x", 50, 4);
  context.fillText("y", -3, -52);
  context.restore();
}

function drawCross(context, pixel, [x, y]) {
  context.strokeStyle = colour("goal");
  context.lineWidth = 1.5 * pixel;
  for (const [dx, dy] of [[12, 0], [0, 12]]) {
    polyline(context, [[x - dx * pixel, y - dy * pixel], [x + dx * pixel, y + dy * pixel]]);
  }
}
