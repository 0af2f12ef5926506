// The local map with what the sensors see now, forward up: sonar cones, infra-red rays and the walls (Figure 2).

import { Drawing, channels, colour, polyline, robotGlyph } from "./canvas.js";
import { inflate, unpackCurves } from "./frame.js";

const DENSE = 64; // beams of one sensor above which each is drawn faintly

export class LocalView {
  constructor(canvas) {
    this.cells = new OffscreenCanvas(1, 1);
    this.frame = null;
    this.occupancy = null;
    this.curves = [];
    this.drawing = new Drawing(canvas, (...args) => this.draw(...args));
  }

  /** Take over a frame of topic `local`. */
  async show(frame) {
    this.curves = unpackCurves(frame.arrays.points, frame.arrays.lengths, frame.header.scale);
    this.occupancy = await inflate(frame.arrays.cells.values);
    this.frame = frame;
    this.drawing.request();
  }

  paintCells() {
    const values = this.occupancy;
    const [height, width] = this.frame.header.shape;
    if (this.cells.width !== width || this.cells.height !== height) this.cells = new OffscreenCanvas(width, height);
    const shades = shadesOfOccupancy();
    const image = new ImageData(width, height);
    const pixels = new Uint32Array(image.data.buffer);
    for (let cell = 0; cell < values.length; cell++) pixels[cell] = shades[values[cell]];
    this.cells.getContext("2d").putImageData(image, 0, 0);
  }

  draw(context, width, height) {
    if (!this.frame) return;
    this.paintCells();
    const { resolution, origin, odometry } = this.frame.header;
    const reach = 0.5 * this.cells.width * resolution;
    context.translate(width / 2, (height - 22) / 2);
    const scale = (Math.max(60, Math.min(width, height - 26)) / (2 * reach)) * 0.99;
    context.scale(scale, -scale);
    context.rotate(Math.PI / 2);
    context.save();
    context.beginPath();
    context.arc(0, 0, reach, 0, 7);
    context.clip();
    context.save();
    context.rotate(-odometry[2]);
    context.translate(origin[0] - odometry[0], origin[1] - odometry[1]);
    context.imageSmoothingEnabled = false;
    context.drawImage(this.cells, 0, 0, 2 * reach, 2 * reach);
    context.restore();
    this.drawCones(context, scale);
    this.drawRays(context, scale);
    this.drawWalls(context, scale);
    context.restore();
    const size = Math.max(1, 7 / (0.076 * scale));
    context.scale(size, size);
    robotGlyph(context, colour("robot"), colour("open"));
  }

  drawCones(context, scale) {
    const sonar = this.frame.header.beams.sonar;
    if (!sonar) return;
    context.fillStyle = context.strokeStyle = colour("sonar");
    context.lineWidth = 1.4 / scale;
    this.eachBeam("sonar", (bearing, x, y, range) => {
      context.beginPath();
      context.moveTo(x, y);
      context.arc(x, y, range, bearing - sonar.half_angle, bearing + sonar.half_angle);
      context.closePath();
      context.globalAlpha = 0.17;
      context.fill();
      context.globalAlpha = 0.8;
      context.beginPath();
      context.arc(x, y, range, bearing - sonar.half_angle, bearing + sonar.half_angle);
      context.stroke();
    });
    context.globalAlpha = 1;
  }

  drawRays(context, scale) {
    for (const sensor of ["infrared", "laser"]) {
      if (!this.frame.header.beams[sensor]) continue;
      context.strokeStyle = context.fillStyle = colour("infrared");
      const isDense = this.frame.arrays[`${sensor}.ranges`].values.length > DENSE;
      context.lineWidth = (isDense ? 1 : 2) / scale;
      this.eachBeam(sensor, (bearing, x, y, range) => {
        const end = [x + range * Math.cos(bearing), y + range * Math.sin(bearing)];
        context.globalAlpha = isDense ? 0.07 : 1; // many rays make a patch that the map shines through
        polyline(context, [[x, y], end]);
        context.globalAlpha = 1;
        context.beginPath();
        context.arc(end[0], end[1], (isDense ? 1.2 : 3.2) / scale, 0, 7);
        context.fill();
      });
    }
  }

  drawWalls(context, scale) {
    context.strokeStyle = colour("steering");
    for (const [width, alpha] of [[11, 0.22], [2.6, 0.95]]) {
      context.lineWidth = width / scale;
      context.globalAlpha = alpha;
      for (const curve of this.curves) polyline(context, curve);
    }
    context.globalAlpha = 1;
  }

  /** Call `visit(bearing, x, y, range)` with the sensor's face for every beam that came back. */
  eachBeam(sensor, visit) {
    const { arrays } = this.frame;
    const [bearings, offsets, ranges] = ["bearings", "offsets", "ranges"].map((name) => arrays[`${sensor}.${name}`].values);
    ranges.forEach((range, beam) => {
      if (!Number.isFinite(range)) return;
      visit(bearings[beam], offsets[beam] * Math.cos(bearings[beam]), offsets[beam] * Math.sin(bearings[beam]), range);
    });
  }
}

/** One packed colour for each occupancy of 0 to 255: free, unknown in the middle, occupied. */
function shadesOfOccupancy() {
  const [floor, unknown, occupied] = ["floor", "unknown", "occupied"].map(channels);
  return Uint32Array.from({ length: 256 }, (_, value) => {
    const share = Math.abs(value - 127.5) / 127.5;
    const side = value > 127.5 ? occupied : floor;
    const [red, green, blue] = unknown.map((level, k) => Math.round(level + (side[k] - level) * share));
    return 0xff000000 | (blue << 16) | (green << 8) | red;
  });
}
