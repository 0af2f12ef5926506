"""Where to drive so that an uncertain stretch of the path is seen again: what it would settle, against the way there.

Standing at an old vertex's place again, the walls tell where that vertex lies as seen from the robot, and how it is
turned. What this would settle follows from the branches of the path tree as samples of all paths: to first order, a
measurement takes from every vertex's covariance what it shares with the measured place.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from slam.params import Params
from slam.pose import between
from slam.uncertainty import Branches


class SuggestionParams(Params):
    """When a place is worth the way, and how many are named."""

    sigma: float = Field(default=0.1, gt=0.0)  # m, of where a place seen again is said to be
    turn_sigma: float = Field(default=0.1, gt=0.0)  # rad, of how it is said to be turned
    least_gain: float = Field(default=0.15, gt=0.0)  # m
    farthest: float = Field(default=80.0, gt=0.0)  # m to drive
    fixed_way: float = Field(default=4.0, gt=0.0)  # m added to every way, so that a near place of no worth stays behind
    most: int = Field(default=3, ge=0)
    apart: float = Field(default=3.0, ge=0.0)  # m between two that are named


class Suggestion(NamedTuple):
    """Drive `drive` m to `place` (2,), where `vertex` is: the uncertain stretch would be known `gain` m better."""

    place: np.ndarray
    vertex: int
    gain: float
    drive: float


def sampled_paths(branches: Branches) -> np.ndarray:
    """Paths (m, v, 3) from the root to each leaf of the branches."""
    deepest = int(branches.depths.max())
    rows = np.flatnonzero(branches.depths == deepest)
    paths = np.empty((rows.size, deepest + 1, 3))
    for depth in range(deepest, -1, -1):
        paths[:, depth] = branches.poses[rows]
        rows = branches.parents[rows]
    return paths


def gains(paths: np.ndarray, noise: tuple[float, float, float]) -> np.ndarray:
    """By how many m (v,) seeing each vertex again from the newest would lower the spread of the uncertain stretch.

    That stretch is where the spread is at least half of its greatest; the gain is the mean along it. `noise` are the
    standard deviations of x, y and heading of a place seen again.
    """
    places = paths[..., :2] - paths[..., :2].mean(axis=0)
    variances = np.mean(np.sum(places**2, axis=2), axis=0)
    is_uncertain = variances >= 0.25 * variances.max()
    stretch = places[:, is_uncertain].reshape(len(paths), -1)
    seen = between(paths[:, -1:], paths)
    headings = np.exp(1j * seen[..., 2])
    seen -= seen.mean(axis=0)
    seen[..., 2] = np.angle(headings / headings.mean(axis=0))
    found = np.empty(paths.shape[1])
    for vertex in range(paths.shape[1]):
        measured = seen[:, vertex]
        noisy = measured.T @ measured / len(paths) + np.diag(np.square(noise))
        shared = np.linalg.solve(np.linalg.cholesky(noisy), measured.T @ stretch / len(paths))
        settled = np.sum((shared**2).reshape(3, -1, 2), axis=(0, 2))
        left = np.maximum(variances[is_uncertain] - settled, 0.0)
        found[vertex] = np.mean(np.sqrt(variances[is_uncertain]) - np.sqrt(left))
    return found


def suggest(path: np.ndarray, branches: Branches, drives: np.ndarray, params: SuggestionParams) -> list[Suggestion]:
    """The best places to drive to, best first; `drives` (v,) are the m to drive to each vertex of `path` (v, 3)."""
    paths = sampled_paths(branches)
    n = min(len(path), paths.shape[1])
    if len(paths) < 2 or n < 2:
        return []
    gained = gains(paths, (params.sigma, params.sigma, params.turn_sigma))[:n]
    worth = np.where(
        (gained >= params.least_gain) & (drives[:n] <= params.farthest), gained / (drives[:n] + params.fixed_way), 0.0
    )
    found: list[Suggestion] = []
    for vertex in np.argsort(-worth, kind="stable"):
        place = path[vertex, :2]
        if worth[vertex] == 0.0 or len(found) == params.most:
            break
        if all(math.dist(place, other.place) >= params.apart for other in found):
            found.append(Suggestion(place, int(vertex), float(gained[vertex]), float(drives[vertex])))
    return found
