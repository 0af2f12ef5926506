// The walls of the best map: tiles of what each vertex saw, in the vertex's own frame, put where the path has it now.

export class Walls {
  constructor() {
    this.clear();
  }

  /** Another session, or another connection: everything comes again. */
  clear() {
    this.seen = []; // for each vertex its curves, or undefined while they are under way
    this.count = 0; // curves
  }

  /** Take over a frame of topic `tile/...`. */
  show({ header: { first, scale }, arrays: { points, lengths, counts } }) {
    let [curve, point] = [0, 0];
    counts.values.forEach((count, index) => {
      const path = new Path2D();
      let reach = 0;
      for (const end = curve + count; curve < end; curve++) {
        for (let k = 0; k < lengths.values[curve]; k++, point++) {
          const [x, y] = [scale * points.values[2 * point], scale * points.values[2 * point + 1]];
          reach = Math.max(reach, Math.hypot(x, y));
          if (k) path.lineTo(x, y);
          else path.moveTo(x, y);
        }
      }
      this.count += count - (this.seen[first + index]?.count ?? 0);
      this.seen[first + index] = { path, reach, count };
    });
  }

  /** Stroke what touches the rectangle [left, bottom, right, top]; `path` has the vertices' poses. */
  stroke(context, path, [left, bottom, right, top]) {
    const walls = new Path2D();
    path.forEach(([x, y, theta], vertex) => {
      const seen = this.seen[vertex];
      if (!seen || x + seen.reach < left || x - seen.reach > right || y + seen.reach < bottom || y - seen.reach > top) return;
      const [cos, sin] = [Math.cos(theta), Math.sin(theta)];
      walls.addPath(seen.path, new DOMMatrix([cos, sin, -sin, cos, x, y]));
    });
    context.stroke(walls);
  }

  /** [left, bottom, right, top] of all walls, the path and a further place. */
  bounds(path, [x, y]) {
    const box = [x, y, x, y];
    path.forEach((pose, vertex) => {
      const reach = this.seen[vertex]?.reach ?? 0;
      for (const axis of [0, 1]) {
        box[axis] = Math.min(box[axis], pose[axis] - reach);
        box[axis + 2] = Math.max(box[axis + 2], pose[axis] + reach);
      }
    });
    return box;
  }
}
