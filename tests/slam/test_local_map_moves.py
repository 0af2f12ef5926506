"""The local map follows the robot: by whole cells without blur, or resampled as in the thesis, which blurs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.grid import Grid
from slam.local_map import LocalMap, LocalMapParams, resample_cells, shift_cells
from slam.rangefinder import RingParams, crunch_sensors
from tests.naive import local_map as naive

RESOLUTION = 0.025


def noisy(seed, n=48):
    """A grid of random log odds within the clamp."""
    cells = np.random.default_rng(seed).uniform(-2.5, 2.5, (n, n)).astype(np.float32)
    return Grid(cells, RESOLUTION, -0.5 * n * RESOLUTION, -0.5 * n * RESOLUTION)


def value_at(grid, x, y):
    place = naive.cell_of(grid, x, y)
    assert place is not None
    return float(grid.cells[place])


def upright_map(**changes):
    """A local map of one forward-looking beam and its parameters."""
    params = LocalMapParams.model_validate({"reach": 1.0, "footprint": 0.0} | changes)
    return LocalMap(params, {"laser": RingParams(model="beam", bearings_deg=(0.0,), max_range=4.0)})


@pytest.mark.parametrize(("columns", "rows"), [(0, 0), (1, 0), (0, -3), (-5, 4), (7, 7), (-12, 0), (30, -40)])
def test_shift_agrees_with_place_by_place(columns, rows):
    cells = noisy(1, 12).cells
    np.testing.assert_array_equal(shift_cells(cells, columns, rows), naive.shift_cells(cells, columns, rows))


def test_what_left_the_window_is_forgotten():
    cells = noisy(2, 12).cells
    there_and_back = shift_cells(shift_cells(cells, 5, -2), -5, 2)
    np.testing.assert_array_equal(there_and_back[:10, 5:], cells[:10, 5:])
    assert not there_and_back[10:].any()
    assert not there_and_back[:, :5].any()


@pytest.mark.parametrize("seed", range(6))
def test_resampling_agrees_with_every_cell_asking_every_cell(seed):
    rng = np.random.default_rng(seed)
    cells, (x, y, theta) = noisy(seed, 16).cells, rng.uniform(-0.15, 0.15, 3) * [1.0, 1.0, 20.0]
    expected = naive.resample_cells(cells, RESOLUTION, x, y, theta)
    np.testing.assert_allclose(resample_cells(cells, RESOLUTION, x, y, theta), expected, atol=1e-5)


def test_resampling_by_nothing_changes_nothing():
    cells = noisy(3, 20).cells
    np.testing.assert_array_equal(resample_cells(cells, RESOLUTION, 0.0, 0.0, 0.0), cells)


def test_resampling_by_whole_cells_is_a_shift():
    cells = noisy(4, 20).cells
    moved = resample_cells(cells, RESOLUTION, 3 * RESOLUTION, -2 * RESOLUTION, 0.0)
    np.testing.assert_allclose(moved, shift_cells(cells, 3, -2), atol=1e-5)


def test_resampling_blurs_a_wall_and_keeps_its_mass():
    """The price of the thesis's own way: ten moves of 4 mm spread one cell over many."""
    cells = np.zeros((40, 40), np.float32)
    cells[20, 30] = 2.0
    for _ in range(10):
        cells = resample_cells(cells, RESOLUTION, 0.004, 0.001, 0.0)
    assert cells.sum() == pytest.approx(2.0, rel=1e-5)
    assert cells.max() < 0.8
    assert np.count_nonzero(cells > 0.01) > 6
    rows, columns = np.indices(cells.shape)
    centroid = (np.sum(cells * columns) / 2.0, np.sum(cells * rows) / 2.0)
    assert centroid == pytest.approx((30 - 0.04 / RESOLUTION, 20 - 0.01 / RESOLUTION), abs=1e-3)


def test_a_map_that_moves_by_whole_cells_does_not_blur():
    local_map = upright_map()
    local_map.fuse("laser", np.array([0.5]), np.zeros(3))
    before = local_map.cells.max()
    for step in range(1, 11):
        local_map.move(np.array([0.004 * step, 0.001 * step, 0.1 * step]))
    assert local_map.cells.max() == before
    assert value_at(local_map.grid(), 0.5, 0.0) == before


@settings(max_examples=60)
@given(st.lists(st.tuples(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), st.floats(-9, 9)), min_size=1, max_size=8))
def test_moving_keeps_the_world_where_it_was(poses):
    """While the start stays inside the window, its surroundings are found at their places in the odometry frame."""
    local_map = upright_map()
    local_map.cells[:] = noisy(5, len(local_map.cells)).cells
    before = local_map.grid()._replace(cells=local_map.cells.copy())
    for pose in poses:
        local_map.move(np.array(pose))
    after = local_map.grid()
    low = np.array([after.x, after.y])
    high = low + len(after.cells) * RESOLUTION
    assert np.all(low <= np.array(poses[-1][:2]) - 1.0 + RESOLUTION)
    assert np.all(high >= np.array(poses[-1][:2]) + 1.0 - RESOLUTION)
    for x, y in ((0.0125, 0.0125), (0.0375, -0.0625)):
        assert value_at(after, x, y) == value_at(before, x, y)


def test_a_resampled_map_turns_with_the_robot():
    local_map = upright_map(resample=True)
    local_map.move(np.zeros(3))
    for _ in range(5):
        local_map.fuse("laser", np.array([0.5]), np.zeros(3))
    local_map.move(np.array([0.1, 0.0, math.pi / 2]))
    grid = local_map.grid()
    rows, columns = np.nonzero(grid.cells > 1.0)
    x, y = grid.x + (columns + 0.5) * RESOLUTION, grid.y + (rows + 0.5) * RESOLUTION
    np.testing.assert_allclose([np.mean(x), np.mean(y)], [0.0, -0.4], atol=1.5 * RESOLUTION)
    np.testing.assert_allclose(local_map.in_grid(np.array([0.1, 0.5, math.pi / 2])), [0.5, 0.0, 0.0], atol=1e-9)


def test_the_reach_follows_the_farthest_sensor():
    sensors = crunch_sensors()
    params = LocalMapParams(reach=None, reach_share=0.5)
    assert LocalMap(params, sensors).reach == pytest.approx(1.5)
    assert LocalMap(params, {"infrared": sensors["infrared"]}).reach == 1.0
    assert LocalMap(LocalMapParams(reach=0.7), sensors).reach == 0.7


def test_cells_grow_with_the_reach_so_that_their_number_is_bounded():
    for reach, resolution in ((1.0, 0.025), (2.0, 0.025), (8.0, 0.1)):
        local_map = upright_map(reach=reach, finest_cell=0.025, cells_per_reach=80)
        assert local_map.resolution == pytest.approx(resolution)
        assert 2.0 * reach <= local_map.cells.shape[0] * local_map.resolution < 2.4 * reach


def test_a_border_keeps_what_lies_behind():
    for border, is_kept in ((0.0, False), (1.0, True)):
        params = LocalMapParams(reach=1.0, footprint=0.0)
        local_map = LocalMap(params, {"laser": RingParams(model="beam", bearings_deg=(180.0,), max_range=4.0)}, border)
        assert local_map.reach == 1.0
        local_map.fuse("laser", np.array([0.5]), np.zeros(3))
        local_map.move(np.array([0.9, 0.0, 0.0]))
        assert bool((local_map.cells > 0.0).any()) == is_kept


def test_the_robot_stands_on_free_floor():
    local_map = upright_map(footprint=0.12)
    for pose in np.random.default_rng(10).uniform(-0.5, 0.5, (5, 3)):
        local_map.cells[:] = 2.5
        local_map.fuse("laser", np.array([math.nan]), pose)
        assert value_at(local_map.grid(), pose[0], pose[1]) == -2.5
        freed = np.count_nonzero(local_map.cells < 0.0) * RESOLUTION**2
        assert freed == pytest.approx(math.pi * 0.12**2, rel=0.1)


def test_an_unknown_sensor_is_an_error():
    with pytest.raises(KeyError, match="radar"):
        upright_map().fuse("radar", np.array([1.0]), np.zeros(3))
