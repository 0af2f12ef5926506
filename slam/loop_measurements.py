"""What the walls say about where two vertices stand to each other where a path meets itself: measurements.

Around the relative pose that the path has, test points compare what both vertices saw, as affinity 2 does
(`slam.affinity`); the moments of exp(sharpness x score) under a Gaussian window give a mean and a covariance, and what
the window itself contributed is divided out again. Along a bare corridor nothing is left, and nothing is pretended.
Uses its siblings `affinity`, `evaluate`, `wall_matching` and `walls`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.affinity import AffinityParams, gaussian_points, label_raster
from slam.evaluate import path_length
from slam.pose import between
from slam.wall_matching import near_pairs
from slam.walls import Walls

WINDOW = np.array([0.12, 0.12, math.radians(4.0)])  # standard deviations of the window (m, m, rad)
STEPS = 5  # grid points to each side, half a standard deviation apart
N_POINTS = 256  # with the affinity's 64, errors are twice as large and have longer tails
SHARPNESS = 100.0  # log likelihood per mean score; by simulated drives errors are then half of what is told
FARTHEST = 3.0  # standard deviations of the window by which it may be moved
APART = 1.5  # m of way between measured pairs: farther apart they share few readings
ENOUGH = 20.0  # information of a direction, as a multiple of the window's own, beyond which more is not better
SEEN = 2.0  # least information of a direction, as a multiple of the window's own


class Rasters(NamedTuple):
    """What each of v vertices saw: `labels` (v, size, size) of `slam.affinity.label_raster`, and how to compare two.

    `points` (m, 2) in cells around the middle of two vertices, `cell` in m, `scores` of agreeing on free space, of
    agreeing on wall, and of differing.
    """

    labels: np.ndarray
    points: np.ndarray
    cell: float
    scores: np.ndarray


class Loops(NamedTuple):
    """Measured places: row k is about where vertex `second[k]` is in the frame of the earlier `first[k]`.

    In the direction `directions[k]` (2,) it is `offsets[k]` m off the path's, with variance `variances[k]`. `pairs[k]`
    numbers the pair of vertices; a pair has up to 2 rows, at right angles.
    """

    first: np.ndarray
    second: np.ndarray
    directions: np.ndarray
    offsets: np.ndarray
    variances: np.ndarray
    pairs: np.ndarray


def rasters(observations: Sequence[Walls], reach: float, params: AffinityParams | None = None) -> Rasters:
    """Rasters of what the vertices saw within `reach` m."""
    params = params or AffinityParams()
    size = 2 * math.ceil((reach + params.wall_thickness) / params.label_cell)
    labels = np.zeros((len(observations), size, size), np.int8)
    for vertex, walls in enumerate(observations):
        labels[vertex] = label_raster(
            walls.distances, walls.free, size, params.label_cell, params.wall_thickness, 3, reach
        )
    points = gaussian_points(N_POINTS, params.spread * reach) / params.label_cell
    return Rasters(labels, points, params.label_cell, np.array([params.both_free, params.both_wall, params.differ]))


@njit(cache=True)
def known_places(labels, x, y, points):
    """Where a raster knows what is at (x, y) + `points` (m, 2), in cells from its middle, (k, 2); the labels (k,)."""
    size = labels.shape[0]
    places, known = np.empty(points.shape), np.empty(points.shape[0], np.int8)
    n = 0
    for p in range(points.shape[0]):
        places[n, 0], places[n, 1] = x + points[p, 0], y + points[p, 1]
        column, row = places[n, 0] + 0.5 * size, places[n, 1] + 0.5 * size
        if 0.0 <= column < size and 0.0 <= row < size and labels[int(row), int(column)] != 0:
            known[n] = labels[int(row), int(column)]
            n += 1
    return places[:n], known[:n]


@njit(cache=True, inline="always")
def agreement(labels, x, y, places, known, scores):
    """Sum of the `scores` of what a raster says at (x, y) + `places` (k, 2), against what is `known` (k,) there."""
    size = labels.shape[0]
    score = 0.0
    for p in range(places.shape[0]):
        column, row = x + places[p, 0], y + places[p, 1]
        if 0.0 <= column < size and 0.0 <= row < size:
            label = labels[int(row), int(column)]
            if label != 0:
                score += scores[2] if known[p] != label else scores[0] if label < 0 else scores[1]
    return score


@njit(cache=True)
def moments(seen, a, b, motion):
    """Mean (3,) and covariance (3, 3) of vertex b's offset from `motion` (3,) in a's frame, in units of the window.

    A test point around the middle of both is the same place in a whatever the offset; points unknown to a say nothing.
    """
    x, y, theta = motion[0] / seen.cell, motion[1] / seen.cell, motion[2]
    window = WINDOW[0] / seen.cell
    places, known = known_places(seen.labels[a], 0.5 * x, 0.5 * y, seen.points)
    labels, half = seen.labels[b], 0.5 * seen.labels.shape[1]
    turned, offset = np.empty(places.shape), np.empty(3)
    means, squares, total = np.zeros(3), np.zeros((3, 3)), 0.0
    for k in range(-STEPS, STEPS + 1):
        offset[2] = 0.5 * k
        cos, sin = math.cos(theta + offset[2] * WINDOW[2]), math.sin(theta + offset[2] * WINDOW[2])
        turned[:, 0] = cos * places[:, 0] + sin * places[:, 1]
        turned[:, 1] = cos * places[:, 1] - sin * places[:, 0]
        for i in range(-STEPS, STEPS + 1):
            for j in range(-STEPS, STEPS + 1):
                offset[0], offset[1] = 0.5 * i, 0.5 * j
                bx, by = x + offset[0] * window, y + offset[1] * window
                start_x, start_y = half - cos * bx - sin * by, half - cos * by + sin * bx
                score = agreement(labels, start_x, start_y, turned, known, seen.scores)
                weight = math.exp(SHARPNESS * score / seen.points.shape[0] - 0.125 * (i * i + j * j + k * k))
                total += weight
                means += weight * offset
                squares += weight * np.outer(offset, offset)
    means /= total
    return means, squares / total - np.outer(means, means)


def measure_loops(path: np.ndarray, seen: Rasters, max_distance: float = 0.8, gap: int = 8) -> Loops:
    """Compare what was seen at the pairs of vertices that lie near each other on the path (v, 3).

    Neighbouring vertices saw the same walls through the same errors of odometry, which would be taken for precision: of
    the pairs within `APART` m of way, the one that tells most is kept.
    """
    pairs = np.empty((len(path), 2), np.int64)
    pairs = pairs[: near_pairs(path, max_distance, 1, gap, pairs)]
    found = [(a, b, *measure(seen, a, b, between(path[a], path[b]))) for a, b in pairs]
    found.sort(key=lambda measured: -float(np.sum(np.minimum(ENOUGH, measured[4]))))
    ways = path_length(path)
    kept: list[float] = []
    rows: list[tuple[int, int, np.ndarray, float, float, int]] = []
    for a, b, directions, offsets, strengths in found:
        if strengths.size and all(abs(ways[b] - way) >= APART for way in kept):
            for direction, offset, strength in zip(directions, offsets, strengths, strict=True):
                rows.append((a, b, direction, WINDOW[0] * offset, WINDOW[0] ** 2 / strength, len(kept)))
            kept.append(float(ways[b]))
    if not rows:
        nothing = np.empty(0, np.int64)
        return Loops(nothing, nothing, np.empty((0, 2)), np.empty(0), np.empty(0), nothing)
    return Loops(*(np.array(column) for column in zip(*rows, strict=True)))


def measure(seen: Rasters, a: int, b: int, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where b is in a's frame, off the `motion` (3,) that the path has between them.

    Directions (r, 2) in which the walls tell, offsets (r,) along them and information (r,), in units of the window. It
    is moved to where the walls agree and looked through again: a likelihood is no Gaussian, and what is seen off the
    window's middle would lean towards it.
    """
    directions, offsets, _, turn = look(seen, a, b, motion)
    moved = np.clip([*(offsets @ directions), turn], -FARTHEST, FARTHEST)
    directions, offsets, strengths, _ = look(seen, a, b, motion + moved * WINDOW)
    return directions, offsets + directions @ moved[:2], strengths


def look(seen: Rasters, a: int, b: int, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """What `measure` returns, through one window around `motion` (3,), and the mean offset of the heading.

    The heading is averaged out: walls drawn while the robot passed them have the average heading of that way, not the
    vertex's own.
    """
    means, covariance = moments(seen, a, b, motion)
    information = np.linalg.inv(covariance[:2, :2] + 1e-6 * np.eye(2))
    strengths, directions = np.linalg.eigh(information - np.eye(2))
    is_seen = strengths > SEEN
    directions, strengths = directions.T[is_seen], strengths[is_seen]
    return directions, directions @ information @ means[:2] / strengths, strengths, float(means[2])
