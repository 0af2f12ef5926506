// The best map: walls, path, particles and the robot, with pan, zoom and follow; a click proposes a goal.

import { Drawing, colour, polyline, robotGlyph } from "./canvas.js";
import { rows, unpackCurves } from "./frame.js";
import { MapLayer, dot } from "./map_layer.js";

const MIN_SCALE = 4; // pixels per metre
const MAX_SCALE = 400;
const CLICK_SLACK = 6; // pixels that a click may move

export class MapView {
  constructor(canvas, onPlace) {
    this.canvas = canvas;
    this.onPlace = onPlace; // called with [x, y] in the world
    this.scale = 70;
    this.centre = [0, 0];
    this.isFollowing = true;
    this.pose = null;
    this.goal = null;
    this.candidate = null;
    this.here = []; // wall curves seen now, robot frame
    this.map = null;
    this.layer = new MapLayer();
    this.pointers = new Map();
    this.drawing = new Drawing(canvas, (...args) => this.draw(...args));
    this.listen();
  }

  /** Take over a frame of topic `map`. */
  show({ header, arrays }) {
    const curves = unpackCurves(arrays.points, arrays.lengths, header.scale, header.origin);
    const walls = new Path2D();
    for (const curve of curves) {
      curve.forEach(([x, y], index) => (index ? walls.lineTo(x, y) : walls.moveTo(x, y)));
    }
    const path = rows(arrays.path);
    this.map = { walls, curves, path, particles: arrays.particles, profile: arrays.profile.values };
    this.layer.forget();
    this.drawing.request();
  }

  /** Take over a frame of topic `pose`. */
  move({ header }) {
    this.pose = header.pose;
    this.goal = header.goal;
    if (this.isFollowing) this.centre = [header.pose[0], header.pose[1]];
    this.drawing.request();
  }

  /** Show what the robot sees now; curves in its own frame. */
  see(curves) {
    this.here = curves;
  }

  propose(place) {
    this.candidate = place;
    this.drawing.request();
  }

  follow(isFollowing) {
    this.isFollowing = isFollowing;
    if (isFollowing && this.pose) this.centre = this.pose.slice(0, 2);
    this.canvas.dispatchEvent(new CustomEvent("follow", { detail: isFollowing }));
    this.drawing.request();
  }

  /** Show the whole map. */
  fit() {
    const points = [...(this.map?.curves.flat() ?? []), ...(this.map?.path ?? []), this.pose ?? [0, 0]];
    const xs = points.map((point) => point[0]);
    const ys = points.map((point) => point[1]);
    const low = [xs.reduce((a, b) => Math.min(a, b)), ys.reduce((a, b) => Math.min(a, b))];
    const high = [xs.reduce((a, b) => Math.max(a, b)), ys.reduce((a, b) => Math.max(a, b))];
    this.follow(false);
    this.centre = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
    const { width, height } = this.drawing;
    this.scale = clampScale(0.86 * Math.min(width / (high[0] - low[0] + 1), height / (high[1] - low[1] + 1)));
  }

  zoom(factor, x = this.drawing.width / 2, y = this.drawing.height / 2) {
    const before = this.toWorld(x, y);
    this.scale = clampScale(this.scale * factor);
    if (!this.isFollowing) {
      const after = this.toWorld(x, y);
      this.centre = [this.centre[0] + before[0] - after[0], this.centre[1] + before[1] - after[1]];
    }
    this.drawing.request();
  }

  toWorld(x, y) {
    const { width, height } = this.drawing;
    return [this.centre[0] + (x - width / 2) / this.scale, this.centre[1] - (y - height / 2) / this.scale];
  }

  toScreen([x, y]) {
    const { width, height } = this.drawing;
    return [width / 2 + (x - this.centre[0]) * this.scale, height / 2 - (y - this.centre[1]) * this.scale];
  }

  listen() {
    const canvas = this.canvas;
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0016)), event.offsetX, event.offsetY);
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, { x: event.offsetX, y: event.offsetY, moved: 0 });
    });
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    canvas.addEventListener("pointerup", (event) => {
      const pointer = this.pointers.get(event.pointerId);
      const isClick = pointer && pointer.moved < CLICK_SLACK && this.pointers.size === 1 && event.button === 0;
      this.pointers.delete(event.pointerId);
      canvas.classList.remove("dragging");
      if (isClick) this.onPlace(this.toWorld(event.offsetX, event.offsetY));
    });
    canvas.addEventListener("pointercancel", (event) => this.pointers.delete(event.pointerId));
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
      if (this.isFollowing) this.follow(false);
      this.canvas.classList.add("dragging");
      this.centre = [this.centre[0] - dx / this.scale, this.centre[1] + dy / this.scale];
      this.drawing.request();
    }
    [pointer.x, pointer.y] = [event.offsetX, event.offsetY];
  }

  draw(context, width, height) {
    this.layer.paint(context, this, this.map);
    context.save();
    context.translate(width / 2, height / 2);
    context.scale(this.scale, -this.scale);
    context.translate(-this.centre[0], -this.centre[1]);
    this.drawPresent(context);
    if (this.goal && this.pose) this.drawGoal(context);
    if (this.candidate) this.drawCandidate(context);
    if (this.pose) this.drawRobot(context);
    context.restore();
    this.drawScale(context, width, height);
  }

  /** The particles, and the way from the newest vertex to the robot. */
  drawPresent(context) {
    if (!this.map) return;
    const { path, particles } = this.map;
    const pixel = 1 / this.scale;
    context.fillStyle = colour("particle");
    context.globalAlpha = 0.55;
    for (const pose of rows(particles)) dot(context, pose, 2.1 * pixel);
    context.globalAlpha = 1;
    context.strokeStyle = colour("open");
    context.lineWidth = 2.4 * pixel;
    if (path.length && this.pose) polyline(context, [path.at(-1), this.pose]);
  }

  drawGoal(context) {
    const pixel = 1 / this.scale;
    context.strokeStyle = context.fillStyle = colour("goal");
    context.lineWidth = 2 * pixel;
    context.setLineDash([7 * pixel, 6 * pixel]);
    polyline(context, [this.pose, this.goal]);
    context.setLineDash([]);
    ring(context, this.goal, 10 * pixel);
    dot(context, this.goal, 4 * pixel);
  }

  drawCandidate(context) {
    const pixel = 1 / this.scale;
    context.strokeStyle = colour("goal");
    context.lineWidth = 2.5 * pixel;
    context.setLineDash([4 * pixel, 4 * pixel]);
    ring(context, this.candidate, 11 * pixel);
    context.setLineDash([]);
    const [x, y] = this.candidate;
    polyline(context, [[x - 5 * pixel, y], [x + 5 * pixel, y]]);
    polyline(context, [[x, y - 5 * pixel], [x, y + 5 * pixel]]);
  }

  drawRobot(context) {
    context.save();
    context.translate(this.pose[0], this.pose[1]);
    context.rotate(this.pose[2]);
    context.strokeStyle = colour("steering");
    context.lineWidth = Math.max(2.6 / this.scale, 0.03);
    context.globalAlpha = 0.75;
    for (const curve of this.here) polyline(context, curve);
    context.globalAlpha = 1;
    const size = Math.max(1, 12 / (0.076 * this.scale));
    context.scale(size, size);
    robotGlyph(context, colour("robot"), colour("open"));
    context.restore();
  }

  drawScale(context, width, height) {
    const metres = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20].findLast((length) => length * this.scale < 110) ?? 0.1;
    const length = metres * this.scale;
    context.strokeStyle = context.fillStyle = colour("muted");
    context.lineWidth = 2;
    polyline(context, [[width - 16 - length, height - 20], [width - 16 - length, height - 15],
      [width - 16, height - 15], [width - 16, height - 20]]);
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText(`${metres} m`, width - 16 - length / 2, height - 22);
  }
}

function clampScale(scale) {
  return Math.min(MAX_SCALE, Math.max(MIN_SCALE, scale));
}

function ring(context, [x, y], radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
  context.stroke();
}
