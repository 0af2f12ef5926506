// What the map shows of a robot that runs by itself and feels its way: the map so far, where it may bump, its movements
// added end to end, its bumper at each bump, and the places where it may be.

import { arrow, channels, colour, dot, polyline, write } from "./canvas.js";
import { inflate, rows, unpackCurves } from "./frame.js";
import { layer } from "./layers.js";

const DARKEST = 120; // of 255, how much of its colour the bump space has where a cart bumps at the most headings
const SIGMAS = 2; // that a place's ellipse reaches
const SMALLEST = 9; // pixels of its radius

layer("bump_space", { label: "Bump space", z: 5, isStill: true, draw: drawBumpSpace });
layer("map_so_far", { label: "Map so far", z: 10, isStill: true, draw: drawMap });
layer("raw_path", { label: "Raw path, end to end", z: 15, isStill: true, draw: drawRawPath });
layer("bars", { label: "Bumper at each bump", z: 17, isStill: true, topic: "path", suits: (has) => has("raw_path"), draw: drawBars });
layer("clusters", { label: "Places where it may be", z: 62, draw: drawClusters });

/** Curves in metres of a frame of topic `map_so_far`. */
export function curvesOf({ header, arrays }) {
  return unpackCurves(arrays.points, arrays.lengths, header.scale);
}

function drawMap(context, { pixel }, frame) {
  context.strokeStyle = colour("wall");
  context.lineWidth = 2.6 * pixel;
  for (const curve of curvesOf(frame)) polyline(context, curve);
}

const cells = new WeakMap(); // frame of the bump space -> its cells, once they are inflated
let painted = { frame: null, tint: "", canvas: null };

function drawBumpSpace(context, view, frame) {
  if (!cells.has(frame)) {
    cells.set(frame, null);
    inflate(frame.arrays.cells.values).then((values) => {
      cells.set(frame, values);
      view.renew();
    });
  }
  if (!cells.get(frame)) return;
  const tint = colour("sonar");
  if (painted.frame !== frame || painted.tint !== tint) painted = { frame, tint, canvas: paint(frame) };
  const { shape: [height, width], spacing, origin } = frame.header;
  context.drawImage(painted.canvas, origin[0] - spacing / 2, origin[1] - spacing / 2, width * spacing, height * spacing);
}

function paint(frame) {
  const { shape: [height, width], shades } = frame.header;
  const canvas = new OffscreenCanvas(width, height);
  const image = new ImageData(width, height);
  const tint = channels("sonar");
  cells.get(frame).forEach((shade, cell) => image.data.set([...tint, DARKEST * Math.sqrt(shade / shades)], 4 * cell));
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}

/** As the counters have it, nothing corrected; at each bump the bumper's left, middle and right point. */
function drawRawPath(context, { pixel }, { header: { scale }, arrays: { points, bumpers } }) {
  context.strokeStyle = context.fillStyle = colour("steering");
  context.globalAlpha = 0.75;
  context.lineWidth = 1.2 * pixel;
  polyline(context, rows(points).map(([x, y]) => [scale * x, scale * y]));
  for (const [x, y] of rows(bumpers)) dot(context, [scale * x, scale * y], 2.2 * pixel);
}

function drawBars(context, view) {
  context.strokeStyle = colour("valley-1");
  context.lineWidth = 3 * view.pixel;
  view.walls.stroke(context, view.map.path, view.bounds);
}

/** Two standard deviations of each place, its mean heading, and its share of the belief. */
function drawClusters(context, { pixel }, { arrays: { poses, shares, covariances } }) {
  const spreads = rows(covariances);
  context.strokeStyle = context.fillStyle = colour("goal");
  context.lineWidth = 2.2 * pixel;
  context.textAlign = "center";
  context.font = "650 13px system-ui, sans-serif";
  const written = []; // shares: one that would lie over a heavier one's is left out
  rows(poses).forEach(([x, y, heading], place) => {
    const [along, across, angle] = axesOf(spreads[place]).map((part, axis) => (axis < 2 ? Math.max(SMALLEST * pixel, SIGMAS * part) : part));
    context.save();
    context.translate(x, y);
    context.beginPath();
    context.ellipse(0, 0, along, across, angle, 0, 7);
    context.globalAlpha = 0.14;
    context.fill();
    context.globalAlpha = 1;
    context.stroke();
    arrow(context, 26 * pixel * Math.cos(heading), 26 * pixel * Math.sin(heading), 9 * pixel);
    context.restore();
    const below = [x, y - Math.min(across, along) - 18 * pixel];
    if (written.some((other) => Math.abs(other[0] - below[0]) < 44 * pixel && Math.abs(other[1] - below[1]) < 19 * pixel)) return;
    written.push(below);
    drawShare(context, below, pixel, `${Math.round(100 * shares.values[place])} %`);
  });
}

function drawShare(context, place, pixel, text) {
  const width = (context.measureText(text).width + 12) * pixel;
  context.save();
  context.fillStyle = colour("panel");
  context.globalAlpha = 0.85;
  context.beginPath();
  context.roundRect(place[0] - width / 2, place[1] - 5 * pixel, width, 19 * pixel, 6 * pixel);
  context.fill();
  context.restore();
  write(context, text, place, pixel);
}

/** Standard deviations along an ellipse's two axes, and the first one's direction, of a covariance xx, xy, yy. */
export function axesOf([xx, xy, yy]) {
  const [mean, half] = [(xx + yy) / 2, Math.hypot((xx - yy) / 2, xy)];
  return [Math.sqrt(Math.max(0, mean + half)), Math.sqrt(Math.max(0, mean - half)), 0.5 * Math.atan2(2 * xy, xx - yy)];
}
