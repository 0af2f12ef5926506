// Poses [x, y, theta] of one frame in another, as slam/pose.py has them.

/** `inner`, a pose in the frame that stands at `outer`, in the frame around that. */
export function compose([x, y, theta], [dx, dy, turn]) {
  const [cos, sin] = [Math.cos(theta), Math.sin(theta)];
  return [x + cos * dx - sin * dy, y + sin * dx + cos * dy, wrap(theta + turn)];
}

export function inverse([x, y, theta]) {
  const [cos, sin] = [Math.cos(theta), Math.sin(theta)];
  return [-cos * x - sin * y, sin * x - cos * y, wrap(-theta)];
}

/** A place of the frame that stands at a pose, in the frame around it. */
export function transform(pose, [x, y]) {
  return compose(pose, [x, y, 0]).slice(0, 2);
}

/** An angle from -pi to pi. */
export function wrap(angle) {
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}
