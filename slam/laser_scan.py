"""A laser's sweep as points on walls: where its beams ended, and which way the walls stand there.

Knows of no map and no robot; angles and ranges come in, points in the robot's frame go out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

NEIGHBOURS = 3  # on either side, at most, that tell a wall's direction
APART = 4.0  # times that two beams part, and neighbouring ends may still be one wall
FLATTEST = 0.1  # variance of a wall's ends across it, of that along it, at most


class Scan(NamedTuple):
    """Ends of beams (n, 2) in the robot's frame by ascending bearing, and unit normals (n, 2) towards the laser.

    A normal of zeros is that of an end that tells of no wall's direction.
    """

    points: np.ndarray
    normals: np.ndarray


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


def scan_of(ranges: np.ndarray, bearings: np.ndarray, mount: np.ndarray, max_range: float, jump: float) -> Scan:
    """The scan of ranges (n,) at ascending bearings (n,) of a laser at `mount` (3,) on the robot.

    What is no number, 0 or less, or not below `max_range` is left out; ends nearer than `jump` (m) may be one wall.
    """
    seen = np.nan_to_num(np.asarray(ranges, float), nan=np.inf)
    met = (seen > 0.0) & (seen < max_range)
    angles = mount[2] + bearings[met]
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    spacing = float(np.median(np.diff(bearings))) if len(bearings) > 1 else 0.0
    points = mount[:2] + seen[met, None] * ways
    return Scan(points, scan_normals(points, ways, seen[met], spacing, jump))
