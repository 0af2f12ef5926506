"""Standard deviations and spreads from all paths in full, weighted."""

from __future__ import annotations

import numpy as np


def weighted_spread(places, weights):
    """Root of the trace of the covariance of places (n, 1 or 2)."""
    mean = weights @ places
    return float(np.sqrt(weights @ np.sum((places - mean) ** 2, axis=1)))


def seen_from(pose, place):
    """A place (2,) in the frame of a pose (3,)."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    x, y = place - pose[:2]
    return np.array([cos * x + sin * y, cos * y - sin * x])


def mean_length(headings, weights):
    """Length of the mean of unit vectors at headings (n,)."""
    return float(np.hypot(weights @ np.cos(headings), weights @ np.sin(headings)))


def deviations(paths, weights):
    """Of paths (n, v, 3), by vertex (v,): deviation of x and of y, mean length, spread seen from the newest."""
    depths = range(paths.shape[1])
    seen = np.array([[seen_from(path[-1], path[depth, :2]) for depth in depths] for path in paths])
    return (
        np.array([weighted_spread(paths[:, depth, :1], weights) for depth in depths]),
        np.array([weighted_spread(paths[:, depth, 1:2], weights) for depth in depths]),
        np.array([mean_length(paths[:, depth, 2], weights) for depth in depths]),
        np.array([weighted_spread(seen[:, depth], weights) for depth in depths]),
    )
