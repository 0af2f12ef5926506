"""The map that a path and what its vertices saw amount to: walls in the world, and an occupancy grid.

Knows no robot, no filter and no file; `map_picture` draws it and `map_files` writes it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from server.formats.ros_map import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from server.messages import Label
from slam.cost_grid import count_free
from slam.pose import transform
from slam.thinning import needed
from slam.walls import Walls, curves

RESOLUTION = 0.05  # m per cell, where the grid stays within MAX_CELLS
MAX_CELLS = 4000  # along either side of a grid; one jump of the odometry may stretch a map over kilometres
TRAIL_POINTS = 20_000  # of a drawn trajectory
FINE = 0.01  # m per cell of what a small robot swept
TREMBLING = 0.02  # m that a path may be off when its length is told
MARGIN = 0.5  # m of unknown around what was seen
OCCUPIED_SHARE = (
    0.25  # of the vertices that looked at a cell and saw a wall in it; paths are never exact, walls are thin
)


class FloorMap(NamedTuple):
    """What is drawn and stored: `path` (n, 3), `walls` curves (k, 2) in the world, how many first vertices are settled.

    Where there is a `trail`, two arrays (k, 3) of poses, settled and open, it is drawn instead of the path's chords.
    `spread` (n,) m is the standard deviation of each vertex, where that is known.
    """

    path: np.ndarray
    walls: list[np.ndarray]
    settled: int = 0
    grid: OccupancyMap | None = None
    trail: tuple[np.ndarray, np.ndarray] | None = None
    labels: Sequence[Label] = ()
    spread: np.ndarray | None = None


def floor_map(path: np.ndarray, walls: list[Walls], fixed_depth: int = 0, resolution: float = RESOLUTION) -> FloorMap:
    """The map of a path (n, 3) and what its vertices saw."""
    return FloorMap(path, world_curves(path, walls), fixed_depth + 1, occupancy(path, walls, resolution))


def world_curves(path: np.ndarray, walls: list[Walls]) -> list[np.ndarray]:
    """Every vertex's wall curves, each (k, 2) with k > 1, in the world."""
    found = []
    for pose, seen in zip(path, walls, strict=True):
        found.extend(transform(pose, curve) for curve in curves(seen) if len(curve) > 1)
    return found


def occupancy(path: np.ndarray, walls: list[Walls], resolution: float = RESOLUTION) -> OccupancyMap:
    """Cells that vertices saw free, those that they saw walls in, and unknown ones; coarser where MAX_CELLS asks so."""
    resolution = affordable(path, walls, resolution)
    low, shape = extent(path, walls, resolution)
    free = np.zeros(shape, np.int32)
    occupied = np.zeros(shape, np.int32)
    if walls:
        distances, ways = (np.stack(columns) for columns in zip(*walls, strict=True))
        count_free(path, distances, ways, low[0], low[1], resolution, free)
    for pose, seen in zip(path, walls, strict=True):
        count_walls(occupied, low, resolution, pose, seen)
    cells = np.full(shape, UNKNOWN, np.int8)
    cells[free > 0] = FREE
    cells[(occupied > 0) & (occupied >= OCCUPIED_SHARE * (free + occupied))] = OCCUPIED
    return OccupancyMap(cells, resolution, (float(low[0]), float(low[1]), 0.0))


def reach_of(seen: Walls) -> float:
    """How far a vertex saw anything."""
    finite = seen.distances[np.isfinite(seen.distances)]
    return float(max(finite.max(initial=0.0), seen.free.max(initial=0.0)))


def extent(path: np.ndarray, walls: list[Walls], resolution: float) -> tuple[np.ndarray, tuple[int, int]]:
    """Corner (2,), on a multiple of the resolution, and (rows, columns) of a grid that holds everything seen."""
    if not len(path):
        return np.zeros(2), (1, 1)
    low, high = seen_box(path, walls)
    low = np.floor(low / resolution) * resolution
    columns, rows = np.ceil((high - low) / resolution).astype(int)
    return low, (int(rows), int(columns))


def seen_box(path: np.ndarray, walls: list[Walls]) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner (2,) of everything seen, with the margin."""
    if not len(path):
        return np.zeros(2), np.zeros(2)
    reach = np.array([reach_of(seen) for seen in walls])[:, None] + MARGIN
    return (path[:, :2] - reach).min(axis=0), (path[:, :2] + reach).max(axis=0)


def affordable(path: np.ndarray, walls: list[Walls], resolution: float) -> float:
    """The resolution, doubled until a grid of everything seen stays within MAX_CELLS."""
    low, high = seen_box(path, walls)
    doublings = math.log2(max(float((high - low).max()) / ((MAX_CELLS - 1) * resolution), 1.0))
    return resolution * 2.0 ** math.ceil(doublings)


def count_walls(occupied: np.ndarray, low: np.ndarray, resolution: float, pose: np.ndarray, seen: Walls) -> None:
    """Add one to the cells that a vertex's wall curves pass through."""
    points = [densify(transform(pose, curve), 0.5 * resolution) for curve in curves(seen)]
    if points:
        cells = np.unique(((np.concatenate(points) - low) / resolution).astype(int), axis=0)
        occupied[cells[:, 1], cells[:, 0]] += 1


def densify(curve: np.ndarray, step: float) -> np.ndarray:
    """Points (m, 2) along a curve (k, 2), no two neighbours farther apart than `step`."""
    if len(curve) < 2:
        return curve
    lengths = np.hypot(*np.diff(curve, axis=0).T)
    stations = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.linspace(0.0, stations[-1], int(stations[-1] / step) + 2)
    return np.column_stack([np.interp(at, stations, curve[:, 0]), np.interp(at, stations, curve[:, 1])])


def path_length(path: np.ndarray, tolerance: float = 0.0) -> float:
    """Metres along a path (n, 3), or along one that is nowhere farther from it than a tolerance (m).

    Who stands still trembles on the map by what scans err by, and makes no way.
    """
    places = path[needed(np.ascontiguousarray(path[:, :2]), tolerance), :2] if tolerance > 0.0 else path[:, :2]
    return float(np.hypot(*np.diff(places, axis=0).T).sum()) if len(places) > 1 else 0.0


def trail_of(trajectory: np.ndarray, rows: np.ndarray, settled: int) -> tuple[np.ndarray, np.ndarray]:
    """The settled and the open part of a trajectory (n, 3) whose vertices stand at `rows`, thinned for drawing."""
    joint = int(rows[min(settled, len(rows)) - 1]) if settled else 0
    step = max(1, len(trajectory) // TRAIL_POINTS)
    return trajectory[: joint + 1 : step], np.concatenate([trajectory[joint::step], trajectory[-1:]])


def swept_map(trajectory: np.ndarray, walls: list[np.ndarray], width: float, ahead: float) -> OccupancyMap:
    """Cells that a robot's body swept on its way are free, those on walls are not, of others nothing is known.

    The way is poses (n, 3), walls are curves (k, 2), the body is `width` m wide and reaches `ahead` m forward.
    """
    points = np.concatenate([trajectory[:, :2], *walls])
    low = np.floor((points.min(axis=0) - MARGIN) / FINE) * FINE
    columns, rows = np.ceil((points.max(axis=0) + MARGIN - low) / FINE).astype(int)
    cells = np.full((rows, columns), UNKNOWN, np.int8)
    half = 0.5 * width
    sides = (np.arange(start, end, 0.5 * FINE) for start, end in ((0.0, ahead), (-half, half)))
    body = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(trajectory[:, :2], axis=0).T))])
    turn = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(trajectory[:, 2])))])
    steps = np.floor((way + ahead * turn) / FINE)
    for pose in trajectory[np.unique(steps, return_index=True)[1]]:
        mark(cells, low, transform(pose, body), FREE)
    for wall in walls:
        mark(cells, low, densify(wall, 0.5 * FINE), OCCUPIED)
    return OccupancyMap(cells, FINE, (float(low[0]), float(low[1]), 0.0))


def mark(cells: np.ndarray, low: np.ndarray, points: np.ndarray, value: int) -> None:
    """Set the cells of points (n, 2) that lie in the grid."""
    columns, rows = ((points - low) / FINE).astype(int).T
    inside = (rows >= 0) & (columns >= 0) & (rows < cells.shape[0]) & (columns < cells.shape[1])
    cells[rows[inside], columns[inside]] = value
