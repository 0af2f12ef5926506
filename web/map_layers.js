// The map panel's own layers, from the floor's grid up to the robot.

import { channels, colour, dot, polyline, ring, robotGlyph } from "./canvas.js";
import { rows, unpackCurves } from "./frame.js";
import { layer } from "./layers.js";

const UNSURE = 0.5; // m of spread at which the path has fully the colour of an open one
const SHADES = 16; // of the path's colour

layer("grid", { label: "Grid", z: 0, topic: null, isStill: true, draw: drawGrid });
layer("walls", { label: "Walls", z: 10, topic: "path", isStill: true, suits: (has) => !has("raw_path"), draw: drawWalls });
layer("odometry", { label: "Path by the wheels alone", z: 15, isOn: false, isStill: true, draw: drawOdometry });
layer("path", { label: "Path, by certainty", z: 20, isStill: true, draw: drawPath });
layer("tail", { z: 25, topic: "pose", draw: drawTail });
layer("particles", { label: "Particles", z: 30, draw: drawParticles });
layer("now", { label: "Walls seen now", z: 40, topic: "local", draw: drawNow });
layer("goal", { z: 50, topic: "pose", draw: drawGoal });
layer("robot", { z: 60, topic: "pose", draw: drawRobot });
layer("candidate", { z: 70, topic: null, draw: drawCandidate });

function drawGrid(context, { scale, pixel, bounds: [left, bottom, right, top] }) {
  const step = scale > 220 ? 0.1 : scale > 22 ? 1 : scale > 7 ? 5 : 10;
  context.strokeStyle = colour("line");
  context.lineWidth = pixel;
  context.globalAlpha = 0.65;
  context.beginPath();
  for (let x = Math.ceil(left / step) * step; x <= right; x += step) {
    context.moveTo(x, bottom);
    context.lineTo(x, top);
  }
  for (let y = Math.ceil(bottom / step) * step; y <= top; y += step) {
    context.moveTo(left, y);
    context.lineTo(right, y);
  }
  context.stroke();
}

function drawWalls(context, view) {
  context.strokeStyle = colour("wall");
  context.globalAlpha = 0.55;
  context.lineWidth = Math.max(1.7 * view.pixel, 0.018);
  view.walls.stroke(context, view.map.path, view.bounds);
}

/** From settled to open: by how far the particles lie apart at a vertex, or else by how many paths there still are. */
function drawPath(context, { map: { path, profile, spread }, pixel, scale }) {
  const isOpen = (vertex) => (spread.length ? Math.min(1, spread[vertex] / UNSURE) : Math.sqrt(profile[vertex]));
  const shades = Array.from({ length: SHADES }, () => [new Path2D(), new Path2D()]);
  path.forEach(([x, y], vertex) => {
    const [line, dots] = shades[Math.round((SHADES - 1) * isOpen(vertex))];
    if (vertex) line.moveTo(path[vertex - 1][0], path[vertex - 1][1]);
    if (vertex) line.lineTo(x, y);
    dots.moveTo(x, y);
    dots.arc(x, y, 2.6 * pixel, 0, 7);
  });
  const ends = [channels("settled"), channels("open")];
  context.lineWidth = 2.4 * pixel;
  shades.forEach(([line, dots], shade) => {
    context.strokeStyle = context.fillStyle = mix(ends, shade / (SHADES - 1));
    context.stroke(line);
    if (scale > 24) context.fill(dots);
  });
  context.fillStyle = colour("settled");
  if (path.length) dot(context, path[0], 5 * pixel);
}

/** Dashed: what the map would hang on if nothing had been corrected. */
function drawOdometry(context, { pixel }, { header: { origin, scale }, arrays: { points } }) {
  context.strokeStyle = colour("muted");
  context.lineWidth = 1.6 * pixel;
  context.setLineDash([7 * pixel, 5 * pixel]);
  polyline(context, rows(points).map(([x, y]) => [origin[0] + scale * x, origin[1] + scale * y]));
  context.setLineDash([]);
}

/** The way from the newest vertex to the robot. */
function drawTail(context, { map, pixel, frames: { clusters } }, { header: { pose } }) {
  if (!map?.path.length || (clusters && !clusters.arrays.shares.values.length)) return;
  context.strokeStyle = colour("open");
  context.lineWidth = 2.4 * pixel;
  polyline(context, [map.path.at(-1), pose]);
}

/** The terminal distribution; with headings, where they are told. */
function drawParticles(context, { pixel }, { header: { origin, scale }, arrays: { points, headings } }) {
  context.fillStyle = context.strokeStyle = colour("particle");
  context.globalAlpha = 0.55;
  context.lineWidth = 1.2 * pixel;
  context.beginPath();
  rows(points).forEach(([x, y], row) => {
    const place = [origin[0] + scale * x, origin[1] + scale * y];
    if (headings) {
      const heading = (headings.values[row] * Math.PI) / 128;
      context.moveTo(...place);
      context.lineTo(place[0] + 9 * pixel * Math.cos(heading), place[1] + 9 * pixel * Math.sin(heading));
    }
    context.moveTo(place[0] + 2.1 * pixel, place[1]);
    context.arc(...place, 2.1 * pixel, 0, 7);
  });
  context.fill();
  if (headings) context.stroke();
}

function drawNow(context, { pose, pixel }, { header, arrays }) {
  if (!pose) return;
  standAt(context, pose);
  context.strokeStyle = colour("steering");
  context.lineWidth = Math.max(2.6 * pixel, 0.03);
  context.globalAlpha = 0.75;
  for (const curve of unpackCurves(arrays.points, arrays.lengths, header.scale)) polyline(context, curve);
}

function drawGoal(context, { pixel }, { header: { goal } }) {
  if (!goal) return;
  context.strokeStyle = context.fillStyle = colour("goal");
  context.lineWidth = 2 * pixel;
  ring(context, goal, 10 * pixel);
  dot(context, goal, 4 * pixel);
}

/** Faint where it may be elsewhere, and not at all while it may be anywhere. */
function drawRobot(context, { scale, frames: { clusters } }, { header: { pose } }) {
  if (clusters && !clusters.arrays.shares.values.length) return;
  if (clusters && !clusters.header.is_localized) context.globalAlpha = 0.4;
  standAt(context, pose);
  const size = Math.max(1, 12 / (0.076 * scale));
  context.scale(size, size);
  robotGlyph(context, colour("robot"), colour("open"));
}

/** Where a click proposes to drive. */
function drawCandidate(context, { candidate, pixel }) {
  if (!candidate) return;
  context.strokeStyle = colour("goal");
  context.lineWidth = 2.5 * pixel;
  context.setLineDash([4 * pixel, 4 * pixel]);
  ring(context, candidate, 11 * pixel);
  context.setLineDash([]);
  const [x, y] = candidate;
  polyline(context, [[x - 5 * pixel, y], [x + 5 * pixel, y]]);
  polyline(context, [[x, y - 5 * pixel], [x, y + 5 * pixel]]);
}

function standAt(context, [x, y, theta]) {
  context.translate(x, y);
  context.rotate(theta);
}

/** A colour between two, by a share of 0 to 1. */
function mix([from, to], share) {
  return `rgb(${from.map((level, k) => Math.round(level + (to[k] - level) * share)).join(" ")})`;
}
