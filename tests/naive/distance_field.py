"""Distance to the nearest wall by trying every wall."""

from __future__ import annotations

import math

import numpy as np


def distance_field(is_wall, resolution):
    """Distances (rows, columns) between cells' centres; inf without a wall."""
    walls = [tuple(cell) for cell in np.argwhere(is_wall)]
    distances = np.full(is_wall.shape, math.inf)
    for row, column in np.ndindex(*is_wall.shape):
        for wall_row, wall_column in walls:
            distance = resolution * math.hypot(row - wall_row, column - wall_column)
            distances[row, column] = min(distances[row, column], distance)
    return distances
