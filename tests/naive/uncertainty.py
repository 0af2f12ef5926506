"""Spreads from all paths in full, weighted; the branches as the set of prefixes of some paths."""

from __future__ import annotations

import numpy as np


def weighted_spread(places, weights):
    """Root of the trace of the covariance of places (n, 2)."""
    mean = weights @ places
    return float(np.sqrt(weights @ np.sum((places - mean) ** 2, axis=1)))


def seen_from(pose, place):
    """A place (2,) in the frame of a pose (3,)."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    x, y = place - pose[:2]
    return np.array([cos * x + sin * y, cos * y - sin * x])


def spreads(paths, weights):
    """Spread (v,) in the world and as seen from the newest vertex, of paths (n, v, 3)."""
    depths = range(paths.shape[1])
    seen = np.array([[seen_from(path[-1], path[depth, :2]) for depth in depths] for path in paths])
    return (
        np.array([weighted_spread(paths[:, depth, :2], weights) for depth in depths]),
        np.array([weighted_spread(seen[:, depth], weights) for depth in depths]),
    )
