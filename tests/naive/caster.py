"""Slow twins of firmware/virtual/caster.c: every ray against every wall, by the textbook's formulas."""

import numpy as np


def cast(segments: np.ndarray, x: float, y: float, bearing: float, reach: float) -> float:
    """Range to the first of segments (n, 4), inf beyond `reach`."""
    start, end = segments[:, :2], segments[:, 2:]
    along, direction = end - start, np.array([np.cos(bearing), np.sin(bearing)])
    nearest = np.inf
    for p, e in zip(start - np.array([x, y]), along, strict=True):
        matrix = np.column_stack([direction, -e])
        if np.linalg.det(matrix) == 0.0:
            continue
        t, u = np.linalg.solve(matrix, p)
        if 0.0 <= t < min(nearest, reach) and 0.0 <= u <= 1.0:
            nearest = float(t)
    return nearest


def clearance(segments: np.ndarray, x: float, y: float) -> float:
    """Distance of a point from the nearest of segments (n, 4)."""
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    offset = np.array([x, y]) - start
    part = np.clip(np.sum(offset * along, axis=1) / np.sum(along**2, axis=1), 0.0, 1.0)
    return float(np.min(np.hypot(*(offset - part[:, None] * along).T)))
