"""Ends of beams become points with the direction of their walls."""

import numpy as np
import pytest

from slam.laser_scan import scan_of
from slam.pose import compose, transform
from tests.slam.laser_world import BEARINGS, box, ranges_of

STILL = np.zeros(3)


def test_normals_stand_across_the_walls_and_look_to_the_laser():
    pose = np.array([1.0, 2.0, 0.4])
    scan = scan_of(ranges_of(pose, box(-3.0, -2.0, 8.0, 7.0)), BEARINGS, STILL, 20.0, 0.15)
    assert len(scan.points) == len(BEARINGS)
    world = transform(pose * [0.0, 0.0, 1.0], scan.normals)
    known = np.hypot(*scan.normals.T) > 0.0
    assert known.mean() > 0.9  # but for ends in corners
    along_axes = np.abs(world[known]).max(axis=1)
    assert np.all(along_axes > 0.95)
    assert np.mean(along_axes > 1.0 - 1e-9) > 0.93  # all but those with neighbours around a corner
    assert np.all(np.sum(scan.points * scan.normals, axis=1)[known] < 0.0)


def test_ends_are_where_they_were_measured_from_wherever_the_laser_sits():
    pose, mount = np.array([0.5, -0.3, 1.1]), np.array([0.15, 0.02, 0.2])
    walls = box(-4.0, -4.0, 8.0, 8.0)
    scan = scan_of(ranges_of(compose(pose, mount), walls), BEARINGS, mount, 20.0, 0.15)
    ends = transform(pose, scan.points)
    assert np.abs(ends).max(axis=1) == pytest.approx(4.0, abs=1e-9)


def test_what_is_no_echo_is_left_out():
    ranges = np.full(len(BEARINGS), 3.0)
    ranges[:6] = [np.nan, np.inf, 0.0, -1.0, 20.0, 25.0]
    assert len(scan_of(ranges, BEARINGS, STILL, 20.0, 0.15).points) == len(BEARINGS) - 6
    nothing = scan_of(np.full(3, np.inf), BEARINGS[:3], STILL, 20.0, 0.15)
    assert nothing.points.shape == nothing.normals.shape == (0, 2)


def test_lonely_ends_and_scattered_ones_tell_of_no_direction():
    rng = np.random.default_rng(3)
    far_apart = np.where(np.arange(len(BEARINGS)) % 2, 2.0, 4.0)
    assert not np.any(scan_of(far_apart, BEARINGS, STILL, 20.0, 0.15).normals)
    bush = 2.0 + 0.1 * rng.uniform(-1.0, 1.0, len(BEARINGS))
    assert np.mean(np.any(scan_of(bush, BEARINGS, STILL, 20.0, 0.3).normals, axis=1)) < 0.6
