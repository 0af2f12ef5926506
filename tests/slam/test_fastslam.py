"""The paper's FastSLAM, step by step as it stands there; and that it maps a room when its odometry is good."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.evaluate import absolute_error
from slam.fastslam import FastSlam, FastSlamParams, inverse_sensor_model, measurement_model, sample_motion
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
