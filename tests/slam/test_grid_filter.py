"""The filter of grids maps a ring of corridors with bad odometry, the same way each time, and shares its maps."""

import numpy as np
import pytest

from slam.evaluate import absolute_error
from slam.families import FamilyParams
from slam.grid_filter import GridFilter, GridFilterParams, draw_pose, move_particles
from slam.laser_maps import LaserMapParams, LaserMaps
from slam.laser_scan import walls_of
from slam.map_matching import LayParams
from slam.scan_motion import OdometryNoise
from slam.tree_map import NONE
from tests.naive import grid_filter as naive
from tests.slam.laser_world import RAYS, SCAN, around, odometry_of, ring, scan_at, seen_at

WHEELS = OdometryNoise()  # as bad as they are, without a laser's own odometry


def drive(laps=1.3, seed=0):
    """True poses, odometry, and what the laser saw."""
    rng = np.random.default_rng(seed)
    poses = around(laps)
    return poses, odometry_of(poses, rng), [seen_at(pose, ring(), 1000 * seed + k) for k, pose in enumerate(poses)]


def run(odometry, scans, particles=8, seed=0, threads=1):
    path_filter = GridFilter(GridFilterParams(particles=particles, odometry=WHEELS), seed, threads)
    for pose, walls in zip(odometry, scans, strict=True):
        path_filter.extend(pose, walls)
    return path_filter


@pytest.mark.parametrize("seed", range(3))
def test_a_ring_is_mapped_though_the_odometry_is_lost(seed):
    poses, odometry, scans = drive(seed=seed)
    path_filter = run(odometry, scans, seed=seed)
    assert absolute_error(odometry, poses).translation.rmse > 0.5
    found = absolute_error(path_filter.estimate().path, poses)
    assert found.translation.rmse < 0.1
    assert found.rotation.max < 0.1
    assert path_filter.vertices == len(poses)


def test_the_map_shows_the_walls_once_and_the_floor_free():
    poses, odometry, scans = drive()
    path_filter = run(odometry, scans)
    grid = path_filter.maps.grid(int(path_filter.homes[path_filter.best()]))
    assert path_filter.estimate().path[0] == pytest.approx(poses[0], abs=1e-6)
    rows, columns = np.nonzero(grid.cells > 1.0)
    xs, ys = grid.x + (columns + 0.5) * grid.resolution, grid.y + (rows + 0.5) * grid.resolution
    walls = ring()
    along, start = walls[:, 2:] - walls[:, :2], walls[:, :2]
    places = np.stack([xs, ys], axis=1)[:, None, :] - start
    share = np.clip(np.sum(places * along, axis=2) / np.sum(along**2, axis=1), 0.0, 1.0)
    apart = np.hypot(*(places - share[:, :, None] * along).transpose(2, 0, 1)).min(axis=1)
    assert np.mean(apart < 0.2) > 0.97
    floor = [grid.cells[int((y - grid.y) / grid.resolution), int((x - grid.x) / grid.resolution)] for x, y, _ in poses]
    assert np.mean(np.array(floor) < 0.0) > 0.99


def test_threads_change_nothing_and_seeds_do():
    _, odometry, scans = drive(laps=0.3)
    first, second, third = (run(odometry, scans, 5, seed, threads) for seed, threads in ((1, 1), (1, 2), (2, 1)))
    assert first.estimate().path.tobytes() == second.estimate().path.tobytes()
    assert first.maps.grid(0).cells.tobytes() == second.maps.grid(0).cells.tobytes()
    assert first.estimate().path.tobytes() != third.estimate().path.tobytes()


def patches_of(odometry, scans, particles, near):
    """Patches of the maps, and what maps that share nothing would have; each the mean of all vertices."""
    path_filter = GridFilter(GridFilterParams(particles=particles, families=FamilyParams(near=near)))
    shared, whole = [], []
    for pose, walls in zip(odometry, scans, strict=True):
        path_filter.extend(pose, walls)
        shared.append(path_filter.maps.n_patches)
        whole.append(np.count_nonzero(path_filter.maps.cells.table[path_filter.homes] != NONE))
    assert path_filter.resamplings > 0
    return np.mean(shared), np.mean(whole)


@pytest.mark.parametrize("seed", range(2))
def test_families_take_half_the_memory_of_single_maps_and_these_half_that_of_whole_ones(seed):
    poses, _, scans = drive(seed=seed)
    odometry = odometry_of(poses, np.random.default_rng(seed), 0.004, 0.01, 0.0)  # a laser's own
    few, _ = patches_of(odometry, scans, 4, near=0.02)
    many, whole = patches_of(odometry, scans, 40, near=0.02)
    single, whole_single = patches_of(odometry, scans, 40, near=0.0)
    assert many < 7.0 * few  # 4.3 to 5.8 for ten times the particles; single maps 7.9 to 8.8
    assert many < 0.7 * single  # 0.45 to 0.57
    assert single < 0.6 * whole_single  # 0.50 to 0.51
    assert many < 0.35 * whole  # 0.22 to 0.28


def test_scans_of_nothing_are_survived_on_the_odometry_alone():
    odometry = np.column_stack([np.arange(10) * 0.2, np.zeros(10), np.zeros(10)])
    nothing = walls_of(np.full(len(RAYS.rows), np.inf), RAYS, SCAN)
    path = run(odometry, [nothing] * 10, particles=1).estimate().path
    assert np.all(np.isfinite(path))
    assert path[-1, 0] > 0.9


def test_poses_that_are_no_numbers_are_refused_and_nothing_is_taken_up():
    _, odometry, scans = drive(laps=0.1)
    path_filter = run(odometry, scans, 2)
    before = path_filter.vertices
    with pytest.raises(ValueError, match="must be finite"):
        path_filter.extend(np.array([0.0, np.nan, 0.0]), scans[0])
    assert path_filter.vertices == before


def test_there_is_no_path_before_the_first_scan():
    with pytest.raises(RuntimeError, match="no vertex"):
        GridFilter(GridFilterParams()).estimate()


def random_information(rng):
    """An information matrix (3, 3) as a scan has it: poses are known by centimetres and milliradians."""
    root = np.tril(rng.uniform(-40.0, 40.0, (3, 3)), -1) + np.diag(rng.uniform(20.0, 90.0, 3))
    return root @ root.T


@pytest.mark.parametrize("seed", range(4))
def test_poses_are_drawn_by_the_information_on_them(seed):
    n = 20_000
    hessian, middle = random_information(np.random.default_rng(seed)), np.array([1.0, -2.0, 0.3])
    drawn = np.tile(middle, (n, 1))
    log_roots = [draw_pose(pose, hessian, seed, 3, particle) for particle, pose in enumerate(drawn)]
    assert log_roots == pytest.approx([0.5 * np.log(np.linalg.det(hessian))] * n)
    variances, axes = np.linalg.eigh(np.linalg.inv(hessian))
    whitened = (drawn - middle) @ axes / np.sqrt(variances)
    assert np.abs(whitened.mean(axis=0)).max() < 4.0 / np.sqrt(n)
    assert np.cov(whitened.T) == pytest.approx(np.eye(3), abs=4.0 * np.sqrt(2.0 / n))
    for particle in range(50):
        twin, log_root = naive.draw_pose(middle, hessian, seed, 3, particle)
        assert drawn[particle] == pytest.approx(twin, abs=1e-9)
        assert log_roots[particle] == pytest.approx(log_root)


@pytest.mark.parametrize("seed", range(4))
def test_each_particle_is_laid_onto_its_own_map_drawn_and_weighed(seed):
    rng, n = np.random.default_rng(seed), 8
    maps, rule = LaserMaps(3, LaserMapParams()), LayParams().rule()
    homes = rng.integers(0, 3, n)
    there = np.array([1.5, 1.0, 0.1])
    for step in range(3):
        seen_from = there - [0.2 * (3 - step), 0.0, 0.0]
        frames = seen_from + rng.uniform(-0.1, 0.1, (3, 3)) * [1.0, 1.0, 0.3]  # no map is like another
        maps.draw(scan_at(seen_from, ring(), step), frames)
    scan = scan_at(there, ring(), 50 + seed)
    guesses = there + rng.uniform(-0.1, 0.1, (n, 3)) * [1.0, 1.0, 0.3]
    priors = np.array([random_information(rng) for _ in range(n)])
    poses, before = guesses.copy(), rng.standard_normal(n)
    log_weights = before.copy()
    first, end = int(rng.integers(0, 3)), int(rng.integers(5, n + 1))
    move_particles(maps.cells, homes, scan, poses, priors, log_weights, rule, seed, 7, first, end)
    for p in range(n):
        pose, gain = guesses[p], 0.0
        if first <= p < end:
            pose, gain = naive.move_particle(maps.cells, homes[p], scan, pose, priors[p], rule, seed, 7, p)
        assert poses[p] == pytest.approx(pose, abs=1e-9)
        assert log_weights[p] == pytest.approx(before[p] + gain, abs=1e-9)


def test_the_best_particle_is_one_that_its_map_bears_out():
    poses, _, scans = drive(laps=0.5)
    path_filter = run(poses[:-1], scans[:-1], particles=20)
    path_filter.poses[10:, 1] += 0.35
    path_filter.extend(poses[-1], scans[-1])
    assert abs(float(path_filter.poses[path_filter.best(), 1] - poses[-1, 1])) < 0.2  # of 0.35
    assert path_filter.effective < 15.0 or path_filter.resamplings > 0


def test_particles_that_a_map_can_tell_apart_do_not_share_it():
    fine = {"map": {"resolution": 0.03}}
    with pytest.raises(ValueError, match=r"families.near is 0.02 m; cells of map.resolution allow 0.015 at most"):
        GridFilterParams.model_validate(fine)
    assert GridFilterParams.model_validate({**fine, "families": {"near": 0.015}}).families.near == 0.015
