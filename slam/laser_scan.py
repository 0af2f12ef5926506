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
APART = 4.0  # times that two beams part, and neighbouring ends may still be one wall
FLATTEST = 0.1  # variance of a wall's ends across it, of that along it, at most


MOST_RAYS = 3600  # of a full circle
EXACT = math.radians(0.02)  # that a beam may lie off its ray


class ScanParams(Params):
    """What of a laser's sweep is believed."""

    max_range: float = Field(default=20.0, gt=0.0)  # m; farther ends are not looked at
    free_range: float = Field(default=8.0, ge=0.0)  # m up to which beams are known to be free
    jump: float = Field(default=0.15, gt=0.0)  # m between neighbouring ends of one wall


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


@njit(cache=True)
def scan_normals(points, ways, ranges, spacing, jump):
    """Normals (n, 2) of the lines through up to three neighbours on either side; zeros where these make no line.

    A wall goes on from one end to the next while they lie nearer than `jump`, or than beams that part by `spacing` rad
    make certain.
    """
    n = points.shape[0]
    normals = np.zeros((n, 2))
    for i in range(n):
        first, last = i, i
        reach = max(jump, APART * spacing * ranges[i])
        while first > max(0, i - NEIGHBOURS) and distance(points, first, first - 1) < reach:
            first -= 1
        while last < min(n - 1, i + NEIGHBOURS) and distance(points, last, last + 1) < reach:
            last += 1
        if last - first < 2:
            continue
        x, y, flatness = line_through(points, first, last + 1)
        if flatness > FLATTEST:
            continue
        side = -1.0 if x * ways[i, 0] + y * ways[i, 1] > 0.0 else 1.0
        normals[i, 0], normals[i, 1] = side * x, side * y
    return normals


def rays_of(bearings: np.ndarray) -> tuple[int, np.ndarray]:
    """How many rays a full circle has of which bearings (n,) are some, and which (n,); ValueError where none has."""
    bearings = np.asarray(bearings, float)
    turn = 2.0 * np.pi
    spacings = np.diff(np.sort(bearings))
    if not len(spacings) or not np.min(spacings) > 0.0:
        raise ValueError("a laser has two beams at least, each with a bearing of its own")
    least = max(8, round(turn / float(np.min(spacings))) - 1)
    for n_rays in range(least, MOST_RAYS + 1):
        rays = np.rint(bearings * n_rays / turn).astype(int)
        if np.max(np.abs(rays * turn / n_rays - bearings)) < EXACT and len(np.unique(rays % n_rays)) == len(rays):
            return n_rays, rays % n_rays
    raise ValueError(f"no circle of up to {MOST_RAYS} rays has all of these bearings")


def walls_of(ranges: np.ndarray, n_rays: int, rays: np.ndarray) -> Walls:
    """The walls that beams with ranges (n,) met along the `rays` (n,) of a full circle of `n_rays`.

    What is no number, 0 or less was not measured. A beam that met nothing is not known to be free either: a wall may be
    too dark to be seen.
    """
    ranges = np.nan_to_num(np.asarray(ranges, float), nan=np.inf, posinf=np.inf)
    distances = np.full(n_rays, np.inf)
    distances[rays] = np.where(ranges > 0.0, ranges, np.inf)
    return Walls(distances, np.where(np.isfinite(distances), distances, 0.0))


def scan_of(walls: Walls, params: ScanParams) -> Scan:
    """The scan of what a laser saw."""
    n = walls.distances.size
    order = np.arange(-(n // 2), n - n // 2)  # beams beside each other behind the laser are parted, not those ahead
    bearings = 2.0 * np.pi * order / n
    ways = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    ranges, free = walls.distances[order], walls.free[order]
    is_end, is_swept = ranges < params.max_range, free > 0.0
    swept = np.minimum(free[is_swept], params.free_range)[:, None] * ways[is_swept]
    steps = np.diff(np.flatnonzero(is_end | is_swept))
    spacing = 2.0 * np.pi / n * (float(np.median(steps)) if len(steps) else 1.0)
    points = ranges[is_end, None] * ways[is_end]
    normals = scan_normals(points, ways[is_end], ranges[is_end], spacing, params.jump)
    return Scan(points, normals, bearings[is_end], ranges[is_end], swept, spacing)
