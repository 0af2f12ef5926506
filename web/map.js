// The map panel: pan, zoom and follow, the newest frames, and the layers drawn from them; a click proposes a goal.

import { curvesOf } from "./felt_layers.js";
import { rows } from "./frame.js";
import { inOrder, onLayers } from "./layers.js";
import "./map_layers.js";
import { Picture } from "./picture.js";
import { Viewport } from "./viewport.js";
import { Walls } from "./walls.js";

export class MapView extends Viewport {
  constructor(canvas, connection, onPlace) {
    super(canvas);
    this.onPlace = onPlace; // called with [x, y] in the world
    this.scale = 70;
    this.isFollowing = true;
    this.isFitting = false; // whether all of the map is kept in view, as of a small one that nobody has moved yet
    this.candidate = null;
    this.picture = new Picture();
    this.drawn = 0; // pictures since the page was opened
    this.has = (topic) => topic in this.frames;
    this.clear();
    connection.addEventListener("frame", ({ detail }) => this.take(detail));
    onLayers(() => this.renew());
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
    if (this.isFitting && (topic === "path" || topic === "map_so_far")) this.fit();
    const shown = topic.startsWith("tile/") ? "path" : topic;
    const concerned = inOrder().filter((layer) => layer.isOn && layer.topic === shown && layer.suits(this.has));
    if (concerned.some((layer) => layer.isStill)) this.picture.forget();
    if (concerned.length) this.drawing.request();
  }

  /** The robot's pose in the newest picture. */
  get pose() {
    return this.frames.pose?.header.pose ?? null;
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
    this.isFitting = false;
    if (isFollowing && this.pose) this.centre = this.pose.slice(0, 2);
    this.canvas.dispatchEvent(new CustomEvent("follow", { detail: isFollowing }));
    this.drawing.request();
  }

  /** Show the whole map. */
  fit() {
    const { isFitting } = this;
    this.follow(false);
    this.isFitting = isFitting;
    const given = this.frames.map_so_far ? curvesOf(this.frames.map_so_far).flat() : [];
    const isAnywhere = this.frames.clusters?.arrays.shares.values.length === 0;
    const robot = isAnywhere && given.length ? given[0] : (this.pose ?? [0, 0]);
    this.show(around(this.walls.bounds(isAnywhere ? [] : (this.map?.path ?? []), robot), given));
  }

  /** Of a small robot all is looked at from so much nearer, and as a whole. */
  comeNear(closeness) {
    if (closeness === this.closeness) return;
    this.closeness = closeness;
    this.isFitting = closeness > 1;
    if (this.isFitting) this.fit();
  }

  /** Zoom about a point of the canvas, or about the robot while it is followed. */
  zoom(factor, x, y) {
    const { centre } = this;
    this.isFitting = false;
    super.zoom(factor, x, y);
    if (this.isFollowing) this.centre = centre;
  }

  move(right, up) {
    this.isFitting = false;
    if (this.isFollowing) this.follow(false);
    super.move(right, up);
  }

  click(place) {
    this.onPlace(place);
  }

  draw(context, width, height) {
    this.drawn++;
    this.layers = inOrder().filter(({ isOn, topic, suits }) => isOn && (topic === null || this.frames[topic]) && suits(this.has));
    this.picture.paint(context, this, this.layers.filter((layer) => layer.isStill));
    super.draw(context, width, height);
  }

  paint(context) {
    for (const layer of this.layers) if (!layer.isStill) this.drawLayer(context, layer);
  }

  drawLayer(context, { draw, topic }) {
    context.save();
    draw(context, this, this.frames[topic] ?? null);
    context.restore();
  }
}

/** A box [left, bottom, right, top] grown so that it holds places too. */
function around([left, bottom, right, top], places) {
  for (const [x, y] of places) [left, bottom, right, top] = [Math.min(left, x), Math.min(bottom, y), Math.max(right, x), Math.max(top, y)];
  return [left, bottom, right, top];
}
