// The vector field histogram, forward up: densities, valleys as coloured arcs on the grey circle, green arrow to the
// objective, dashed red arrow in the commanded direction (Figure 3).

import { Drawing, arrow, colour } from "./canvas.js";

const DASHES = [7, 7]; // pixels, of the commanded arrow: not by its colour alone is it told from the objective's

export class HistogramView {
  constructor(canvas) {
    this.frame = null;
    this.drawing = new Drawing(canvas, (...args) => this.draw(...args));
  }

  /** Take over a frame of topic `histogram`. */
  show(frame) {
    this.frame = frame;
    this.drawing.request();
  }

  draw(context, width, height) {
    if (!this.frame) return;
    const radius = Math.max(60, 0.5 * Math.min(width, height - 26) - 8);
    context.translate(width / 2, (height - 26) / 2 + 2);
    context.scale(1, -1);
    context.rotate(Math.PI / 2);
    this.drawDensities(context, radius - 12);
    this.drawValleys(context, radius);
    const { goal, steering } = this.frame.header;
    if (goal !== null) this.drawArrow(context, goal, radius - 22, "goal", 5, []);
    if (steering !== null) this.drawArrow(context, steering, radius - 40, "steering", 3.5, DASHES);
    context.fillStyle = colour("robot");
    context.beginPath();
    context.arc(0, 0, 7, 0, 7);
    context.fill();
  }

  drawDensities(context, radius) {
    const { threshold } = this.frame.header;
    const densities = this.frame.arrays.densities.values;
    const half = Math.PI / densities.length;
    densities.forEach((density, sector) => {
      const share = density / (density + threshold);
      const bearing = (2 * Math.PI * sector) / densities.length;
      context.fillStyle = colour(density >= threshold ? "occupied" : "muted");
      context.globalAlpha = density >= threshold ? 0.75 : 0.45;
      context.beginPath();
      context.moveTo(0, 0);
      context.arc(0, 0, Math.max(0.5, share * radius), bearing - half, bearing + half);
      context.fill();
    });
    context.globalAlpha = 1;
    context.strokeStyle = colour("muted");
    context.lineWidth = 1;
    context.setLineDash([3, 4]);
    context.beginPath();
    context.arc(0, 0, radius / 2, 0, 7);
    context.stroke();
    context.setLineDash([]);
  }

  drawValleys(context, radius) {
    context.lineWidth = 7;
    context.lineCap = "butt";
    context.strokeStyle = colour("line");
    context.beginPath();
    context.arc(0, 0, radius, 0, 7);
    context.stroke();
    this.frame.header.valleys.forEach(([start, end], index) => {
      context.strokeStyle = colour(`valley-${(index % 4) + 1}`);
      context.beginPath();
      context.arc(0, 0, radius, start, end);
      context.stroke();
    });
    context.lineCap = "round";
  }

  drawArrow(context, bearing, length, name, width, dashes) {
    context.strokeStyle = context.fillStyle = colour(name);
    context.lineWidth = width;
    context.setLineDash(dashes); // the head is filled either way
    arrow(context, length * Math.cos(bearing), length * Math.sin(bearing), 14);
    context.setLineDash([]);
  }
}
