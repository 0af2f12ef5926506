"""Where weighted poses lie together, and how many particles such a belief needs.

A cluster is what lies within a cart's size of its own mean, so that one which is told as a pose means that pose; an
ambiguous map shows as several (flat-kernel mean shift, Cheng, IEEE PAMI 17, 1995, from the densest place on).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.pose import wrap

ROUNDS = 10  # of mean shift
SMALLEST = 0.01  # share of the weight that a cluster has at least
MOST = 8  # clusters that are told


class Cluster(NamedTuple):
    """Mean pose (3,), covariance (3, 3) about it, and the share of the weight."""

    pose: np.ndarray
    covariance: np.ndarray
    share: float


class Belief(NamedTuple):
    """Where a robot may be: clusters, the heaviest first, and whether it is sure enough of that one to be there."""

    clusters: list[Cluster]
    is_localized: bool


def clusters(poses: np.ndarray, weights: np.ndarray, size: float, turn: float) -> list[Cluster]:
    """Clusters of poses (n, 3) with weights (n,) that sum to one, the heaviest first.

    Each is an ellipsoid of `size` m and `turn` rad about its mean; what lies in none of them is in no list.
    """
    left = np.array(weights, float)
    found = []
    while len(found) < MOST and left.sum() > SMALLEST:
        mean = densest(poses, left, size, turn)
        for _ in range(ROUNDS):
            near = within(poses, mean, size, turn) & (left > 0.0)
            moved = mean_pose(poses[near], left[near])
            if not np.any(within(poses, moved, size, turn) & (left > 0.0)):
                break
            is_there = np.max(np.abs(moved - mean)) < 1e-6
            mean = moved
            if is_there:
                break
        near = within(poses, mean, size, turn) & (left > 0.0)
        found.append(cluster_of(poses[near], left[near]))
        left[near] = 0.0
    return sorted((one for one in found if one.share >= SMALLEST), key=lambda one: -one.share)


def cluster_of(poses: np.ndarray, weights: np.ndarray) -> Cluster:
    """The cluster that these poses (n, 3) make."""
    mean = mean_pose(poses, weights)
    off = np.column_stack([poses[:, :2] - mean[:2], wrap(poses[:, 2] - mean[2])])
    share = float(weights.sum())
    return Cluster(mean, (off * weights[:, None]).T @ off / share, share)


def mean_pose(poses: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted mean (3,) of poses (n, 3), of the headings as directions."""
    x, y = weights @ poses[:, :2] / weights.sum()
    return np.array([x, y, math.atan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))])


def within(poses: np.ndarray, centre: np.ndarray, size: float, turn: float) -> np.ndarray:
    """Which of poses (n, 3) are in the ellipsoid of `size` m and `turn` rad about a pose, (n,) bool."""
    off = poses[:, :2] - centre[:2]
    return np.sum(off * off, axis=1) / size**2 + wrap(poses[:, 2] - centre[2]) ** 2 / turn**2 <= 1.0


def densest(poses: np.ndarray, weights: np.ndarray, size: float, turn: float) -> np.ndarray:
    """The mean pose (3,) of the heaviest bin of half the ellipsoid's axes."""
    _, row = np.unique(bins_of(poses, 0.5 * size, 0.5 * turn), return_inverse=True)
    heaviest = row == int(np.argmax(np.bincount(row, weights)))
    return mean_pose(poses[heaviest], np.maximum(weights[heaviest], 1e-300))


def bins_of(poses: np.ndarray, size: float, turn: float) -> np.ndarray:
    """Numbers (n,) of the bins of poses (n, 3): `size` m wide, and as many of about `turn` rad as go into a turn."""
    around = max(1, round(2.0 * math.pi / turn))
    headings = np.floor(np.mod(poses[:, 2], 2.0 * math.pi) / (2.0 * math.pi) * around).astype(np.int64) % around
    columns, rows = (np.floor(poses[:, :2] / size).astype(np.int64) % (1 << 20)).T
    return (headings << 40) | (rows << 20) | columns


@njit(cache=True)
def enough_particles(n_bins, error, quantile):
    """How many particles keep a belief of so many occupied bins within `error` of the true one (Fox 2003, eq. 7).

    The error is a Kullback-Leibler distance; `quantile` is of the standard normal distribution, for the probability
    that it is kept.
    """
    if n_bins < 2:
        return 1
    k = n_bins - 1
    part = 2.0 / (9.0 * k)
    return math.ceil(0.5 * k / error * (1.0 - part + math.sqrt(part) * quantile) ** 3)
