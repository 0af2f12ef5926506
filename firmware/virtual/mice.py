"""Virtual optical mice under a body, and a floor with markings that fool them.

A mouse is asked a hundred times a second what its place on the true body has moved by, and tells it in packets of three
bytes, as Linux has them at /dev/input/mouseN; one that has nothing to tell is silent. Over a black marking it follows
the line (the robot's paper, Discussion): of its way only what leads along the marking is counted. Knows nothing of the
host's side.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

PERIOD_MS = 10
COUNTS_PER_METRE = 800 / 0.0254  # 800 an inch
SCALE = 0.005  # standard deviation of a mouse's own scale, for none hangs quite as high as another,
TWIST = 0.005  # and, in rad, of how straight it was put in
NOISE, NOISE_SHARE = 0.3, 0.02  # counts of an axis in a packet, and of the way
DROPOUTS = 0.002  # of the packets that moved, in which the floor is not seen
MOST = 127  # counts in a packet: what is left comes with the next
LONGEST, WIDEST = 0.16, 0.03  # m of a marking
CELL = 0.2  # m of a square that has one marking at most


class MousePlace(NamedTuple):
    """Where a mouse sits under the robot: m ahead of the middle of the axle, m to the left, rad to its own x axis."""

    x: float
    y: float
    angle: float


AHEAD = -0.5 * math.pi  # angle of one whose cable leads ahead: its x axis looks to the right
PLACES = (
    MousePlace(0.09, 0.07, AHEAD), MousePlace(0.09, -0.07, AHEAD), MousePlace(-0.09, 0.0, -AHEAD),
    MousePlace(0.0, 0.07, 0.0), MousePlace(0.0, -0.07, math.pi), MousePlace(0.1, 0.0, AHEAD),
    MousePlace(-0.07, 0.06, 0.0), MousePlace(-0.07, -0.06, math.pi),
)  # fmt: skip


class Floor:
    """Black markings, straight and at random: `density` is the share of squares of the floor that have one."""

    def __init__(self, density: float = 0.0, seed: int = 0):
        self.density = density
        self.seed = seed
        self.known: dict[tuple[int, int], np.ndarray | None] = {}  # middle and direction (3,) by square

    def marking(self, x: float, y: float) -> float | None:
        """The direction (rad) of the marking at a place (m); None where the floor is clean."""
        if self.density <= 0.0:
            return None
        column, row = math.floor(x / CELL), math.floor(y / CELL)
        for square in ((column + i, row + j) for i in (-1, 0, 1) for j in (-1, 0, 1)):
            found = self.marking_of(square)
            if found is None:
                continue
            cos, sin = math.cos(found[2]), math.sin(found[2])
            along = cos * (x - found[0]) + sin * (y - found[1])
            across = cos * (y - found[1]) - sin * (x - found[0])
            if abs(along) < 0.5 * LONGEST and abs(across) < 0.5 * WIDEST:
                return float(found[2])
        return None

    def marking_of(self, square: tuple[int, int]) -> np.ndarray | None:
        """The marking of a square: its middle and its direction (3,)."""
        if square not in self.known:
            rng = np.random.default_rng([self.seed, square[0] % 2**32, square[1] % 2**32])
            u, v, turn = rng.random(3)
            middle = np.array([(square[0] + u) * CELL, (square[1] + v) * CELL, math.pi * turn])
            self.known[square] = middle if rng.random() < self.density else None
        return self.known[square]


class VirtualMouse:
    """One mouse on a body; `advance` it with the body's true pose."""

    def __init__(self, place: MousePlace, floor: Floor, seed: int = 0):
        """Mice of other seeds sit and scale otherwise, have other noise, and are asked at another time."""
        self.floor = floor
        self.rng = np.random.default_rng([seed, 0x0515])
        self.scale = COUNTS_PER_METRE * (1.0 + SCALE * float(self.rng.standard_normal()))
        self.place = place._replace(angle=place.angle + TWIST * float(self.rng.standard_normal()))
        self.phase = int(self.rng.integers(PERIOD_MS))
        self.before: np.ndarray | None = None  # the body's pose when it was asked last
        self.owed = np.zeros(2)  # counts that no packet has told yet
        self.is_plugged = True

    def advance(self, now_ms: int, body: np.ndarray) -> bytes:
        """What it says in the millisecond in which the body's pose is `body` (3,)."""
        if now_ms % PERIOD_MS != self.phase:
            return b""
        before, self.before = body if self.before is None else self.before, body
        way = self.way(before, body)
        if np.any(way) and self.rng.random() >= DROPOUTS:
            counts = self.scale * way
            noise = math.hypot(NOISE, NOISE_SHARE * math.hypot(*counts))
            self.owed += counts + noise * self.rng.standard_normal(2)
        told = np.clip(np.trunc(self.owed), -MOST, MOST).astype(int)
        self.owed -= told
        return packet(int(told[0]), int(told[1])) if self.is_plugged and np.any(told) else b""

    def way(self, before: np.ndarray, now: np.ndarray) -> np.ndarray:
        """What it sees of its place's way (2,) between two poses of the body, in m along its own axes."""
        x, y = self.at(now)
        dx, dy = x - self.at(before)[0], y - self.at(before)[1]
        line = self.floor.marking(x, y)
        if line is not None:
            along = dx * math.cos(line) + dy * math.sin(line)
            dx, dy = along * math.cos(line), along * math.sin(line)
        angle = before[2] + 0.5 * math.remainder(now[2] - before[2], 2.0 * math.pi) + self.place.angle
        cos, sin = math.cos(angle), math.sin(angle)
        return np.array([cos * dx + sin * dy, cos * dy - sin * dx])

    def at(self, body: np.ndarray) -> tuple[float, float]:
        """Where its eye is (m, world) when the body is at a pose (3,)."""
        x, y, heading = body
        cos, sin = math.cos(heading), math.sin(heading)
        return x + cos * self.place.x - sin * self.place.y, y + sin * self.place.x + cos * self.place.y


def packet(x: int, y: int) -> bytes:
    """Counts to the right and ahead, -127 to 127 each, as three bytes."""
    return bytes([0x08 | (0x10 if x < 0 else 0) | (0x20 if y < 0 else 0), x % 256, y % 256])
