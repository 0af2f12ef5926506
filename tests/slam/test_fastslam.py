"""The paper's FastSLAM, step by step as it stands there; and that it maps a room when its odometry is good."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.evaluate import absolute_error
from slam.fastslam import (
    FastSlam,
    FastSlamParams,
    inverse_sensor_model,
    measurement_model,
    occupancy_grid_mapping,
    sample_motion,
)
from slam.walls import Walls
from tests.naive import fastslam as naive
from tests.slam.laser_world import RAYS, around, box, odometry_of, ring, seen_at

SMALL = FastSlamParams(max_range=4.0)


def test_the_inverse_sensor_model_is_algorithm_5():
    rng = np.random.default_rng(0)
    pose = np.array([1.0, 2.0, 0.7])
    distances = seen_at(pose, box(-1.0, 0.0, 5.0, 4.0)).distances
    bearings = 2.0 * np.pi * np.arange(RAYS.n) / RAYS.n
    told = []
    for _ in range(3000):
        centre = pose[:2] + rng.uniform(-4.0, 4.0, 2)
        args = (0.1, math.radians(0.8), 0.9, -0.4, 3.5)
        found = inverse_sensor_model(centre[0], centre[1], pose, distances, *args)
        assert found == naive.inverse_sensor_model(centre, pose, bearings, distances, *args)
        told.append(found)
    assert {0.0, 0.9, -0.4} == set(told)


def random_scan(rng, n_rays, reach):
    """Distances (n_rays,) up to somewhat beyond the reach, and beams side by side that met nothing."""
    distances = rng.uniform(0.2, 1.2 * reach, n_rays)
    distances[np.repeat(rng.random(n_rays // 5) < 0.3, 5)] = np.inf
    return distances


@pytest.mark.parametrize("seed", range(8))
def test_a_scan_is_drawn_by_algorithm_4(seed):
    rng = np.random.default_rng(seed)
    n_rays, reach, resolution = 90, 1.2, 0.05  # a beam each 4 degrees
    bearings = 2.0 * np.pi * np.arange(n_rays) / n_rays
    distances = random_scan(rng, n_rays, reach)
    cells = rng.standard_normal((56, 61)).astype(np.float32)
    corner = rng.uniform(-5.0, 5.0, 2)
    pose = np.array([*(corner + rng.uniform(0.5, 2.5, 2)), rng.uniform(-np.pi, np.pi)])  # the field may be cut off
    model = (0.1, math.radians(3.0), 0.9, -0.4, reach)
    expected = naive.occupancy_grid_mapping(
        cells, corner, resolution, pose,
        lambda centre: naive.inverse_sensor_model(centre, pose, bearings, distances, *model), reach,
    )  # fmt: skip
    before = cells.copy()
    occupancy_grid_mapping(cells, corner[0], corner[1], resolution, pose, distances, *model)
    assert cells == pytest.approx(expected, abs=1e-5)
    assert np.sum(cells > before + 0.5) > 20
    assert np.sum(cells < before - 0.3) > 200


@pytest.mark.parametrize("seed", range(4))
def test_only_beams_that_met_nothing_are_not_as_the_paper_has_them(seed):
    rng = np.random.default_rng(100 + seed)
    params = FastSlamParams(max_range=1.2, width_deg=3.0)
    pose = np.array([*rng.uniform(-1.0, 1.0, 2), rng.uniform(-np.pi, np.pi)])
    distances, bearings = random_scan(rng, 90, params.max_range), 2.0 * np.pi * np.arange(90) / 90
    path_filter = FastSlam(params, 1)
    path_filter.extend(pose, Walls(distances, np.zeros(90)))
    grid = path_filter.grid(0)
    told = np.where(distances < params.max_range, distances, np.inf)

    def drawn(ranges, unseen_is_free):
        model = (params.thickness, math.radians(params.width_deg), params.occupied, params.free, params.max_range)
        return naive.occupancy_grid_mapping(
            np.zeros_like(grid.cells), np.array([grid.x, grid.y]), grid.resolution, pose,
            lambda centre: naive.inverse_sensor_model(centre, pose, bearings, ranges, *model, unseen_is_free),
            params.max_range,
        )  # fmt: skip

    assert grid.cells == pytest.approx(drawn(told, False), abs=1e-5)
    of_the_paper = drawn(told, True)
    only_unseen = drawn(np.where(np.isinf(told), np.inf, 0.0), True)
    differs = np.abs(of_the_paper - grid.cells) > 1e-5
    assert np.sum(differs) > 200
    assert of_the_paper[differs] == pytest.approx(params.free)
    assert not np.any(grid.cells[differs])
    assert np.array_equal(differs, only_unseen < 0.0)


def test_the_measurement_model_is_the_likelihood_field():
    pose = np.array([1.0, 2.0, 0.7])
    walls = seen_at(pose, box(-1.0, 0.0, 5.0, 4.0))
    path_filter = FastSlam(SMALL, 6)
    path_filter.extend(pose, walls)
    grid = path_filter.grid(0)
    rows, columns = np.nonzero(grid.cells > 0.0)
    centres = np.column_stack([grid.x + (columns + 0.5) * 0.05, grid.y + (rows + 0.5) * 0.05])
    every, bearings = 6, 2.0 * np.pi * np.arange(RAYS.n) / RAYS.n
    found = []
    for off in ([0.0, 0.0, 0.0], [0.1, -0.05, 0.03], [1.0, 0.5, 1.0]):
        there = pose + off
        found.append(measurement_model(grid.cells, grid.x, grid.y, 0.05, there, walls.distances, every, 0.1, 0.05, 4.0))
        twin = naive.measurement_model(
            centres, there, bearings[::every], walls.distances[::every], 0.1, 0.05, 4.0, reach=0.3
        )
        assert found[-1] == pytest.approx(twin, rel=0.02)  # the window's corners are a little farther off
    assert found[0] > found[1] > found[2]


def test_motions_are_drawn_with_the_papers_sigma():
    sigma = math.hypot(0.3, 0.2)
    moved = np.zeros((4000, 3))
    for particle, pose in enumerate(moved):
        sample_motion(pose, 0.3, 0.2, sigma, 1, 2, particle)
    assert np.std(moved[:, 2]) == pytest.approx(sigma, rel=0.05)
    assert np.mean(moved[:, 2]) == pytest.approx(0.2, abs=0.02)
    ways = moved[:, 0] / np.cos(0.5 * moved[:, 2])
    assert np.std(ways) == pytest.approx(sigma, rel=0.05)


def test_a_cell_that_is_seen_again_adds_up_and_others_stay():
    pose = np.zeros(3)
    walls = seen_at(pose, box(-2.0, -2.0, 4.0, 4.0))
    path_filter = FastSlam(SMALL.model_copy(update={"noise": 0.0}), 6)
    for _ in range(3):
        path_filter.extend(pose, walls, 0.0)
    cells = path_filter.grid(0).cells
    values = np.unique(np.round(cells, 4))
    assert set(values) <= {np.float32(0.0), *(np.float32(round(3 * each, 4)) for each in (0.9, -0.4))}
    assert np.sum(cells > 0.0) > 50
    assert np.sum(cells < 0.0) > 1000


def test_it_maps_a_ring_when_each_step_is_small():
    poses = around(0.5, step=0.1)
    odometry = odometry_of(poses, np.random.default_rng(1), 0.01, 0.01, 0.01)
    path_filter = FastSlam(FastSlamParams(max_range=6.0, noise=0.1), 40, seed=1)
    for k, pose in enumerate(odometry):
        path_filter.extend(pose, seen_at(poses[k], ring(), k))
    assert absolute_error(path_filter.estimate().path, poses).translation.rmse < 0.15
    assert path_filter.estimate().resamplings == len(poses) - 1  # at every step


def test_the_same_seed_gives_the_same_bytes_and_particles_come_and_go():
    poses = around(0.2)

    def run(seed):
        made = FastSlam(SMALL, 6, seed)
        for k, pose in enumerate(poses):
            made.extend(pose, seen_at(pose, ring(), k))
        return made

    first, second, third = run(1), run(1), run(2)
    assert first.maps.tobytes() == second.maps.tobytes()
    assert first.estimate().path.tobytes() != third.estimate().path.tobytes()
    first.resize(3)
    assert first.estimate().n_particles == 3
    first.extend(poses[-1], seen_at(poses[-1], ring()))
    assert len(first.uncertainty(2).deviations) == len(poses) + 1
    with pytest.raises(ValueError, match="at least"):
        first.resize(0)
    with pytest.raises(RuntimeError, match="no vertex"):
        FastSlam(FastSlamParams()).estimate()
