"""A small cart in areas of polygons, for tests that need many bumps fast: arcs, slips, flattening, ticks.

Its errors are of the kinds that a real cart has, but it is not the virtual cart, which runs the firmware.
"""

from __future__ import annotations

import math

import numpy as np

from slam.cart_odometry import BACK, DRIVE, MIDDLE, TURN, CartParams, Stage, arc
from slam.pose import compose, wrap

STEP = 0.004  # m
BACK_WAY = 0.08  # m


def rectangle(width: float, height: float) -> np.ndarray:
    """Corners (4, 2)."""
    return np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])


AREAS = {
    "cut rectangle": [np.array([(0, 0), (1.5, 0), (1.5, 0.8), (1.1, 1.2), (0, 1.2)], float)],
    "square": [rectangle(1.5, 1.5)],
    "triangle": [np.array([(0, 0), (1.9, 0), (0.6, 1.6)], float)],
    "L": [np.array([(0, 0), (1.6, 0), (1.6, 0.7), (0.75, 0.7), (0.75, 1.5), (0, 1.5)], float)],
    "pentagon": [np.array([(0.4, 0), (1.3, 0.1), (1.6, 0.9), (0.9, 1.5), (0, 0.9)], float)],
    "block": [rectangle(1.7, 1.5), np.array([(0.75, 0.65), (0.75, 0.9), (1.0, 0.9), (1.0, 0.65)], float)],
    "octagon": [0.8 * np.array([(math.cos(a), math.sin(a)) for a in np.arange(8) * math.pi / 4 + 0.2])],
}


def crossings(first: np.ndarray, second: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Whether segments from `first` to `second` (n, 2) cross any of the edges (m, 4)."""
    start, along = edges[None, :, :2], edges[None, :, 2:] - edges[None, :, :2]
    way = (second - first)[:, None]
    away = start - first[:, None]
    cross = way[..., 0] * along[..., 1] - way[..., 1] * along[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (away[..., 0] * along[..., 1] - away[..., 1] * along[..., 0]) / cross
        on = (away[..., 0] * way[..., 1] - away[..., 1] * way[..., 0]) / cross
    return np.any((at >= 0) & (at <= 1) & (on >= 0) & (on <= 1), axis=1)


def edges_of(area: list[np.ndarray]) -> np.ndarray:
    """Edges (m, 4) of closed outlines."""
    return np.concatenate([np.hstack([outline, np.roll(outline, -1, axis=0)]) for outline in area])


class SmallCart:
    """Truth and counters of one cart; `params` is what is told of it, its own wheelbase differs by a few per cent."""

    def __init__(self, area: list[np.ndarray], seed: int, params: CartParams | None = None):
        self.rng = np.random.default_rng(seed)
        self.params = params or CartParams()
        self.edges = edges_of(area)
        self.own = self.params._replace(wheelbase=self.params.wheelbase * self.rng.normal(1.0, 0.02))
        self.unlike = self.curve = float(np.clip(self.rng.normal(0.0, 0.03), -0.06, 0.06))  # of the wheels' speeds
        self.scale = self.rng.normal(1.0, 0.004)  # of the right wheel's size
        self.rest = np.zeros(2)
        self.stages: list[Stage] = []
        low, high = area[0].min(axis=0), area[0].max(axis=0)
        while True:
            self.pose = np.array([*self.rng.uniform(low, high), self.rng.uniform(-math.pi, math.pi)])
            far = np.array([[9.1, 7.3]])
            inside = sum(int(crossings(self.pose[None, :2], far, edge[None])[0]) for edge in self.edges) % 2
            ring = self.pose[:2] + 0.13 * np.array([(math.cos(a), math.sin(a)) for a in np.arange(24) * math.pi / 12])
            if inside and not np.any(crossings(ring, np.roll(ring, 1, axis=0), self.edges)):
                break
        self.truth = [self.pose]

    def log(self, kind: int, left: float, right: float, bumper: int = 0) -> None:
        """Whole ticks that the wheels' ways (m) make, their remainders kept."""
        ways = np.array([left, right]) / self.params.tick + self.rest
        ticks = np.floor(ways)
        self.rest = ways - ticks
        self.stages.append(Stage(kind, int(ticks[0]), int(ticks[1]), bumper))
        self.truth.append(self.pose)

    def go(self, left: float, right: float) -> np.ndarray:
        """Pose after the wheels have gone so many m, with their noise."""
        way, turn = 0.5 * (left + right), (right - left) / self.own.wheelbase
        noise = self.rng.normal(size=2)
        ends = arc(np.array(left / self.own.tick), np.array(right * self.scale / self.own.tick), self.own)
        ends = ends + np.array([0.006 * math.sqrt(abs(way)) * noise[0], 0, 0])
        ends[2] += math.hypot(0.03 * math.sqrt(abs(way)), 0.02 * turn) * noise[1]
        return compose(self.pose, ends)

    def drive(self) -> None:
        """To the first wall, and what it does to the heading."""
        self.curve += 0.1 * (self.unlike - self.curve) + self.rng.normal(0.0, 0.004)
        steps = np.arange(1, 1200) * STEP
        lefts, rights = steps * (1.0 - self.curve / 2), steps * (1.0 + self.curve / 2)
        ends = self.go(lefts[-1], rights[-1])
        ideal = compose(self.pose, arc(lefts / self.own.tick, rights * self.scale / self.own.tick, self.own))
        error = wrap(ends[2] - ideal[-1, 2]) / steps[-1]
        swing = error * 0.5 * self.own.wheelbase * steps
        true_ways = (lefts - swing) / self.own.tick, (rights * self.scale + swing) / self.own.tick
        path = compose(self.pose, arc(*true_ways, self.own))
        across = 0.5 * self.params.bumper_width * np.stack([-np.sin(path[:, 2]), np.cos(path[:, 2])], axis=1)
        ahead = path[:, :2] + self.params.bumper_ahead * np.stack([np.cos(path[:, 2]), np.sin(path[:, 2])], axis=1)
        touches = crossings(ahead - across, ahead + across, self.edges)
        for end in (ahead - across, ahead + across):  # a square bumper may be past a wall within a step
            touches[1:] |= crossings(end[:-1], end[1:], self.edges)
        hit = int(np.flatnonzero(touches)[0])
        self.pose = path[max(0, hit - 1)]
        self.flatten()
        self.log(DRIVE, lefts[hit], rights[hit], MIDDLE)

    def flatten(self) -> None:
        """Against a wall that is hit almost square the bumper turns the cart; a slip may do more."""
        _, way = self.nearest()
        normal = math.atan2(*way[::-1])
        off = (self.pose[2] - normal + 0.5 * math.pi) % math.pi - 0.5 * math.pi
        turned = self.pose[2]
        if abs(off) < 0.14:
            turned -= off
        if self.rng.random() < 0.1:
            turned += self.rng.normal(0.0, 0.12)
        self.pose = np.array([self.pose[0], self.pose[1], turned])

    def nearest(self) -> tuple[int, np.ndarray]:
        """The nearest edge, and the way (2,) from it to the axle."""
        along = self.edges[:, 2:] - self.edges[:, :2]
        on = np.clip(np.sum(along * (self.pose[:2] - self.edges[:, :2]), axis=1) / np.sum(along**2, axis=1), 0, 1)
        ways = self.pose[:2] - (self.edges[:, :2] + on[:, None] * along)
        row = int(np.argmin(np.hypot(*ways.T)))
        return row, ways[row]

    def keep_clear(self) -> None:
        """Where the cart turned against a wall, the wall pushed it away, which no counter saw."""
        reach = math.hypot(self.params.bumper_ahead, 0.5 * self.params.bumper_width) + 0.002
        for _ in range(5):
            _, way = self.nearest()
            distance = math.hypot(*way)
            if distance >= reach:
                break
            self.pose = self.pose + np.array([*(way / distance * (reach - distance + 1e-6)), 0.0])

    def cycle(self) -> None:
        """Drive, bump, back up, turn."""
        self.drive()
        self.pose = self.go(-BACK_WAY, -BACK_WAY)
        self.log(BACK, -BACK_WAY, -BACK_WAY)
        turn = self.rng.choice([-1, 1]) * self.rng.uniform(0.7, 3.0)
        half = 0.5 * turn * self.params.wheelbase
        self.pose = self.go(-half, half)
        self.keep_clear()
        self.log(TURN, -half, half)


def run(area: list[np.ndarray], seed: int, bumps: int) -> tuple[list[Stage], np.ndarray]:
    """Stages of so many cycles, and the true poses (n + 1, 3) at the start and after each."""
    cart = SmallCart(area, seed)
    for _ in range(bumps):
        cart.cycle()
    return cart.stages, np.array(cart.truth)
