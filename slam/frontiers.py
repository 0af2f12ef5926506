"""Where the known floor ends: frontiers, between what was seen free and what nobody has seen (Yamauchi, CIRA 1997).

A frontier that a robot can reach leads on; when there is none left, the map is closed. Uses its siblings `cost_grid`
and `planning`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydantic import Field
from scipy.ndimage import binary_dilation, label

from slam.cost_grid import CostGrid
from slam.params import Params
from slam.planning import let_out, reach_from

ROUND = np.ones((3, 3), bool)  # a cell and its eight neighbours


class FrontierParams(Params):
    """Which frontiers count, and what makes one worth the way."""

    least: float = Field(default=0.2, gt=0.0)  # m; shorter ones are gaps between beams
    gain: float = Field(default=1.0, ge=0.0)  # m of way that a metre of frontier is worth
    near: float = Field(default=0.1, ge=0.0)  # m; nearer ones are looked at from where the robot stands


class Frontier(NamedTuple):
    """A `place` (2,) on it that is reached first, its length and the way there in m."""

    place: np.ndarray
    length: float
    way: float


def frontiers(grid: CostGrid, start: np.ndarray, params: FrontierParams) -> list[Frontier]:
    """The frontiers that can be reached over known floor from a place (2,), the one worth most first."""
    grid = let_out(grid, start)
    unknown = ~grid.known
    beside: np.ndarray = np.asarray(binary_dilation(unknown, ROUND))
    edge = grid.known & np.isfinite(grid.costs) & beside
    known_only = grid._replace(costs=np.where(unknown, np.inf, grid.costs).astype(np.float32))
    metres = reach_from(known_only, start).metres.reshape(grid.costs.shape)
    labels = np.zeros(edge.shape, np.int32)
    label(edge & np.isfinite(metres), ROUND, labels)
    found = []
    for number in range(1, int(labels.max()) + 1):
        cells = np.argwhere(labels == number)
        length = grid.resolution * float(np.max(np.ptp(cells, axis=0)) + 1)
        if length < params.least:
            continue
        ways = metres[cells[:, 0], cells[:, 1]]
        first = int(np.argmin(ways))
        if ways[first] < params.near and length < 2.0 * params.least:
            continue
        place = grid.places(cells[first : first + 1])[0]
        found.append(Frontier(place, length, float(ways[first])))
    return sorted(found, key=lambda frontier: (frontier.way - params.gain * frontier.length, tuple(frontier.place)))
