"""Ways over a cost grid: the cheapest ones, pulled straight, clear of walls; and the reasons why there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.cost_grid import CostGrid, CostParams, price
from slam.distance_field import distance_field
from slam.planning import NoWay, line_cost, plan, reach, reach_from
from tests.naive import planning as naive

CELL = 0.05
PARAMS = CostParams()


def floor(rows, columns, walls=()):
    """A known floor with walls in the given slices of cells."""
    is_wall = np.zeros((rows, columns), bool)
    for part in walls:
        is_wall[part] = True
    room = distance_field(is_wall, CELL)
    return CostGrid(price(room, np.ones_like(is_wall), PARAMS), room, np.ones_like(is_wall), CELL, 0.0, 0.0)


def length(start, places):
    """Metres of the way from the start through the places."""
    return float(np.hypot(*np.diff(np.vstack([start, places]), axis=0).T).sum())


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_every_cell_is_reached_as_cheaply_as_can_be(rows, columns, seed):
    rng = np.random.default_rng(seed)
    costs = np.where(rng.random((rows, columns)) < 0.3, np.inf, rng.uniform(1.0, 5.0, (rows, columns)))
    start = int(rng.integers(rows)), int(rng.integers(columns))
    costs[start] = 1.0
    cost, metres, before = reach(costs, start[0] * columns + start[1], -1)
    np.testing.assert_allclose(cost.reshape(rows, columns), naive.reach(costs, start))
    np.testing.assert_array_equal(np.isfinite(cost), np.isfinite(metres))
    assert np.all((before >= 0) == (np.isfinite(cost) & (cost > 0.0)))


def test_free_floor_is_crossed_in_one_straight_line():
    start, goal = np.array([0.52, 0.61]), np.array([4.13, 2.27])
    route = plan(floor(60, 100), start, goal)
    np.testing.assert_allclose(route.places, [goal])
    assert route.metres == pytest.approx(math.dist(start, goal))


def test_a_wall_is_walked_around_with_room_to_spare():
    grid = floor(80, 80, [np.s_[0:60, 40]])  # open above 3 m
    start, goal = np.array([1.0, 1.0]), np.array([3.0, 1.0])
    route = plan(grid, start, goal)
    around = 2.0 * math.dist((1.0, 1.0), (2.0, 3.0 + PARAMS.clearance))
    assert around - 0.1 < route.metres == pytest.approx(length(start, route.places))
    assert route.metres < around + 0.8
    for a, b in zip(np.vstack([start, route.places[:-1]]), route.places, strict=True):
        for share in np.linspace(0.0, 1.0, 50):
            assert grid.room[grid.cell(a + share * (b - a))] >= PARAMS.clearance


def test_the_middle_of_a_wide_door_is_better_than_its_edge():
    grid = floor(80, 80, [np.s_[0:30, 40], np.s_[54:80, 40]])  # 1.2 m wide
    route = plan(grid, np.array([1.0, 1.0]), np.array([3.0, 1.0]))
    crossing = min(
        (np.array([1.0, 1.0]), *route.places), key=lambda place: abs(place[0] - 2.0)
    )  # a corner of the way stands in the door
    assert grid.room[grid.cell(crossing)] > 0.3


def test_a_longer_way_on_known_floor_beats_a_shorter_one_into_the_unknown():
    room = np.full((40, 80), 9.0)
    is_known = np.ones((40, 80), bool)
    is_known[0:30, 30:50] = False
    grid = CostGrid(price(room, is_known, PARAMS), room, is_known, CELL, 0.0, 0.0)
    start, goal = np.array([1.0, 1.0]), np.array([3.0, 1.0])
    assert plan(grid, start, goal).places[:, 1].max() > 1.45
    is_known[:] = False
    blind = CostGrid(price(room, is_known, PARAMS), room, is_known, CELL, 0.0, 0.0)
    assert len(plan(blind, start, goal).places) == 1


def test_lines_cost_what_their_cells_cost():
    costs = np.ones((20, 20))
    costs[:, 10:] = 3.0
    assert line_cost(costs, 5.0, 2.0, 15.0, 2.0) == pytest.approx(5.0 + 15.0, rel=0.05)
    costs[5, 10] = np.inf
    assert math.isinf(line_cost(costs, 5.0, 5.5, 15.0, 5.5))


def test_a_closed_room_has_no_way_out():
    grid = floor(80, 80, [np.s_[20, 20:61], np.s_[60, 20:61], np.s_[20:61, 20], np.s_[20:61, 60]])
    with pytest.raises(NoWay, match="walls close every way"):
        plan(grid, np.array([2.0, 2.0]), np.array([0.4, 0.4]))


def test_a_place_inside_a_wall_is_refused_and_one_beside_it_is_moved_off():
    grid = floor(80, 80, [np.s_[:, 40:60]])
    with pytest.raises(NoWay, match="too close to a wall"):
        plan(grid, np.array([1.0, 1.0]), np.array([2.5, 2.0]))
    end = plan(grid, np.array([1.0, 1.0]), np.array([1.92, 2.0])).places[-1]
    assert grid.room[grid.cell(end)] >= PARAMS.clearance
    assert math.dist(end, (1.92, 2.0)) < 0.3


def test_a_robot_close_to_a_wall_gets_away_and_not_through():
    grid = floor(80, 80, [np.s_[:, 40]])
    with pytest.raises(NoWay):
        plan(grid, np.array([1.92, 1.0]), np.array([3.0, 1.0]))
    route = plan(grid, np.array([1.92, 1.0]), np.array([1.0, 1.0]))
    np.testing.assert_allclose(route.places[-1], [1.0, 1.0])


def test_distances_to_everywhere_are_metres_of_the_way():
    grid = floor(60, 60)
    reached = reach_from(grid, np.array([1.025, 1.025]))
    there = grid.cell(np.array([2.025, 1.025]))
    assert reached.metres[there[0] * 60 + there[1]] == pytest.approx(1.0)
