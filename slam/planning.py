"""The way to a place over a cost grid: Dijkstra's algorithm on eight neighbours, then pulled straight.

From Dijkstra, A note on two problems in connexion with graphs, Numerische Mathematik 1, 1959. The pulling lets a way
leave the grid's eight directions wherever the straight line costs no more than the way along the cells did.
"""

from __future__ import annotations

import heapq
import itertools
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.cost_grid import CostGrid

SLACK = 1.01  # by which a straight line may cost more than the cells it replaces
ESCAPE = 0.35  # m around the robot within which a place too near a wall is left again, at a price
ESCAPE_COST = 20.0
NEAR_ENOUGH = 0.3  # m from a closed place at which the way may begin or end


class NoWay(ValueError):
    """There is no way; the text says why, for people."""


class Route(NamedTuple):
    """`places` (r, 2) to pass in order, the last one where it ends, and its length in m from the start."""

    places: np.ndarray
    metres: float


class Reached(NamedTuple):
    """By cell (rows x columns,): cost of the cheapest way there, its m, and the cell before; inf, inf and -1 else."""

    cost: np.ndarray
    metres: np.ndarray
    before: np.ndarray


@njit(cache=True, nogil=True)
def reach(costs, start, goal):
    """The cheapest ways from cell `start`, as `Reached`; until `goal` is reached, or to everywhere if that is -1.

    Cells are numbered row by row. A step costs its length in cells times the mean of its two cells' costs.
    """
    rows, columns = costs.shape
    cost = np.full(rows * columns, np.inf)
    metres = np.full(rows * columns, np.inf)
    before = np.full(rows * columns, -1, np.int32)
    cost[start] = metres[start] = 0.0
    border = [(0.0, start)]
    while len(border) > 0:
        spent, cell = heapq.heappop(border)
        if cell == goal:
            break
        if spent > cost[cell]:
            continue  # it was reached more cheaply since
        row, column = cell // columns, cell % columns
        for up in range(max(0, row - 1), min(rows, row + 2)):
            for across in range(max(0, column - 1), min(columns, column + 2)):
                length = math.sqrt((up - row) ** 2 + (across - column) ** 2)
                total = spent + 0.5 * length * (costs[row, column] + costs[up, across])
                other = up * columns + across
                if total < cost[other]:
                    cost[other] = total
                    metres[other] = metres[cell] + length
                    before[other] = cell
                    heapq.heappush(border, (total, other))
    return cost, metres, before


@njit(cache=True, nogil=True)
def line_cost(costs, x, y, other_x, other_y):
    """Cost of the straight line between two places given in cells, inside the grid; inf across closed cells."""
    length = math.hypot(other_x - x, other_y - y)
    steps = math.ceil(2.0 * length) + 1
    total = 0.0
    for k in range(steps):
        share = (k + 0.5) / steps
        total += costs[math.floor(y + share * (other_y - y)), math.floor(x + share * (other_x - x))]
    return total * length / steps


@njit(cache=True, nogil=True)
def pull_straight(costs, way, cost, slack):
    """Rows of `way` (n, 2) that are kept: each leads to the next in a straight line that costs no more than the way.

    `way` holds places (x, y) in cells, `cost` (n,) what the way cost up to each.
    """
    kept = [0]
    here = 0
    for k in range(2, way.shape[0]):
        straight = line_cost(costs, way[here, 0], way[here, 1], way[k, 0], way[k, 1])
        if not straight <= slack * (cost[k] - cost[here]):
            here = k - 1
            kept.append(here)
    kept.append(way.shape[0] - 1)
    return np.array(kept)


def let_out(grid: CostGrid, place: np.ndarray) -> CostGrid:
    """The grid with the closed cells around the robot's `place` (2,) made passable, except the walls themselves.

    A robot may stand nearer to a wall than it would go.
    """
    row, column = grid.cell(place)
    reach = math.ceil(ESCAPE / grid.resolution)
    part = np.s_[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
    costs = grid.costs.copy()
    is_passable = np.isinf(costs[part]) & (grid.room[part] > 1.5 * grid.resolution)  # diagonal walls leave no gap
    costs[part][is_passable] = ESCAPE_COST
    return grid._replace(costs=costs)


def nearest_open(grid: CostGrid, place: np.ndarray) -> tuple[int, int] | None:
    """The cell of a place (2,), or the nearest one that is not closed; None if all near ones are."""
    row, column = grid.cell(place)
    reach = math.ceil(NEAR_ENOUGH / grid.resolution)
    first = np.array([max(0, row - reach), max(0, column - reach)])
    part = grid.costs[first[0] : row + reach + 1, first[1] : column + reach + 1]
    cells = np.argwhere(np.isfinite(part)) + first
    if not len(cells):
        return None
    squares = np.sum((cells - np.array([row, column])) ** 2, axis=1)
    nearest = cells[np.argmin(squares)]
    return (int(nearest[0]), int(nearest[1])) if squares.min() <= reach**2 else None


def reach_from(grid: CostGrid, start: np.ndarray, goal: tuple[int, int] | None = None) -> Reached:
    """The cheapest ways from a place (2,), to one cell or to all; NoWay where the robot cannot move at all."""
    cell = nearest_open(grid, start)
    if cell is None:
        raise NoWay("walls are all around the robot")
    columns = grid.costs.shape[1]
    cost, metres, before = reach(
        grid.costs, cell[0] * columns + cell[1], -1 if goal is None else goal[0] * columns + goal[1]
    )
    return Reached(grid.resolution * cost, grid.resolution * metres, before)


def plan(grid: CostGrid, start: np.ndarray, goal: np.ndarray) -> Route:
    """The cheapest way between two places (2,) in the grid; NoWay if there is none.

    It ends in the goal itself, or, where that is too near to a wall, as near to it as the robot can stand.
    """
    grid = let_out(grid, start)
    end = nearest_open(grid, goal)
    if end is None:
        raise NoWay("that place is too close to a wall")
    columns = grid.costs.shape[1]
    reached = reach_from(grid, start, end)
    cells = trace_back(reached.before, end[0] * columns + end[1])
    if len(cells) == 1 and not reached.cost[cells[0]] == 0.0:
        raise NoWay("walls close every way there")
    way = np.stack([cells % columns, cells // columns], axis=1) + 0.5
    kept = pull_straight(grid.costs, way, reached.cost[cells] / grid.resolution, SLACK)
    places = way[kept] * grid.resolution + np.array([grid.x, grid.y])
    places[0] = start
    if end == grid.cell(goal):
        places[-1] = goal
    return Route(places[1:], float(np.hypot(*np.diff(places, axis=0).T).sum()))


def trace_back(before: np.ndarray, cell: int) -> np.ndarray:
    """Cells (n,) of the way to a cell, from its start."""
    cells = [cell]
    while before[cells[-1]] >= 0:
        cells.append(int(before[cells[-1]]))
    return np.array(cells[::-1])


def way_cost(grid: CostGrid, place: np.ndarray, places: np.ndarray) -> float:
    """Cost of going from a place (2,) straight to each of `places` (n, 2) in turn; inf where a wall is in the way."""
    points = (np.vstack([place, places]) - np.array([grid.x, grid.y])) / grid.resolution
    if np.any(points < 0.0) or np.any(points >= grid.costs.shape[::-1]):
        return math.inf
    return grid.resolution * sum(line_cost(grid.costs, *a, *b) for a, b in itertools.pairwise(points))
