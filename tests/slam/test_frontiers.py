"""Frontiers are where known floor that can be reached ends, the one worth most first; a closed floor has none."""

import numpy as np
import pytest

from slam.cost_grid import CostGrid, CostParams, price
from slam.distance_field import distance_field
from slam.frontiers import FrontierParams, frontiers

CELL = 0.05
PARAMS = FrontierParams()


def floor(is_wall, is_known):
    """A grid of walls and of what is known, both (rows, columns)."""
    room = distance_field(is_wall, CELL)
    return CostGrid(price(room, is_known, CostParams()), room, is_known, CELL, 0.0, 0.0)


def hall(rows=60, columns=100):
    """Walls around; nothing known."""
    walls = np.zeros((rows, columns), bool)
    walls[0], walls[-1], walls[:, 0], walls[:, -1] = True, True, True, True
    return walls, np.zeros((rows, columns), bool)


def test_the_border_of_the_known_is_one_frontier():
    walls, known = hall()
    known[:, :50] = True
    [found] = frontiers(floor(walls, known), np.array([1.0, 1.5]), PARAMS)
    assert found.place[0] == pytest.approx(49.5 * CELL)
    assert found.way == pytest.approx(49.5 * CELL - 1.0, abs=0.1)
    assert found.length == pytest.approx(60 * CELL, abs=0.5)  # but for where walls are too near


def test_a_closed_floor_has_none():
    walls, known = hall()
    known[:] = True
    assert frontiers(floor(walls, known), np.array([1.0, 1.5]), PARAMS) == []


def test_what_lies_behind_walls_is_none():
    walls, known = hall()
    walls[:, 49] = True
    known[:, :60] = True
    assert frontiers(floor(walls, known), np.array([1.0, 1.5]), PARAMS) == []


def test_gaps_between_beams_are_none_and_the_nearer_and_longer_comes_first():
    walls, known = hall()
    known[:, 20:80] = True
    known[30, 50] = False
    found = frontiers(floor(walls, known), np.array([1.5, 1.5]), PARAMS)
    assert [float(each.place[0]) for each in found] == pytest.approx([20.5 * CELL, 79.5 * CELL])
    assert found[0].way < found[1].way
    known[25:35, 50:60] = False
    [nearest, *_] = frontiers(floor(walls, known), np.array([2.0, 1.5]), FrontierParams(gain=0.0))
    assert 49 * CELL < nearest.place[0] < 51 * CELL
