"""Walls among echoes, every pair of echoes looked at, directions by eigenvectors."""

from __future__ import annotations

import math

import numpy as np


def wall_normals(points, views, nodes, radius, window):
    """Normals (m, 2) of the walls that points lie on, or zeros."""
    normals = np.zeros_like(points)
    for p in range(len(points)):
        near = [
            q
            for q in range(len(points))
            if math.dist(points[q], points[p]) <= radius
            and abs(nodes[q] - nodes[p]) <= window
            and views[p] @ views[q] > 0.3
        ]
        if len(near) < 4:
            continue
        values, vectors = np.linalg.eigh(np.cov(points[near].T, bias=True))
        if values[1] < 0.05**2 or values[0] > 0.4**2 * values[1]:
            continue
        normals[p] = vectors[:, 0] if vectors[:, 0] @ views[p] < 0.0 else -vectors[:, 0]
    return normals


def partners(points, normals, nodes, gate, like):
    """For each echo, all that may be of the same wall."""
    return [
        {
            q
            for q in range(len(points))
            if nodes[q] != nodes[p]
            and math.dist(points[q], points[p]) <= gate
            and normals[p].any()
            and normals[p] @ normals[q] > like
        }
        for p in range(len(points))
    ]
