"""How well two wall observations agree where a path comes back (Crunch thesis, 2.5): by segments, or by test points.

Test points fall in a Gaussian pattern around the middle of the two vertices and are looked up in a label raster of
each: inside (-1, seen free), outside (+1, at or behind a wall), or unknown (0). The thesis knows inside and outside
only and counts agreement; by default a point scores the log likelihood ratio of its two labels under "same place"
against "by chance", so that free space that agrees, which is common, says little and walls that agree say much.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Literal, NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.params import Params
from slam.walls import Walls

SEGMENT_RAYS = 2  # rays that one wall segment spans
SEGMENT_JUMP = 0.2  # m; farther neighbours are not one segment
CHUNK = 16  # test points between two looks at the early exit


class AffinityParams(Params):
    """Which affinity, and what agreement and disagreement are worth."""

    kind: Literal["points", "segments"] = "points"
    states: Literal[2, 3] = 3  # 2: the thesis's inside/outside; 3: also unknown
    n_points: int = Field(default=64, ge=1, le=10_000)
    spread: float = Field(default=0.6, gt=0.0)  # sigma of the test points, times the local map's reach
    both_free: float = 0.22
    both_wall: float = 1.16
    differ: float = -1.3
    wall_thickness: float = Field(default=0.25, gt=0.0)  # m behind a wall that count as outside
    label_cell: float = Field(default=0.04, ge=0.02)  # m
    early_exit: float = Field(
        default=-math.inf, allow_inf_nan=True
    )  # running mean below which the rest of the points is not looked at
    segment_scale: float = Field(default=0.1, gt=0.0)  # m, decay of affinity 1 with distance
    gain: float = Field(default=5.0, ge=0.0)  # log weight per mean score of the points: the tempering
    segment_gain: float = Field(default=10.0, ge=0.0)  # log weight per square metre of segments that agree


class Pattern(NamedTuple):
    """What the test-point kernel needs beside the rasters: points x (m,) and y (m,) in cells, scores, early exit."""

    x: np.ndarray
    y: np.ndarray
    cell: float
    both_free: float
    both_wall: float
    differ: float
    early_exit: float


def pattern_of(params: AffinityParams, reach: float) -> Pattern:
    """The test points for a local map of this reach (m)."""
    points = gaussian_points(params.n_points, params.spread * reach) / params.label_cell
    x, y = np.ascontiguousarray(points.T)
    return Pattern(
        x, y, params.label_cell, params.both_free, params.both_wall, params.differ, params.early_exit
    )  # fmt: skip


def gaussian_points(n: int, sigma: float) -> np.ndarray:
    """(n, 2) points of Halton's sequence in bases 2 and 3 through the inverse normal, `sigma` in m."""

    def radical_inverse(index: int, base: int) -> float:
        value, scale = 0.0, 1.0 / base
        while index:
            index, digit = divmod(index, base)
            value += digit * scale
            scale /= base
        return value

    normal = NormalDist(0.0, sigma)
    rows = [[normal.inv_cdf(radical_inverse(i, base)) for base in (2, 3)] for i in range(1, n + 1)]
    return np.array(rows)


@njit(cache=True)
def label_raster(distances, free, size, cell, thickness, states, reach):
    """(size, size) int8 labels around a vertex in the middle: -1 inside, +1 outside, 0 unknown; row is y.

    The outermost cells stay unknown: whatever lies beyond the raster is looked up there.
    """
    n = distances.size
    labels = np.zeros((size, size), np.int8)
    for row in range(1, size - 1):
        y = (row + 0.5 - 0.5 * size) * cell
        for column in range(1, size - 1):
            x = (column + 0.5 - 0.5 * size) * cell
            distance = math.sqrt(x * x + y * y)
            ray = math.floor(math.atan2(y, x) / (2.0 * math.pi) * n + 0.5) % n
            wall = distances[ray]
            if states == 2:
                if distance <= 1.25 * reach:
                    labels[row, column] = 1 if distance > wall else -1
            elif math.isfinite(wall):
                if distance >= wall:
                    labels[row, column] = 1 if distance < wall + thickness else 0
                elif distance < max(free[ray], wall - 0.1):
                    labels[row, column] = -1
            elif distance < free[ray]:
                labels[row, column] = -1
    return labels


@njit(cache=True, inline="always")
def in_rasters(size, a, b, xa, ya, theta_a, xb, yb, theta_b, cell):
    """Where the rasters of vertices a and b start, their middle in the cells of each, and the turn from a to b."""
    half, scale = 0.5 * size, 1.0 / cell
    dx, dy = 0.5 * scale * (xb - xa), 0.5 * scale * (yb - ya)
    cos_a, sin_a, cos_b, sin_b = math.cos(theta_a), math.sin(theta_a), math.cos(theta_b), math.sin(theta_b)
    middle_a = cos_a * dx + sin_a * dy + half, cos_a * dy - sin_a * dx + half
    middle_b = half - cos_b * dx - sin_b * dy, half - cos_b * dy + sin_b * dx
    turn = cos_a * cos_b + sin_a * sin_b, sin_a * cos_b - cos_a * sin_b
    return (a * size * size, b * size * size), middle_a, middle_b, turn


@njit(cache=True, inline="always")
def point_affinity(labels, size, a, b, xa, ya, theta_a, xb, yb, theta_b, pattern, cells):
    """Mean score of the test points between vertices a and b at these world poses; the pattern turns with a.

    `labels` are all vertices' rasters one after the other, `cells` two (m,) int32 to work in.
    """
    starts, middle_a, middle_b, turn = in_rasters(size, a, b, xa, ya, theta_a, xb, yb, theta_b, pattern.cell)
    counts = count_labels(labels, size, starts, middle_a, middle_b, turn, pattern, 0, pattern.x.size, cells)
    return points_score(counts, pattern) / pattern.x.size


@njit(cache=True, inline="always")
def early_affinity(labels, size, a, b, xa, ya, theta_a, xb, yb, theta_b, pattern, cells):
    """The same, but the mean so far as soon as it falls below `pattern.early_exit` after a multiple of 16 points."""
    starts, middle_a, middle_b, turn = in_rasters(size, a, b, xa, ya, theta_a, xb, yb, theta_b, pattern.cell)
    total, n_points = 0.0, pattern.x.size
    for first in range(0, n_points, CHUNK):
        n = min(CHUNK, n_points - first)
        total += points_score(
            count_labels(labels, size, starts, middle_a, middle_b, turn, pattern, first, n, cells), pattern
        )
        if n == CHUNK and total < pattern.early_exit * (first + n):
            return total / (first + n)
    return total / n_points


@njit(cache=True, inline="always")
def count_labels(labels, size, starts, middle_a, middle_b, turn, pattern, first, n, cells):
    """Sums over n points of their labels' product, of its square, and of the product times the labels' sum.

    All cells are worked out, as vectors, before any is looked up; and nothing branches on a label: labels agree as
    often as not, and a wrongly guessed branch costs more than ten look-ups.
    """
    top, width = size - 1.0, np.int32(size)  # 32 bits fit twice as many cells into a vector
    xs, ys = pattern.x[first : first + n], pattern.y[first : first + n]
    cells_a, cells_b = cells
    start_a, start_b = starts
    middle_xa, middle_ya = middle_a
    middle_xb, middle_yb = middle_b
    cos, sin = turn
    for k in range(n):
        x, y = xs[k], ys[k]
        column, row = min(max(middle_xa + x, 0.0), top), min(max(middle_ya + y, 0.0), top)
        cells_a[k] = np.int32(row) * width + np.int32(column)
        column = min(max(middle_xb + cos * x - sin * y, 0.0), top)
        row = min(max(middle_yb + sin * x + cos * y, 0.0), top)
        cells_b[k] = np.int32(row) * width + np.int32(column)
    agree, known, kind = 0, 0, 0
    for k in range(n):
        label_a, label_b = np.int32(labels[start_a + cells_a[k]]), np.int32(labels[start_b + cells_b[k]])
        product = label_a * label_b
        agree += product
        known += product * product
        kind += product * (label_a + label_b)
    return agree, known, kind


@njit(cache=True, inline="always")
def points_score(counts, pattern):
    """Summed score of points: of `known` ones `agree` more agree than differ, `kind` / 2 more are wall than free."""
    agree, known, kind = counts
    n_agree = 0.5 * (known + agree)
    n_wall = 0.5 * (n_agree + 0.5 * kind)
    return pattern.both_wall * n_wall + pattern.both_free * (n_agree - n_wall) + pattern.differ * (known - n_agree)


@njit(cache=True, inline="always")
def segment_affinity(segments_a, segments_b, xa, ya, theta_a, xb, yb, theta_b, scale):
    """Sum over pairs of segments of n_a . n_b exp(-d / scale) times both lengths (thesis, 2.5, first function).

    Segments are rows (x, y, normal x, normal y, length) in each vertex's frame; a length of 0 ends the list.
    """
    cos_a, sin_a = math.cos(theta_a), math.sin(theta_a)
    cos, sin = math.cos(theta_b - theta_a), math.sin(theta_b - theta_a)
    x = cos_a * (xb - xa) + sin_a * (yb - ya)
    y = cos_a * (yb - ya) - sin_a * (xb - xa)
    total = 0.0
    for j in range(segments_b.shape[0]):
        if segments_b[j, 4] == 0.0:
            break
        middle_x = cos * segments_b[j, 0] - sin * segments_b[j, 1] + x
        middle_y = sin * segments_b[j, 0] + cos * segments_b[j, 1] + y
        normal_x = cos * segments_b[j, 2] - sin * segments_b[j, 3]
        normal_y = sin * segments_b[j, 2] + cos * segments_b[j, 3]
        for i in range(segments_a.shape[0]):
            if segments_a[i, 4] == 0.0:
                break
            distance = math.hypot(segments_a[i, 0] - middle_x, segments_a[i, 1] - middle_y)
            if distance < 5.0 * scale:
                agreement = normal_x * segments_a[i, 2] + normal_y * segments_a[i, 3]
                total += agreement * math.exp(-distance / scale) * segments_a[i, 4] * segments_b[j, 4]
    return total


def wall_segments(walls: Walls) -> np.ndarray:
    """(n_rays / 2, 5) rows of a segment's middle, its normal, away from the vertex, and its length (m)."""
    n = walls.distances.size
    rays = np.arange(0, n - n % SEGMENT_RAYS, SEGMENT_RAYS)
    ends = (rays + SEGMENT_RAYS) % n
    near, far = walls.distances[rays], walls.distances[ends]
    with np.errstate(invalid="ignore"):
        kept = np.isfinite(near) & np.isfinite(far) & (np.abs(near - far) < SEGMENT_JUMP)
    angles = 2.0 * np.pi / n
    start = near[kept, None] * np.stack([np.cos(angles * rays[kept]), np.sin(angles * rays[kept])], axis=1)
    end = far[kept, None] * np.stack([np.cos(angles * ends[kept]), np.sin(angles * ends[kept])], axis=1)
    along = end - start
    lengths = np.hypot(along[:, 0], along[:, 1])
    rows = np.zeros((rays.size, 5))
    rows[: lengths.size, :2] = 0.5 * (start + end)
    rows[: lengths.size, 2] = along[:, 1] / lengths
    rows[: lengths.size, 3] = -along[:, 0] / lengths
    rows[: lengths.size, 4] = lengths
    return rows
