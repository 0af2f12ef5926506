"""The floor that a cart with a bumper may stand on: outlines of free space, and how far their walls are.

An area is known by its walls, straight pieces of polygons; a lattice of distances tells quickly where none is near.
Uses its sibling `thinning`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import contourpy
import numpy as np
from numba import njit

from slam.pose import transform
from slam.thinning import needed

NODES = 100_000  # of the lattice, at most
FINEST = 0.005  # m between them, at least
MARGIN = 0.05  # m around the walls
BETWEEN = math.sqrt(0.5)  # of the spacing: what a distance that is interpolated may be wrong by
MOST_PARTS = 12  # of a turn, by which an area may be symmetric
SMALLEST = 3.0  # cells: the perimeter of a traced outline below which it is noise


class Area(NamedTuple):
    """Walls (n, 4) as x1, y1, x2, y2 in m, and signed distances (rows, columns) from them, positive on free floor.

    Node (0, 0) of the distances stands at (x, y), `spacing` m from its neighbours.
    """

    walls: np.ndarray
    distances: np.ndarray
    spacing: float
    x: float
    y: float


def area_of(outlines: Sequence[np.ndarray]) -> Area:
    """The area within outlines (n, 2), the outer one first, then obstacles; rings are closed if they are not.

    What an even number of outlines surrounds is not floor. ValueError for an outline of fewer than three corners, and
    for coordinates that are not numbers.
    """
    walls = [walls_of_ring(outline, place) for place, outline in enumerate(outlines)]
    if not walls:
        raise ValueError("an area needs an outline")
    together = np.ascontiguousarray(np.concatenate(walls))
    points = together.reshape(-1, 2)
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    spacing = max(FINEST, math.sqrt(float(np.prod(high - low)) / NODES))
    columns, rows = (np.ceil((high - low) / spacing).astype(int) + 1).tolist()
    distances = signed_distances(together, spacing, low[0], low[1], rows, columns)
    return Area(together, distances, spacing, float(low[0]), float(low[1]))


def walls_of_ring(outline: np.ndarray, place: int = 0) -> np.ndarray:
    """Walls (n, 4) around an outline (n, 2), which `place` names in what is raised."""
    ring = np.asarray(outline, float)
    if ring.ndim != 2 or ring.shape[1:] != (2,) or not np.all(np.isfinite(ring)):
        raise ValueError(f"outline {place}: needs corners (x, y) that are numbers")
    if not np.array_equal(ring[0], ring[-1]):
        ring = np.vstack([ring, ring[:1]])
    ring = ring[np.append(True, np.any(np.diff(ring, axis=0) != 0.0, axis=1))]
    if len(ring) < 4:
        raise ValueError(f"outline {place}: needs at least three corners, has {len(ring) - 1}")
    return np.hstack([ring[:-1], ring[1:]])


def outlines_of_grid(
    is_free: np.ndarray, resolution: float, x: float = 0.0, y: float = 0.0, tolerance: float = 0.75
) -> list[np.ndarray]:
    """Outlines (n, 2) of the largest free piece of a grid (rows, columns), the outer one first, then its obstacles.

    (x, y) is the corner of cell (0, 0); the outlines stay within `tolerance` cells of the cells' border, so that a
    wall has its own direction and no staircase's. ValueError where nothing is free.
    """
    padded = np.pad(np.asarray(is_free, float), 1)
    rings = [np.asarray(ring, float) for ring in contourpy.contour_generator(z=padded).lines(0.5)]
    rings = [ring for ring in rings if np.hypot(*np.diff(ring, axis=0).T).sum() >= SMALLEST]
    if not rings:
        raise ValueError("the grid has no free floor")
    outer = max(rings, key=lambda ring: abs(float(surface(ring))))
    within = [
        ring
        for ring in rings
        if ring is not outer and is_within(outer, ring[0]) and surface(ring) * surface(outer) < 0.0
    ]
    found = [straightened(ring, tolerance) for ring in (outer, *within)]
    return [(ring - 0.5) * resolution + np.array([x, y]) for ring in found if len(ring) > 3]


def surface(ring: np.ndarray) -> float:
    """The surface within a closed ring (n, 2), positive if it runs counter-clockwise."""
    return 0.5 * float(np.sum(ring[:-1, 0] * ring[1:, 1] - ring[1:, 0] * ring[:-1, 1]))


def straightened(ring: np.ndarray, tolerance: float) -> np.ndarray:
    """A closed ring (n, 2) with fewer corners, split where it is farthest apart so that no corner is held by chance."""
    start = int(np.argmax(np.hypot(*(ring - ring.mean(axis=0)).T)))
    ring = np.roll(ring[:-1], -start, axis=0)
    ring = np.vstack([ring, ring[:1]])
    middle = int(np.argmax(np.hypot(*(ring - ring[0]).T)))
    there, back = np.ascontiguousarray(ring[: middle + 1]), np.ascontiguousarray(ring[middle:])
    return np.vstack([there[needed(there, tolerance)][:-1], back[needed(back, tolerance)]])


def is_within(ring: np.ndarray, point: np.ndarray) -> bool:
    """Whether a point (2,) lies within a closed ring (n, 2)."""
    return bool(is_inside(np.hstack([ring[:-1], ring[1:]]), float(point[0]), float(point[1])))


def symmetries(area: Area, tolerance: float) -> np.ndarray:
    """Motions (m, 3) that lay an area on itself to within `tolerance` m, the one that does nothing first.

    Such a motion turns about the centre of all walls, by a part of a whole turn; mirrored rooms are told apart by who
    drives in them.
    """
    ends = area.walls.reshape(-1, 2, 2)
    lengths = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    centre = lengths @ ends.mean(axis=1) / lengths.sum()
    places = np.concatenate([ends[:, 0], ends.mean(axis=1)])
    found = [np.zeros(3)]
    for parts in range(2, MOST_PARTS + 1):
        for turns in range(1, parts):
            if math.gcd(turns, parts) > 1:
                continue
            motion = np.array([*centre, 2.0 * math.pi * turns / parts])
            motion[:2] -= transform(np.array([0.0, 0.0, motion[2]]), centre)
            if all(nearest_wall(area.walls, x, y)[0] <= tolerance for x, y in transform(motion, places)):
                found.append(motion)
    return np.array(found)


@njit(cache=True)
def is_inside(walls, x, y):
    """Whether a ray from the point to the right crosses an odd number of walls (n, 4)."""
    inside = False
    for x1, y1, x2, y2 in walls:
        if (y1 > y) != (y2 > y) and x < x1 + (y - y1) / (y2 - y1) * (x2 - x1):
            inside = not inside
    return inside


@njit(cache=True)
def nearest_wall(walls, x, y):
    """Distance of the nearest of walls (n, 4), the place on it, and its row."""
    best, best_x, best_y, best_wall = math.inf, x, y, -1
    for wall in range(walls.shape[0]):
        x1, y1 = walls[wall, 0], walls[wall, 1]
        dx, dy = walls[wall, 2] - x1, walls[wall, 3] - y1
        along = min(1.0, max(0.0, ((x - x1) * dx + (y - y1) * dy) / (dx * dx + dy * dy)))
        near_x, near_y = x1 + along * dx, y1 + along * dy
        distance = math.hypot(x - near_x, y - near_y)
        if distance < best:
            best, best_x, best_y, best_wall = distance, near_x, near_y, wall
    return best, best_x, best_y, best_wall


@njit(cache=True)
def signed_distances(walls, spacing, x, y, rows, columns):
    """Distances (rows, columns) of lattice nodes from the walls, negative off the floor."""
    distances = np.empty((rows, columns))
    for row in range(rows):
        for column in range(columns):
            node_x, node_y = x + spacing * column, y + spacing * row
            distance = nearest_wall(walls, node_x, node_y)[0]
            distances[row, column] = distance if is_inside(walls, node_x, node_y) else -distance
    return distances


@njit(cache=True)
def clearance(area, x, y):
    """Distance (m) to the nearest wall, negative off the floor; interpolated, within `BETWEEN` times the spacing."""
    rows, columns = area.distances.shape
    column, row = (x - area.x) / area.spacing, (y - area.y) / area.spacing
    inner_column, inner_row = min(max(column, 0.0), columns - 1.0), min(max(row, 0.0), rows - 1.0)
    beyond = area.spacing * math.hypot(column - inner_column, row - inner_row)
    j, i = min(int(inner_column), columns - 2), min(int(inner_row), rows - 2)
    u, v = inner_column - j, inner_row - i
    below = (1.0 - u) * area.distances[i, j] + u * area.distances[i, j + 1]
    above = (1.0 - u) * area.distances[i + 1, j] + u * area.distances[i + 1, j + 1]
    return (1.0 - v) * below + v * above - beyond


@njit(cache=True)
def outward_normal(area, x, y):
    """Unit vector that points straight out through the wall nearest to a place."""
    distance, near_x, near_y, wall = nearest_wall(area.walls, x, y)
    if distance > 1e-9:
        sign = 1.0 if is_inside(area.walls, x, y) else -1.0
        return sign * (near_x - x) / distance, sign * (near_y - y) / distance
    dx, dy = area.walls[wall, 2] - area.walls[wall, 0], area.walls[wall, 3] - area.walls[wall, 1]
    length = math.hypot(dx, dy)
    normal_x, normal_y = dy / length, -dx / length
    sign = -1.0 if is_inside(area.walls, x + 1e-6 * normal_x, y + 1e-6 * normal_y) else 1.0
    return sign * normal_x, sign * normal_y


@njit(cache=True, inline="always")
def along_arc(x, y, heading, way, curvature):
    """The pose after `way` m of an arc."""
    half = 0.5 * curvature * way
    chord = way * (1.0 - half * half / 6.0) if abs(half) < 1e-4 else way * math.sin(half) / half
    return x + chord * math.cos(heading + half), y + chord * math.sin(heading + half), heading + 2.0 * half
