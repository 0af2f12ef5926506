"""A laser's sweep as points on walls: where its beams ended, and which way the walls stand there.

A laser's beams are rays of a full circle around it, of which the others saw nothing (`slam.walls.Walls`), so that a
vertex of a robot with a laser is like any other. Knows of no map; all is in the laser's frame. Uses its sibling
`walls`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.params import Params
from slam.walls import Walls

NEIGHBOURS = 3  # on either side, at most, that tell a wall's direction
ERROR = 0.01  # m that ends err by; where so many neighbours lie within that,
STRETCH = 0.08  # m of the wall on either side tell it
APART = 4.0  # times that two beams part, and neighbouring ends may still be one wall
FLATTEST = 0.1  # variance of a wall's ends across it, of that along it, at most


MOST_RAYS = 3600  # of a full circle
TURN = 2.0 * math.pi
EXACT = math.radians(0.02)  # that a beam may lie off its ray


class LaserParams(Params):
    """A laser: where its beams look, how far, and where it sits on the robot. The default is a Hokuyo URG-04LX."""

    beams: int = Field(default=682, ge=2, le=4096)
    first_deg: float = Field(default=-119.53125, ge=-360.0, le=360.0)  # of the first beam, to the right,
    step_deg: float = Field(default=0.3515625, gt=0.0, le=90.0)  # and from each to the next
    max_range: float = Field(default=5.6, gt=0.0, le=200.0)  # m; nothing farther is reported
    x: float = 0.0  # m ahead of the middle of the axle
    y: float = 0.0  # m to the left of it
    angle_deg: float = 0.0  # that it is turned by

    @property
    def bearings(self) -> np.ndarray:
        """Bearings (beams,) in radians, in the laser's own frame."""
        return np.radians(self.first_deg + self.step_deg * np.arange(self.beams))

    @property
    def mount(self) -> np.ndarray:
        """Pose (3,) on the robot."""
        return np.array([self.x, self.y, math.radians(self.angle_deg)])


class ScanParams(Params):
    """What of a laser's sweep is believed."""

    max_range: float = Field(default=20.0, gt=0.0)  # m; farther ends are not looked at
    free_range: float = Field(default=8.0, ge=0.0)  # m up to which beams are known to be free


class Scan(NamedTuple):
    """Ends of beams (n, 2) by ascending bearing from behind the laser, and unit normals (n, 2) towards it.

    A normal of zeros is that of an end that tells of no wall's direction. The ends are `ranges` (n,) off along
    `bearings` (n,). `swept` (k, 2) are how far beams went freely, by ascending bearing too, `spacing` rad apart.
    """

    points: np.ndarray
    normals: np.ndarray
    bearings: np.ndarray
    ranges: np.ndarray
    swept: np.ndarray
    spacing: float


@njit(cache=True, inline="always")
def line_through(points, first, end):
    """A normal of the line through points first..end, and their variance across it, of that along it."""
    sx, sy, sxx, sxy, syy = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(first, end):
        dx, dy = points[j, 0] - points[first, 0], points[j, 1] - points[first, 1]
        sx, sy, sxx, sxy, syy = sx + dx, sy + dy, sxx + dx * dx, sxy + dx * dy, syy + dy * dy
    m = end - first
    xx, xy, yy = sxx / m - (sx / m) ** 2, sxy / m - sx * sy / m**2, syy / m - (sy / m) ** 2
    middle, swing = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    along = 0.5 * math.atan2(2.0 * xy, xx - yy)
    return -math.sin(along), math.cos(along), (middle - swing) / max(middle + swing, 1e-12)


@njit(cache=True, inline="always")
def distance(points, i, j):
    """Between two of the points."""
    return math.hypot(points[i, 0] - points[j, 0], points[i, 1] - points[j, 1])


@njit(cache=True, inline="always")
def one_wall(points, i, reach, stretch):
    """The first of the points around one that are a wall with it, and the one after the last.

    It goes on to three neighbours on either side, or as far as `stretch` m, while neighbours lie nearer than `reach`.
    """
    first, last = i, i
    while first > 0 and (i - first < NEIGHBOURS or distance(points, i, first) < stretch):
        if distance(points, first, first - 1) >= reach:
            break
        first -= 1
    while last < points.shape[0] - 1 and (last - i < NEIGHBOURS or distance(points, i, last) < stretch):
        if distance(points, last, last + 1) >= reach:
            break
        last += 1
    return first, last + 1


@njit(cache=True)
def scan_normals(points, ways, ranges, spacing, jump):
    """Normals (n, 2) of the lines through ends and their neighbours; zeros where these make no line.

    A wall goes on from one end to the next while they lie nearer than `jump`, or than beams that part by `spacing` rad
    make certain.
    """
    n = points.shape[0]
    normals = np.zeros((n, 2))
    for i in range(n):
        between = spacing * ranges[i]
        first, end = one_wall(points, i, max(jump, APART * between), STRETCH if NEIGHBOURS * between < ERROR else 0.0)
        if end - first < 3:
            continue
        x, y, flatness = line_through(points, first, end)
        if flatness > FLATTEST:
            continue
        side = -1.0 if x * ways[i, 0] + y * ways[i, 1] > 0.0 else 1.0
        normals[i, 0], normals[i, 1] = side * x, side * y
    return normals


class Rays(NamedTuple):
    """Which of the `n` rays of a full circle a laser's beams are: `rows` (beams,); ray 0 looks to `offset` rad."""

    n: int
    rows: np.ndarray
    offset: float


def rays_of(bearings: np.ndarray) -> Rays:
    """The circle that has bearings (n,) among its rays, if it can without rays between; ValueError where none has."""
    bearings = np.asarray(bearings, float)
    spacings = np.diff(np.sort(bearings))
    if not len(spacings) or not np.min(spacings) > 0.0:
        raise ValueError("a laser has two beams at least, each with a bearing of its own")
    least = max(8, round(TURN / float(np.median(spacings))))
    for n in range(least, MOST_RAYS + 1):
        offset = math.remainder(float(bearings[0]), TURN / n) if n == least else 0.0
        rows = np.rint((bearings - offset) * n / TURN).astype(int)
        off = rows * TURN / n + offset - bearings
        if np.max(np.abs(off)) < EXACT and len(np.unique(rows % n)) == len(rows):
            return Rays(n, rows % n, offset)
    raise ValueError(f"no circle of up to {MOST_RAYS} rays has all of these bearings")


def walls_of(ranges: np.ndarray, rays: Rays, params: ScanParams) -> Walls:
    """The walls that beams with ranges (n,) met, as far as they are believed.

    What is no number, 0 or less was not measured. A beam that met nothing is not known to be free either: a wall may be
    too dark to be seen.
    """
    ranges = np.nan_to_num(np.asarray(ranges, float), nan=np.inf, posinf=np.inf)
    measured = np.where(ranges > 0.0, ranges, np.inf)
    distances, free = np.full(rays.n, np.inf), np.zeros(rays.n)
    distances[rays.rows] = np.where(measured < params.max_range, measured, np.inf)
    free[rays.rows] = np.where(np.isfinite(measured), np.minimum(measured, params.free_range), 0.0)
    return Walls(distances, free)


def scan_of(walls: Walls, jump: float) -> Scan:
    """The scan of what a laser saw; ends nearer than `jump` m may be one wall."""
    n = walls.distances.size
    order = np.arange(-(n // 2), n - n // 2)  # beams beside each other behind the laser are parted, not those ahead
    bearings = 2.0 * np.pi * order / n
    ways = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    ranges, free = walls.distances[order], walls.free[order]
    is_end, is_swept = np.isfinite(ranges), free > 0.0
    swept = free[is_swept, None] * ways[is_swept]
    steps = np.diff(np.flatnonzero(is_end | is_swept))
    spacing = 2.0 * np.pi / n * (float(np.median(steps)) if len(steps) else 1.0)
    points = ranges[is_end, None] * ways[is_end]
    normals = scan_normals(points, ways[is_end], ranges[is_end], spacing, jump)
    return Scan(points, normals, bearings[is_end], ranges[is_end], swept, spacing)
