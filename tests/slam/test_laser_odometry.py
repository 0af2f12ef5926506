"""Odometry by a laser drifts little, whatever odometry it begins with."""

import math

import numpy as np
import pytest

from slam.evaluate import relative_error
from slam.laser_odometry import LaserOdometry, LaserOdometryParams
from slam.pose import between, transform
from tests.slam.laser_world import around, blind, odometry_of, ring, scan_at


def follow(odometry, scans, **changes):
    found = LaserOdometry(LaserOdometryParams(**changes))
    return np.array([found.step(pose, scan) for pose, scan in zip(odometry, scans, strict=True)]), found


def drive(laps=1.0, seed=0):
    poses = around(laps)
    return poses, odometry_of(poses, np.random.default_rng(seed)), [scan_at(p, ring(), k) for k, p in enumerate(poses)]


@pytest.mark.parametrize("seed", range(3))
def test_the_drift_is_a_small_part_of_the_odometrys(seed):
    poses, odometry, scans = drive(seed=seed)
    path, _ = follow(odometry, scans)
    assert relative_error(odometry, poses, 5.0).translation.median > 0.1
    found = relative_error(path, poses, 5.0)
    assert found.translation.max < 0.05
    assert found.rotation.max < 0.01


@pytest.mark.parametrize("seed", range(3))
def test_a_laser_alone_finds_its_way_whatever_it_is_told(seed):
    poses, odometry, scans = drive(seed=seed)
    lies = odometry[::-1]
    path, _ = follow(lies, scans, is_alone=True)
    found = relative_error(path, poses, 5.0)
    assert found.translation.max < 0.05
    assert found.rotation.max < 0.01


def test_without_it_the_odometry_is_believed():
    _, odometry, scans = drive(laps=0.3)
    path, _ = follow(odometry, scans, is_on=False)
    assert path == pytest.approx(odometry, abs=1e-9)


def test_without_it_the_map_still_goes_along():
    poses, odometry, scans = drive(laps=0.5)
    _, found = follow(odometry, scans, is_on=False)
    assert math.hypot(*(poses[-1] - poses[0])[:2]) > 3.0
    grid = found.grid()
    ends = transform(found.pose, scans[-1].points)
    columns, rows = np.floor((ends - [grid.x, grid.y]) / grid.resolution).astype(int).T
    assert np.mean(grid.cells[rows, columns] > 0.0) > 0.9


def test_only_the_newest_metres_are_remembered():
    _, odometry, scans = drive()
    _, short = follow(odometry, scans, span=3.0)
    _, long = follow(odometry, scans, span=30.0)
    assert len(short.maps) == 2
    assert sum(maps.n_patches for maps in short.maps) < sum(maps.n_patches for maps in long.maps)


def test_standing_still_is_standing_still():
    scan, pose = scan_at(np.array([3.0, 1.0, 0.0]), ring()), np.array([3.0, 1.0, 0.0])
    scans = [scan, *(scan_at(pose, ring(), k) for k in range(1, 40))]
    path, found = follow(np.tile(pose, (40, 1)), scans)
    assert np.hypot(*(path - pose)[:, :2].T).max() < 0.01
    assert np.abs(path[:, 2]).max() < 0.003
    assert found.age < 0.05


def test_where_nothing_is_seen_the_odometry_goes_on():
    nothing = blind()
    odometry = np.column_stack([np.arange(10) * 0.2, np.zeros(10), np.linspace(0.0, 0.3, 10)])
    path, _ = follow(odometry, [nothing] * 10)
    assert between(path[0], path[-1]) == pytest.approx(between(odometry[0], odometry[-1]), abs=1e-6)


def test_poses_that_are_no_numbers_are_refused():
    with pytest.raises(ValueError, match="must be numbers"):
        LaserOdometry(LaserOdometryParams()).step(np.array([0.0, np.nan, 0.0]), scan_at(np.ones(3), ring()))
