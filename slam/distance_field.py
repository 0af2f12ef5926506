"""Distance from every cell of a grid to the nearest wall: exact, and linear in the number of cells."""

from __future__ import annotations

import numpy as np
from numba import njit


def distance_field(is_wall: np.ndarray, resolution: float) -> np.ndarray:
    """Distances (rows, columns) in m from each cell's centre to that of the nearest True cell; inf if there is none."""
    is_wall = np.ascontiguousarray(is_wall, bool)
    if not is_wall.any():
        return np.full(is_wall.shape, np.inf)
    return resolution * np.sqrt(squared_distances(is_wall))


@njit(cache=True)
def squared_distances(is_wall):
    """Squared distances (rows, columns) in cells; at least one cell must be a wall."""
    rows, columns = is_wall.shape
    along_columns = column_distances(is_wall)
    squares = np.empty((rows, columns))
    vertices = np.empty(columns, np.int64)
    borders = np.empty(columns + 1)
    for row in range(rows):
        heights = along_columns[row] * along_columns[row]
        lower_envelope(heights, vertices, borders, squares[row])
    return squares


@njit(cache=True)
def column_distances(is_wall):
    """Distances in cells to the nearest wall of the same column; rows + columns, beyond any, where it has none."""
    rows, columns = is_wall.shape
    distances = np.empty((rows, columns))
    for column in range(columns):
        since = float(rows + columns)
        for row in range(rows):
            since = 0.0 if is_wall[row, column] else since + 1.0
            distances[row, column] = since
        since = float(rows + columns)
        for row in range(rows - 1, -1, -1):
            since = 0.0 if is_wall[row, column] else since + 1.0
            distances[row, column] = min(distances[row, column], since, float(rows + columns))
    return distances


@njit(cache=True)
def parabola_crossing(heights, i, j):
    """Where the parabolas of i and a later j meet; left of it i's is the lower one."""
    return 0.5 * ((heights[j] + j * j) - (heights[i] + i * i)) / (j - i)


@njit(cache=True)
def lower_envelope(heights, vertices, borders, squares):
    """Write min over j of (i - j)^2 + heights[j] into squares[i].

    Felzenszwalb and Huttenlocher, Distance transforms of sampled functions, Theory of Computing 8, 2012, section 2.
    `vertices` (n,) and `borders` (n + 1,) are scratch: the envelope's parabolas, and where each takes over.
    """
    n = heights.size
    last = 0
    vertices[0] = 0
    borders[0], borders[1] = -np.inf, np.inf
    for j in range(1, n):
        crossing = parabola_crossing(heights, vertices[last], j)
        while crossing <= borders[last]:  # the newer parabola hides the last one; the first border is -inf and stays
            last -= 1
            crossing = parabola_crossing(heights, vertices[last], j)
        last += 1
        vertices[last] = j
        borders[last], borders[last + 1] = crossing, np.inf
    parabola = 0
    for i in range(n):
        while borders[parabola + 1] < i:
            parabola += 1
        j = vertices[parabola]
        squares[i] = (i - j) * (i - j) + heights[j]
