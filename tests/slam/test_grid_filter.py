"""The filter of grids maps a ring of corridors with bad odometry, the same way each time, and shares its maps."""

import numpy as np
import pytest

from slam.evaluate import absolute_error
from slam.grid_filter import GridFilter, GridFilterParams
from slam.tree_map import NONE
from tests.slam.laser_world import BEARINGS, around, odometry_of, ranges_of, ring

STILL = np.zeros(3)


def drive(laps=1.3, seed=0):
    """True poses, odometry, and what the laser saw."""
    rng = np.random.default_rng(seed)
    poses = around(laps)
    return poses, odometry_of(poses, rng), [ranges_of(pose, ring(), rng) for pose in poses]


def run(odometry, scans, particles=8, seed=0, threads=1):
    path_filter = GridFilter(GridFilterParams(particles=particles), BEARINGS, STILL, seed, threads)
    for pose, ranges in zip(odometry, scans, strict=True):
        path_filter.extend(pose, ranges)
    return path_filter


@pytest.mark.parametrize("seed", range(3))
def test_a_ring_is_mapped_though_the_odometry_is_lost(seed):
    poses, odometry, scans = drive(seed=seed)
    path_filter = run(odometry, scans, seed=seed)
    assert absolute_error(odometry, poses).translation.rmse > 0.5
    found = absolute_error(path_filter.path(), poses)
    assert found.translation.rmse < 0.1
    assert found.rotation.max < 0.1
    assert path_filter.n_scans == len(poses)


def test_the_map_shows_the_walls_once_and_the_floor_free():
    poses, odometry, scans = drive()
    path_filter = run(odometry, scans)
    grid = path_filter.maps.grid(path_filter.best())
    assert path_filter.path()[0] == pytest.approx(poses[0], abs=1e-6)
    rows, columns = np.nonzero(grid.cells > 1.0)
    xs, ys = grid.x + (columns + 0.5) * grid.resolution, grid.y + (rows + 0.5) * grid.resolution
    walls = ring()
    along, start = walls[:, 2:] - walls[:, :2], walls[:, :2]
    places = np.stack([xs, ys], axis=1)[:, None, :] - start
    share = np.clip(np.sum(places * along, axis=2) / np.sum(along**2, axis=1), 0.0, 1.0)
    apart = np.hypot(*(places - share[:, :, None] * along).transpose(2, 0, 1)).min(axis=1)
    assert np.mean(apart < 0.15) > 0.97
    floor = [grid.cells[int((y - grid.y) / grid.resolution), int((x - grid.x) / grid.resolution)] for x, y, _ in poses]
    assert np.mean(np.array(floor) < 0.0) > 0.99


def test_threads_change_nothing_and_seeds_do():
    _, odometry, scans = drive(laps=0.3)
    first, second, third = (run(odometry, scans, 5, seed, threads) for seed, threads in ((1, 1), (1, 2), (2, 1)))
    assert first.path().tobytes() == second.path().tobytes()
    assert first.maps.grid(0).cells.tobytes() == second.maps.grid(0).cells.tobytes()
    assert first.path().tobytes() != third.path().tobytes()


def test_memory_grows_with_the_map_and_not_with_the_particles():
    _, odometry, scans = drive()
    few, many = run(odometry, scans, 4), run(odometry, scans, 40)
    assert many.resamplings > 0
    assert many.maps.n_patches < 9 * few.maps.n_patches
    named = np.count_nonzero(many.maps.cells.table != NONE)
    assert many.maps.n_patches < 0.8 * named


def test_scans_of_nothing_are_survived_on_the_odometry_alone():
    odometry = np.column_stack([np.arange(10) * 0.2, np.zeros(10), np.zeros(10)])
    nothing = np.full(len(BEARINGS), np.inf)
    path = run(odometry, [nothing] * 10, particles=1).path()
    assert np.all(np.isfinite(path))
    assert path[-1, 0] > 0.9


def test_poses_that_are_no_numbers_are_refused_and_nothing_is_taken_up():
    _, odometry, scans = drive(laps=0.1)
    path_filter = run(odometry, scans, 2)
    before = path_filter.n_scans
    with pytest.raises(ValueError, match="must be numbers"):
        path_filter.extend(np.array([0.0, np.nan, 0.0]), scans[0])
    assert path_filter.n_scans == before


def test_there_is_no_path_before_the_first_scan():
    with pytest.raises(RuntimeError, match="no scan"):
        GridFilter(GridFilterParams(), BEARINGS, STILL).path()
