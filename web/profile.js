// The profile of the particles' tree: nodes at each vertex per particle. Where it is flat on the floor the path is settled.

import { Drawing, colour, polyline } from "./canvas.js";

const LEFT = 44;
const BOTTOM = 26;
const TOP = 8;

export class ProfileView {
  constructor(canvas) {
    this.profile = new Float32Array(0);
    this.fixedDepth = 0;
    this.drawing = new Drawing(canvas, (...args) => this.draw(...args));
  }

  /** Take over a frame of topic `path`. */
  show({ header, arrays }) {
    this.profile = arrays.profile.values;
    this.fixedDepth = header.fixed_depth;
    this.drawing.request();
  }

  draw(context, width, height) {
    const n = this.profile.length;
    const right = width - 16;
    const floor = height - BOTTOM;
    const x = (vertex) => LEFT + ((right - LEFT) * vertex) / Math.max(1, n - 1);
    const y = (share) => floor - (floor - TOP) * Math.sqrt(Math.min(1, share));
    this.drawAxes(context, { right, floor, x, y, n });
    if (n < 2) return;
    const points = Array.from(this.profile, (share, vertex) => [x(vertex), y(share)]);
    context.fillStyle = colour("settled");
    context.globalAlpha = 0.13;
    context.fillRect(LEFT, TOP, x(this.fixedDepth) - LEFT, floor - TOP);
    context.fillStyle = colour("open");
    context.globalAlpha = 0.25;
    context.beginPath();
    context.moveTo(LEFT, floor);
    for (const point of points) context.lineTo(...point);
    context.lineTo(right, floor);
    context.fill();
    context.globalAlpha = 1;
    context.lineWidth = 2.2;
    context.strokeStyle = colour("open");
    polyline(context, points.slice(this.fixedDepth));
    context.strokeStyle = colour("settled");
    polyline(context, points.slice(0, this.fixedDepth + 1));
    context.lineWidth = 1.5;
    context.setLineDash([4, 4]);
    polyline(context, [[x(this.fixedDepth), TOP], [x(this.fixedDepth), floor]]);
    context.setLineDash([]);
  }

  drawAxes(context, { right, floor, x, y, n }) {
    context.font = "11px system-ui, sans-serif";
    context.fillStyle = colour("muted");
    context.strokeStyle = colour("line");
    context.lineWidth = 1;
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const share of [0, 0.1, 0.5, 1]) {
      polyline(context, [[LEFT, y(share)], [right, y(share)]]);
      context.fillText(String(share), LEFT - 7, y(share));
    }
    context.textAlign = "center";
    context.textBaseline = "top";
    const step = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find((size) => n / size <= 9) ?? 2000;
    for (let vertex = 0; vertex < n; vertex += step) context.fillText(String(vertex), x(vertex), floor + 6);
    if (n > 1) return;
    context.textBaseline = "middle";
    context.fillText("grows with every half metre", (LEFT + right) / 2, (TOP + floor) / 2);
  }
}
