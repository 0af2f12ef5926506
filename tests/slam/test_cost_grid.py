"""The cost grid against looking at every cell, and what it says of walls, the unknown and the local map."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.cost_grid import CostParams, Surroundings, cost_grid, count_free, count_lines, wall_pieces
from slam.grid import Grid
from slam.walls import Walls
from tests.naive import planning as naive
from tests.naive.walls import cast, rectangle

PARAMS = CostParams()
N_RAYS, REACH = 72, 2.0
ROOM = rectangle(0.0, 0.0, 3.0, 2.0)
NOWHERE = np.zeros((0, 2))


def views(poses):
    """What the poses (n, 3) in a room of 3 by 2 m see."""
    return [cast(pose, ROOM, N_RAYS, REACH) for pose in poses]


@pytest.mark.parametrize("seed", range(4))
def test_free_cells_are_counted_as_by_looking_at_each(seed):
    rng = np.random.default_rng(seed)
    path = np.column_stack([rng.uniform(-1.0, 1.0, (3, 2)), rng.uniform(-4.0, 4.0, 3)])
    free = rng.uniform(0.0, 1.5, (3, 24))
    distances = np.where(rng.random((3, 24)) < 0.5, free + 0.05, np.inf)
    counts = np.zeros((30, 40), np.int32)
    count_free(path, distances, free, -2.0, -1.5, 0.1, counts)
    np.testing.assert_array_equal(counts, naive.count_free(path, distances, free, -2.0, -1.5, 0.1, counts.shape))


def test_a_wall_is_counted_once_by_each_vertex_that_sees_it():
    path = np.array([[0.0, 0.0, 0.3], [0.4, 0.2, -2.0]])
    starts, ends = wall_pieces(path, np.array([walls.distances for walls in views(path)]), 0.3)
    counts = np.zeros((60, 80), np.int32)
    low = np.array([-2.0, -1.5])
    count_lines((starts - low) / 0.05, (ends - low) / 0.05, counts)
    assert set(np.unique(counts)) == {0, 1, 2}
    rows, columns = np.nonzero(counts)
    centres = (np.stack([columns, rows], axis=1) + 0.5) * 0.05 + low
    from_walls = np.minimum(np.abs(1.5 - np.abs(centres[:, 0])), np.abs(1.0 - np.abs(centres[:, 1])))
    assert from_walls.max() < 0.1  # chords cut the corners
    assert len(rows) > 0.9 * 10.0 / 0.05  # the room's 10 m of wall


def test_the_middle_is_cheap_the_walls_are_closed_and_the_unknown_is_dear():
    path = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    grid = cost_grid(path, views(path), np.array([[2.2, 0.0]]), None, PARAMS)
    assert grid.costs[grid.cell(np.zeros(2))] == 1.0
    assert np.isinf(grid.costs[grid.cell(np.array([1.5 - PARAMS.clearance + 0.06, 0.0]))])
    assert grid.costs[grid.cell(np.array([2.2, 0.0]))] == PARAMS.unknown_cost
    near = grid.costs[grid.cell(np.array([0.0, 0.7]))]
    assert 1.0 < near < 1.0 + PARAMS.near_cost


def test_one_vertex_of_many_does_not_close_what_the_others_saw_free():
    path = np.array([[0.05 * k, 0.0, 0.0] for k in range(-5, 5)])
    seen = views(path)
    liar = Walls(np.full(N_RAYS, 0.5), np.full(N_RAYS, 0.4))
    grid = cost_grid(np.vstack([path, np.zeros(3)]), [*seen, liar], NOWHERE, None, PARAMS)
    assert grid.costs[grid.cell(np.array([0.5, 0.0]))] == 1.0


def test_the_local_map_overrules_and_stands_where_the_robot_is():
    path = np.zeros((1, 3))
    cells = np.zeros((40, 40), np.float32)
    cells[20, 30] = 2.0  # 0.525 m ahead of the middle in the local map's frame
    cells[20, 24:28] = -2.0
    around = Surroundings(Grid(cells, 0.05, -1.0, -1.0), np.zeros(3), np.array([0.0, 0.0, 0.5 * math.pi]))
    grid = cost_grid(path, views(path), NOWHERE, around, PARAMS)
    assert np.isinf(grid.costs[grid.cell(np.array([-0.025, 0.525]))])
    assert grid.costs[grid.cell(np.array([0.525, 0.0]))] == 1.0


def test_a_trail_opens_what_the_robot_has_come_through():
    path = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0]])
    wall = Walls(np.full(N_RAYS, 0.25), np.full(N_RAYS, 0.2))  # all around the middle vertex
    seen = [Walls(np.full(N_RAYS, np.inf), np.full(N_RAYS, 0.1))] * 3
    seen[1] = wall
    closed = cost_grid(path, seen, NOWHERE, None, PARAMS)
    assert np.isinf(closed.costs[closed.cell(np.array([0.25, 0.0]))])
    trodden = cost_grid(path, seen, NOWHERE, None, PARAMS.model_copy(update={"trail": 0.15, "clearance": 0.09}))
    for x in np.linspace(0.0, 1.0, 21):
        assert np.isfinite(trodden.costs[trodden.cell(np.array([x, 0.0]))])
    assert np.isinf(trodden.costs[trodden.cell(np.array([0.5, 0.25]))]), "beside the trail it still stands"


def test_nothing_seen_is_a_floor_of_unknown():
    grid = cost_grid(np.zeros((1, 3)), [], np.array([[0.0, 0.0], [3.0, 1.0]]), None, PARAMS)
    assert np.all(grid.costs == PARAMS.unknown_cost)
    for place in (np.zeros(2), np.array([3.0, 1.0])):
        row, column = grid.cell(place)
        assert 0 < row < grid.costs.shape[0]
        assert 0 < column < grid.costs.shape[1]
        np.testing.assert_allclose(grid.places(np.array([[row, column]]))[0], place, atol=0.5 * grid.resolution + 1e-9)


def test_a_far_place_makes_cells_coarser_and_not_more():
    grid = cost_grid(np.zeros((1, 3)), [], np.array([[0.0, 0.0], [900.0, 900.0]]), None, PARAMS)
    assert grid.costs.size <= PARAMS.most_cells
    assert grid.resolution > PARAMS.resolution
