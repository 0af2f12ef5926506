// The map panel: pan, zoom and follow, the newest frames, and the layers drawn from them; a click proposes a goal.

import { Drawing, colour, polyline } from "./canvas.js";
import { rows } from "./frame.js";
import { inOrder, onLayers } from "./layers.js";
import "./map_layers.js";
import { Picture } from "./picture.js";
import { Walls } from "./walls.js";

const MIN_SCALE = 4; // pixels per metre
const MAX_SCALE = 400;
const FIT_SCALE = 120; // of a map of one place
const CLICK_SLACK = 6; // pixels that a click may move

export class MapView {
  constructor(canvas, connection, onPlace) {
    this.canvas = canvas;
    this.onPlace = onPlace; // called with [x, y] in the world
    this.scale = 70;
    this.centre = [0, 0];
    this.isFollowing = true;
    this.candidate = null;
    this.picture = new Picture();
    this.pointers = new Map();
    this.drawn = 0; // pictures since the page was opened
    this.clear();
    this.drawing = new Drawing(canvas, (...args) => this.draw(...args));
    connection.addEventListener("frame", ({ detail }) => this.take(detail));
    onLayers(() => this.renew());
    this.listen();
  }

  /** What is to come is of another session or another connection. */
  clear() {
    this.frames = {}; // topic -> its newest frame
    this.map = null; // the best path, [x, y, theta] of each vertex, and how certain it is
    this.walls = new Walls();
    this.picture.forget();
  }

  /** Take over any frame of the stream. */
  take(frame) {
    const { topic, header } = frame;
    if (topic === "notice") {
      if (header.kind === "hello" || header.kind === "begin") this.clear();
      return;
    }
    this.frames[topic] = frame;
    if (topic === "path") this.map = { path: rows(frame.arrays.path), profile: frame.arrays.profile.values, spread: frame.arrays.spread.values };
    if (topic.startsWith("tile/")) this.walls.show(frame);
    if (topic === "pose" && this.isFollowing) this.centre = header.pose.slice(0, 2);
    const shown = topic.startsWith("tile/") ? "path" : topic;
    const concerned = inOrder().filter((layer) => layer.isOn && layer.topic === shown);
    if (concerned.some((layer) => layer.isStill)) this.picture.forget();
    if (concerned.length) this.drawing.request();
  }

  /** The robot's pose in the newest picture. */
  get pose() {
    return this.frames.pose?.header.pose ?? null;
  }

  /** The size of a pixel in metres. */
  get pixel() {
    return 1 / this.scale;
  }

  /** Draw everything anew. */
  renew() {
    this.picture.forget();
    this.drawing.request();
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
    const [left, bottom, right, top] = this.walls.bounds(this.map?.path ?? [], this.pose ?? [0, 0]);
    this.follow(false);
    this.centre = [(left + right) / 2, (bottom + top) / 2];
    const { width, height } = this.drawing;
    const filling = 0.86 * Math.min(width / (right - left + 1), height / (top - bottom + 1));
    this.scale = clampScale(Math.min(FIT_SCALE, filling));
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
    this.drawn++;
    const layers = inOrder().filter(({ isOn, topic }) => isOn && (topic === null || this.frames[topic]));
    this.picture.paint(context, this, layers.filter((layer) => layer.isStill));
    context.save();
    context.translate(width / 2, height / 2);
    context.scale(this.scale, -this.scale);
    context.translate(-this.centre[0], -this.centre[1]);
    for (const layer of layers) if (!layer.isStill) this.drawLayer(context, layer);
    context.restore();
    this.drawScale(context, width, height);
  }

  drawLayer(context, { draw, topic }) {
    context.save();
    draw(context, this, this.frames[topic] ?? null);
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
