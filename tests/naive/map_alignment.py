"""Nearest neighbours by looking at all of them."""

from __future__ import annotations

import numpy as np


def nearest(points: np.ndarray, others: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Row of the nearest other within the radius and its distance; -1 and inf where there is none."""
    rows, distances = [], []
    for point in points:
        apart = [float(np.hypot(*(point - other))) for other in others]
        row = int(np.argmin(apart)) if apart else -1
        is_near = bool(apart) and apart[row] <= radius
        rows.append(row if is_near else -1)
        distances.append(apart[row] if is_near else np.inf)
    return np.array(rows), np.array(distances)
