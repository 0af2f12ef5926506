"""From occupancy grids to walls: contours traced at one half, straightened until they stay within about a cell.

A staircase of cells would answer a sonar from the wrong directions; a straightened contour has the wall's own normal.
"""

from __future__ import annotations

import contourpy
import numpy as np

MIN_PERIMETER = 3.0  # cells; smaller blobs are noise


def simplify(points: np.ndarray, tolerance: float) -> np.ndarray:
    """Points (k, 2) of a polyline (n, 2) that stays within `tolerance` of all of it (Douglas & Peucker 1973)."""
    keep = np.zeros(len(points), bool)
    keep[[0, -1]] = True
    pending = [(0, len(points) - 1)]
    while pending:
        first, last = pending.pop()
        if last - first < 2:
            continue
        chord = points[last] - points[first]
        length = np.hypot(*chord)
        offsets = points[first + 1 : last] - points[first]
        if length > 0.0:
            along = np.clip(offsets @ chord / length**2, 0.0, 1.0)
            offsets = offsets - along[:, None] * chord
        distances = np.hypot(offsets[:, 0], offsets[:, 1])
        farthest = int(np.argmax(distances))
        if distances[farthest] > tolerance:
            middle = first + 1 + farthest
            keep[middle] = True
            pending += [(first, middle), (middle, last)]
    return points[keep]


def simplify_ring(ring: np.ndarray, tolerance: float) -> np.ndarray:
    """The same for a closed ring (first point repeated last), split at its two most distant points."""
    start = int(np.argmax(np.hypot(*(ring - ring.mean(axis=0)).T)))
    ring = np.roll(ring[:-1], -start, axis=0)
    ring = np.vstack([ring, ring[:1]])
    middle = int(np.argmax(np.hypot(*(ring - ring[0]).T)))
    return np.vstack([simplify(ring[: middle + 1], tolerance)[:-1], simplify(ring[middle:], tolerance)])


def trace_walls(occupied: np.ndarray, resolution: float, x: float, y: float, tolerance: float = 0.75) -> np.ndarray:
    """Segments (n, 4) around what is above one half in `occupied` (rows, columns), values 0..1.

    (x, y) is the corner of cell (0, 0), `tolerance` in cells. Thin walls get two sides, as real ones have.
    """
    padded = np.pad(occupied, 1)
    rings = contourpy.contour_generator(z=padded).lines(0.5)
    segments = []
    for ring in rings:
        ring = np.asarray(ring, float)
        if np.sum(np.hypot(*np.diff(ring, axis=0).T)) < MIN_PERIMETER:
            continue
        corners = simplify_ring(ring, tolerance)
        if len(corners) > 2:
            segments.append(np.hstack([corners[:-1], corners[1:]]))
    if not segments:
        return np.empty((0, 4))
    return (np.vstack(segments) - 0.5) * resolution + np.array([x, y, x, y])  # centre of cell 0 is 0.5; padding took 1
