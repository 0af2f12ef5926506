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
    """What the test-point kernel needs beside the rasters: points (m, 2) m, raster cell (m), scores, early exit."""

    points: np.ndarray
    cell: float
    both_free: float
    both_wall: float
    differ: float
    early_exit: float


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
    """(size, size) int8 labels around a vertex in the middle: -1 inside, +1 outside, 0 unknown; row is y."""
    n = distances.size
    labels = np.zeros((size, size), np.int8)
    for row in range(size):
        y = (row + 0.5 - 0.5 * size) * cell
        for column in range(size):
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
def point_affinity(labels_a, labels_b, xa, ya, theta_a, xb, yb, theta_b, pattern):
    """Mean score of the test points between two vertices at these world poses; the pattern turns with a.

    With an early exit the mean so far is returned as soon as it falls below `pattern.early_exit` at a multiple of 16.
    """
    size = labels_a.shape[0]
    half = 0.5 * size
    scale = 1.0 / pattern.cell
    dx, dy = 0.5 * (xb - xa), 0.5 * (yb - ya)
    cos_a, sin_a, cos_b, sin_b = math.cos(theta_a), math.sin(theta_a), math.cos(theta_b), math.sin(theta_b)
    middle_xa = (cos_a * dx + sin_a * dy) * scale + half
    middle_ya = (cos_a * dy - sin_a * dx) * scale + half
    middle_xb = -(cos_b * dx + sin_b * dy) * scale + half
    middle_yb = -(cos_b * dy - sin_b * dx) * scale + half
    cos = (cos_a * cos_b + sin_a * sin_b) * scale  # from a's axes to b's
    sin = (sin_a * cos_b - cos_a * sin_b) * scale
    n_points = pattern.points.shape[0]
    score = 0.0
    for point in range(n_points):
        px, py = pattern.points[point, 0], pattern.points[point, 1]
        column, row = middle_xa + px * scale, middle_ya + py * scale
        if 0.0 <= column < size and 0.0 <= row < size:
            label_a = labels_a[int(row), int(column)]
            column, row = middle_xb + cos * px - sin * py, middle_yb + sin * px + cos * py
            if label_a != 0 and 0.0 <= column < size and 0.0 <= row < size:
                label_b = labels_b[int(row), int(column)]
                if label_b != 0:
                    if label_a != label_b:
                        score += pattern.differ
                    elif label_a < 0:
                        score += pattern.both_free
                    else:
                        score += pattern.both_wall
        if (point & 15) == 15 and score < pattern.early_exit * (point + 1):
            return score / (point + 1)
    return score / n_points


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


def wall_direction(walls: Walls, step: int = 3, enough: float = 0.6, jump: float = 0.15) -> complex:
    """Dominant wall direction modulo 90 degrees as R exp(4 i a), |R| from 0 (none, or too little wall) to 1.

    Chords over `step` rays vote with their length; `enough` (m) of wall counts in full.
    """
    n = walls.distances.size
    angles = 2.0 * np.pi * np.arange(n) / n
    inside = np.where(np.isfinite(walls.distances), walls.distances, np.nan)
    points = inside * np.exp(1j * angles)
    chords = np.roll(points, -step) - points
    steady = np.abs(np.roll(inside, -step) - inside) < jump
    for between in range(1, step):
        steady &= np.isfinite(np.roll(inside, -between))
    chords = chords[steady]
    lengths = np.abs(chords)
    total = float(np.sum(lengths))
    if chords.size < 3 or total == 0.0:
        return 0j
    votes = np.sum(lengths * np.exp(4j * np.angle(chords))) / total
    return complex(votes * min(1.0, total / step / enough))
