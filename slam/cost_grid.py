"""What a metre costs where: the floor of the best map as a planner needs it.

Cells that a vertex or the local map saw free cost 1, those near walls more, those that nobody has seen more again.
Where the robot's body would touch a wall there is no way. Counts of vertices that saw a cell free or a wall in it
settle what is a wall, so that a path that is a little off does not close a door.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.distance_field import distance_field
from slam.grid import Grid
from slam.params import Params
from slam.pose import inverse, transform
from slam.walls import Walls


class CostParams(Params):
    """Size of the cells, and what walls and the unknown cost."""

    resolution: float = Field(default=0.05, gt=0.0)  # m; doubled until the grid has at most `most_cells`
    most_cells: int = Field(default=600_000, gt=0)
    margin: float = Field(default=1.0, gt=0.0)  # m of unknown around everything seen
    wall_share: float = Field(
        default=0.25, gt=0.0, le=1.0
    )  # of the vertices that looked at a cell and saw a wall in it
    jump: float = Field(default=0.15, gt=0.0)  # m between neighbouring rays that part two curves
    occupied: float = Field(
        default=0.6, gt=0.0
    )  # log odds of the local map from which there is a wall, whatever was seen
    free: float = Field(default=-1.0, lt=0.0)  # log odds of the local map up to which there is none
    clearance: float = Field(default=0.18, gt=0.0)  # m from a wall below which the robot's centre cannot be
    comfort: float = Field(default=0.5, gt=0.0)  # m from a wall below which a metre costs more
    near_cost: float = Field(default=5.0, ge=0.0)  # added at the clearance, falling to none at the comfort
    unknown_cost: float = Field(default=4.0, ge=1.0)
    trail: float = Field(default=0.0, ge=0.0)  # m beside the path where no wall is believed: the robot has been there


class CostGrid(NamedTuple):
    """`costs` (rows, columns) float32 per metre, inf where there is no way; the rest as in `slam.grid.Grid`.

    `room` (rows, columns) is the distance in m to the nearest wall, `known` (rows, columns) what anybody has seen.
    """

    costs: np.ndarray
    room: np.ndarray
    known: np.ndarray
    resolution: float
    x: float
    y: float

    def cell(self, place: np.ndarray) -> tuple[int, int]:
        """Row and column of a place (2,), perhaps outside."""
        return math.floor((place[1] - self.y) / self.resolution), math.floor((place[0] - self.x) / self.resolution)

    def places(self, cells: np.ndarray) -> np.ndarray:
        """Centres (n, 2) of cells (n, 2) given as row and column."""
        return (cells[:, ::-1] + 0.5) * self.resolution + np.array([self.x, self.y])


class Surroundings(NamedTuple):
    """The local map, the robot's pose (3,) in its frame, and the same pose (3,) in the world."""

    grid: Grid
    pose_in_grid: np.ndarray
    pose: np.ndarray


@njit(cache=True, nogil=True)
def count_free(path, distances, free, x, y, resolution, counts):
    """Add one to the cells of `counts` whose centres lie nearer to a vertex than their ray was seen free."""
    n_rays = free.shape[1]
    turn = n_rays / (2.0 * math.pi)
    for vertex in range(path.shape[0]):
        u, v, theta = (path[vertex, 0] - x) / resolution, (path[vertex, 1] - y) / resolution, path[vertex, 2]
        reach = free[vertex].max() / resolution
        for row in range(max(0, math.floor(v - reach)), min(counts.shape[0], math.ceil(v + reach) + 1)):
            for column in range(max(0, math.floor(u - reach)), min(counts.shape[1], math.ceil(u + reach) + 1)):
                across, up = column + 0.5 - u, row + 0.5 - v
                distance = math.sqrt(across * across + up * up)
                if distance >= reach:
                    continue
                ray = round((math.atan2(up, across) - theta) * turn) % n_rays
                if distance < min(free[vertex, ray] / resolution, distances[vertex, ray] / resolution - 0.5):
                    counts[row, column] += 1


@njit(cache=True, nogil=True)
def count_lines(starts, ends, counts):
    """Add one to the cells of `counts` that lines pass through, once for all lines of a set.

    `starts` and `ends` (sets, n, 2) are x and y in cells; a line with a nan is none.
    """
    last = np.full(counts.shape, -1, np.int32)  # set that counted in a cell last
    for group in range(starts.shape[0]):
        for line in range(starts.shape[1]):
            x, y = starts[group, line]
            across, up = ends[group, line, 0] - x, ends[group, line, 1] - y
            if not math.isfinite(across + up):
                continue
            steps = math.ceil(2.0 * math.hypot(across, up)) + 1
            for k in range(steps):
                row, column = math.floor(y + up * k / steps), math.floor(x + across * k / steps)
                is_inside = 0 <= row < counts.shape[0] and 0 <= column < counts.shape[1]
                if is_inside and last[row, column] != group:
                    last[row, column] = group
                    counts[row, column] += 1


def wall_pieces(path: np.ndarray, distances: np.ndarray, jump: float) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends (v, n, 2) in the world of the pieces of wall between neighbouring rays; nan where there is none.

    A ray whose neighbour sees another wall or none gives a piece without length.
    """
    n_rays = distances.shape[1]
    angles = path[:, 2:] + 2.0 * np.pi * np.arange(n_rays) / n_rays
    reached = np.where(np.isfinite(distances), distances, np.nan)
    starts = path[:, None, :2] + reached[..., None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    is_joined = np.abs(np.roll(reached, -1, axis=1) - reached) <= jump
    return starts, np.where(is_joined[..., None], np.roll(starts, -1, axis=1), starts)


def cost_grid(
    path: np.ndarray, seen: Sequence[Walls], places: np.ndarray, around: Surroundings | None, params: CostParams
) -> CostGrid:
    """The floor that the vertices at `path` (n, 3) and the local map saw, so wide that it holds `places` (k, 2)."""
    distances = np.stack([walls.distances for walls in seen]) if seen else np.zeros((0, 1))
    free = np.stack([walls.free for walls in seen]) if seen else np.zeros((0, 1))
    path = np.asarray(path[: len(seen)], float)  # before the first vertex there is a path of one pose
    starts, ends = wall_pieces(path, distances, params.jump)
    low, high = seen_box(path, free, starts, places, around)
    low, high = low - params.margin, high + params.margin
    resolution = params.resolution
    while np.prod(np.ceil((high - low) / resolution)) > params.most_cells:
        resolution *= 2.0
    columns, rows = (int(side) for side in np.ceil((high - low) / resolution))
    counts = np.zeros((2, rows, columns), np.int32)
    count_free(path, distances, free, low[0], low[1], resolution, counts[0])
    count_lines((starts - low) / resolution, (ends - low) / resolution, counts[1])
    is_wall = (counts[1] > 0) & (counts[1] >= params.wall_share * counts.sum(axis=0))
    is_known: np.ndarray = counts.sum(axis=0) > 0
    if params.trail > 0.0:
        is_trodden = near_path((path[:, :2] - low) / resolution, is_wall.shape, params.trail / resolution)
        is_wall &= ~is_trodden
        is_known |= is_trodden
    if around is not None:
        overrule(is_wall, is_known, around, low, resolution, params)
    room = distance_field(is_wall, resolution)
    return CostGrid(price(room, is_known, params), room, is_known, resolution, float(low[0]), float(low[1]))


def seen_box(
    path: np.ndarray, free: np.ndarray, walls: np.ndarray, places: np.ndarray, around: Surroundings | None
) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner (2,) of what was seen and of `places` (k, 2)."""
    walls = walls[np.isfinite(walls).all(axis=-1)]
    reach = free.max(axis=1, initial=0.0)[:, None]
    points = [path[:, :2] - reach, path[:, :2] + reach, walls, np.reshape(places, (-1, 2))]
    if around is not None:
        reach_around = around.grid.resolution * max(around.grid.cells.shape)
        points += [around.pose[None, :2] - reach_around, around.pose[None, :2] + reach_around]
    held = np.concatenate(points)
    return held.min(axis=0), held.max(axis=0)


def near_path(path: np.ndarray, shape: tuple[int, ...], reach: float) -> np.ndarray:
    """Cells (rows, columns) whose centres lie within `reach` of the chords of a path (n, 2); all in cells."""
    counts = np.zeros(shape, np.int32)
    count_lines(path[None, :-1], path[None, 1:], counts)
    return distance_field(counts > 0, 1.0) <= reach


def overrule(
    is_wall: np.ndarray,
    is_known: np.ndarray,
    around: Surroundings,
    low: np.ndarray,
    resolution: float,
    params: CostParams,
) -> None:
    """Put what the local map is certain of into the grid: free cells first, so that a wall beside them stays."""
    grid = around.grid
    for is_there, makes_wall in ((grid.cells < params.free, False), (grid.cells > params.occupied, True)):
        rows, columns = np.nonzero(is_there)
        centres = (np.stack([columns, rows], axis=1) + 0.5) * grid.resolution + np.array([grid.x, grid.y])
        world = transform(around.pose, transform(inverse(around.pose_in_grid), centres))
        cells = np.floor((world - low) / resolution).astype(int)
        is_wall[cells[:, 1], cells[:, 0]] = makes_wall
        is_known[cells[:, 1], cells[:, 0]] = True


def price(room: np.ndarray, is_known: np.ndarray, params: CostParams) -> np.ndarray:
    """Cost (rows, columns) of a metre, from the distance to the nearest wall and whether anybody saw the cell."""
    nearness = np.clip((params.comfort - room) / max(params.comfort - params.clearance, 1e-9), 0.0, 1.0)
    costs = np.where(is_known, 1.0, params.unknown_cost) + params.near_cost * nearness**2
    return np.where(room < params.clearance, np.inf, costs).astype(np.float32)
