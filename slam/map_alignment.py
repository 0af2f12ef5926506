"""Two maps of the same building laid over each other: the rigid motion between their frames, and how well they agree.

Walls are points (n, 2) with unit normals (n, 2). A correlation over all turns and shifts (Fourier transforms of coarse
pictures) proposes, an iterated closest point refines, and whichever lets most walls meet is taken. Nothing needs to be
known of the frames, but a guess is preferred where the walls do not tell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.distance_field import distance_field
from slam.pose import compose, inverse, transform, wrap

TOLERANCE = 0.15  # m
COARSEST = 512  # cells along the pictures that are correlated
FINEST = 0.2  # m per cell of them
RADII = (1.0, 0.6, 0.4, 0.3)  # m within which walls are thought to be the same, from one round to the next
STEPS = 6  # in each round
ALONG = 0.05  # weight of distances along a wall, which corridors leave open, against those across it
N_REFINED = 6  # proposals that are refined
APART = math.radians(12.0)  # between proposals
CLEARLY = 1.1  # times the walls that meet near the guess
NO_MOTION = np.zeros(3)


class Wall(NamedTuple):
    """Points (n, 2) on walls, evenly spaced, and the walls' unit normals (n, 2) there."""

    points: np.ndarray
    normals: np.ndarray


class Agreement(NamedTuple):
    """Shares of the first map's walls that lie within `tolerance` (m) of the second's, and the other way round.

    `median` is the median distance (m) of those that do, nan where none does.
    """

    first: float
    second: float
    median: float
    tolerance: float


def walls_of(curves: Sequence[np.ndarray], step: float = 0.05) -> Wall:
    """Points every `step` m along curves, each (k, 2) with k > 1."""
    points, normals = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for curve in curves:
        edges = np.diff(curve, axis=0)
        lengths = np.hypot(edges[:, 0], edges[:, 1])
        stations = np.concatenate([[0.0], np.cumsum(lengths)])
        if stations[-1] <= 0.0:
            continue
        at = np.linspace(0.0, stations[-1], int(stations[-1] / step) + 2)
        edge = np.clip(np.searchsorted(stations, at, side="right") - 1, 0, len(edges) - 1)
        along = edges[edge] / np.maximum(lengths[edge], 1e-9)[:, None]
        points.append(np.column_stack([np.interp(at, stations, curve[:, axis]) for axis in (0, 1)]))
        normals.append(np.column_stack([-along[:, 1], along[:, 0]]))
    return Wall(np.concatenate(points), np.concatenate(normals))


def moved(wall: Wall, pose: np.ndarray) -> Wall:
    """Walls of a frame that stands at `pose` (3,), in the frame around it."""
    turn = np.array([0.0, 0.0, pose[2]])
    return Wall(transform(pose, wall.points), transform(turn, wall.normals))


def agreement(first: Wall, second: Wall, tolerance: float = TOLERANCE) -> Agreement:
    """How well two maps in one frame agree; nan for a map without walls."""
    if not len(first.points) or not len(second.points):
        return Agreement(math.nan, math.nan, math.nan, tolerance)
    there = nearest(first.points, second.points, tolerance)[1]
    back = nearest(second.points, first.points, tolerance)[1]
    near = np.concatenate([there, back])
    near = near[np.isfinite(near)]
    median = float(np.median(near)) if near.size else math.nan
    return Agreement(float(np.isfinite(there).mean()), float(np.isfinite(back).mean()), median, tolerance)


def align(first: Wall, second: Wall, guess: np.ndarray = NO_MOTION) -> np.ndarray:
    """The pose (3,) of the second map's frame in the first's that lets most walls meet; the guess if one has none.

    Buildings repeat themselves: the pose near the guess is left only for one at which clearly more walls meet.
    """
    if not len(first.points) or not len(second.points):
        return np.array(guess, float)
    thin = Wall(second.points[::2], second.normals[::2])
    best, most = np.array(guess, float), 0.0
    for pose in [guess, *proposals(first, thin)]:
        refined = refine(first, thin, pose)
        found = agreement(first, moved(second, refined))
        if found.first + found.second > most:
            best, most = refined, (found.first + found.second) * (CLEARLY if pose is guess else 1.0)
    return best


def proposals(first: Wall, second: Wall) -> list[np.ndarray]:
    """Poses (3,) at which coarse pictures of the maps correlate best, no two with nearly the same turn."""
    middle = second.points.mean(axis=0)
    span = np.ptp(first.points, axis=0).max() + 2.0 * np.hypot(*(second.points - middle).T).max()
    cell = max(FINEST, float(span) / (COARSEST - 8))
    n = 1 << math.ceil(math.log2(span / cell + 8))
    low = first.points.min(axis=0) - 4.0 * cell
    picture = np.zeros((n, n), bool)
    picture[tuple(((first.points - low) / cell).astype(int).T)] = True
    likelihood = np.exp(-0.5 * (distance_field(picture, 1.0) / 1.5) ** 2)
    transformed = np.conj(np.fft.rfft2(likelihood))
    found: list[tuple[float, np.ndarray]] = []
    for turn in turns(first, second):
        points = transform(np.array([0.0, 0.0, turn]), second.points - middle)
        corner = points.min(axis=0)
        stamp = np.zeros((n, n))
        stamp[tuple(((points - corner) / cell).astype(int).T)] = 1.0
        scores = np.fft.irfft2(np.conj(np.fft.rfft2(stamp) * transformed), s=(n, n))
        row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
        shift = np.array([row - n if row > n // 2 else row, column - n if column > n // 2 else column])
        pose = compose(np.array([*(low + shift * cell - corner), turn]), np.array([*-middle, 0.0]))
        found.append((float(scores[row, column]), pose))
    chosen: list[np.ndarray] = []
    for _, pose in sorted(found, key=lambda proposal: -proposal[0]):
        if len(chosen) < N_REFINED and all(abs(float(wrap(pose[2] - other[2]))) > APART for other in chosen):
            chosen.append(pose)
    return chosen


def turns(first: Wall, second: Wall) -> np.ndarray:
    """Turns to be tried: around those that lay the main wall directions on each other, and a few all around."""
    axes = [np.angle(np.sum((wall.normals @ np.array([1.0, 1j])) ** 4)) / 4.0 for wall in (first, second)]
    near = axes[0] - axes[1] + 0.5 * np.pi * np.arange(4)[:, None] + np.radians(np.arange(-2.0, 3.0))
    return np.concatenate([near.ravel(), np.radians(np.arange(-180.0, 180.0, 6.0))])


def refine(first: Wall, second: Wall, pose: np.ndarray) -> np.ndarray:
    """The pose (3,) of the second map's frame, moved so that its walls come to lie on those of the first nearby.

    Iterated closest point with distances across the first's walls (Chen and Medioni, 1992) and Gauss-Newton steps.
    """
    pose = np.asarray(pose, float)
    for radius in RADII:
        for _ in range(STEPS):
            here = transform(pose, second.points)
            partner, distance = nearest(here, first.points, radius)
            met = partner >= 0
            if met.sum() < 10:
                return pose
            trust = 1.0 - (distance[met] / radius) ** 2
            step = newton_step(here[met], first.points[partner[met]], first.normals[partner[met]], trust, pose)
            pose = compose(step, pose)
            if np.abs(step).max() < 1e-5:
                break
    return pose


def newton_step(
    points: np.ndarray, partners: np.ndarray, normals: np.ndarray, trust: np.ndarray, pose: np.ndarray
) -> np.ndarray:
    """The motion (3,) of points (n, 2) that brings them nearest to their partners; it turns about `pose`'s place."""
    arms = points - pose[:2]
    apart = partners - points
    rows, right = [], []
    for directions, weight in ((normals, 1.0), (normals[:, ::-1] * [1.0, -1.0], ALONG)):
        lever = directions[:, 1] * arms[:, 0] - directions[:, 0] * arms[:, 1]
        share = np.sqrt(weight * trust)
        rows.append(np.column_stack([directions, lever]) * share[:, None])
        right.append(np.sum(directions * apart, axis=1) * share)
    motion = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    about = np.array([pose[0], pose[1], 0.0])
    return compose(compose(about, motion), inverse(about))


def nearest(points: np.ndarray, others: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """For each point (n, 2) the row of the nearest other (m, 2) within `radius` m and its distance; else -1 and inf."""
    cells = np.floor(others / radius).astype(np.int64)
    order = np.lexsort((cells[:, 1], cells[:, 0]))
    cells = cells[order]
    return search(points, others[order], order, cells[:, 0] * SPREAD + cells[:, 1], radius)


SPREAD = 1 << 32  # more than there are cells across


@njit(cache=True)
def search(points, others, order, keys, radius):
    """Nearest neighbours within `radius`; `keys` (m,), ascending, are the cells of that size that the others lie in."""
    n = points.shape[0]
    rows = np.full(n, -1, np.int64)
    distances = np.full(n, np.inf)
    for i in range(n):
        column, row = math.floor(points[i, 0] / radius), math.floor(points[i, 1] / radius)
        least = radius * radius
        for k in range(-1, 2):
            first = np.searchsorted(keys, (column + k) * SPREAD + row - 1)
            last = np.searchsorted(keys, (column + k) * SPREAD + row + 1, side="right")
            for j in range(first, last):
                x, y = points[i, 0] - others[j, 0], points[i, 1] - others[j, 1]
                if x * x + y * y <= least:
                    least = x * x + y * y
                    rows[i] = order[j]
                    distances[i] = math.sqrt(least)
    return rows, distances
