"""Filling in between sweeps: where a wall was met twice it is met in between, and nowhere else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from server.robots.crunch import CrunchParams
from slam.local_map import LocalMap, LocalMapParams
from slam.pose import between, transform
from slam.rangefinder import RingParams
from slam.sweep_filling import sweeps_between
from slam.walls import WallParams, extract
from tests.server.logs import cast, drive

BEARINGS = np.radians(np.linspace(-90.0, 90.0, 11))
RING = RingParams(model="beam", bearings_deg=tuple(np.degrees(BEARINGS)), max_range=5.0, min_range=0.0)


def filled(first, second, end=(0.6, 0.0, 0.0), bridge=2.0, step=0.1):
    """What lies between sweeps of `BEARINGS` at the origin and at `end`."""
    before = np.zeros(3), np.asarray(first, float)
    return list(sweeps_between(BEARINGS, before, (np.array(end), np.asarray(second, float)), bridge, step))


def along_wall(pose, y=-1.0):
    """Ranges at a pose to a wall on the right that has no end; inf where a beam does not meet it."""
    slopes = np.sin(pose[2] + BEARINGS)
    return np.where(slopes < -0.1, (y - pose[1]) / np.minimum(slopes, -0.1), np.inf)


@pytest.mark.parametrize("end", [(0.6, 0.0, 0.0), (0.6, 0.1, 0.1), (0.0, 0.0, 0.2)])
def test_a_wall_met_twice_is_met_in_between(end):
    sweeps = filled(along_wall(np.zeros(3)), along_wall(np.array(end)), end)
    assert len(sweeps) >= 2
    for pose, ranges in sweeps:
        met = np.isfinite(ranges)
        assert met[0]
        ends = ranges[met, None] * np.stack([np.cos(BEARINGS[met]), np.sin(BEARINGS[met])], axis=1)
        assert abs(transform(pose, ends)[:, 1] + 1.0).max() < 0.08, "nearly: a range changes not quite evenly in a turn"


def test_places_are_a_step_apart_and_on_the_way():
    poses = np.array([pose for pose, _ in filled(np.ones(11), np.ones(11))])
    np.testing.assert_allclose(poses[:, 0], [0.1, 0.2, 0.3, 0.4, 0.5])
    np.testing.assert_allclose(poses[:, 1:], 0.0)


def test_what_changed_in_between_is_not_guessed():
    first, second = np.full(11, 1.0), np.full(11, 1.0)
    second[0] = 3.0  # a door
    first[1] = np.inf  # a wall's end
    first[2] = np.nan  # nothing measured
    first[3] = second[3] = np.inf
    for _, ranges in filled(first, second):
        assert np.isnan(ranges[:3]).all()
        assert ranges[3] == np.inf, "nothing before and after is nothing in between"
        np.testing.assert_allclose(ranges[4:], 1.0)


def test_sweeps_too_close_or_too_far_apart_have_nothing_between():
    same = np.ones(11)
    assert not filled(same, same, (0.05, 0.0, 0.03), step=0.025), "a robot that sweeps often leaves no gaps"
    assert filled(same, same, (0.12, 0.0, 0.0), step=0.025)
    assert not filled(same, same, (2.0, 0.0, 0.0))
    assert not filled(same, same, (0.0, 0.0, 1.5))


@pytest.mark.parametrize("haste", [1.0, 1.5])  # a balancing robot overshoots
def test_crunch_sweeps_too_often_to_leave_gaps(haste):
    crunch = CrunchParams()
    ranges = np.full(11, crunch.sensors["infrared"].max_range)
    way, turn = 0.04 * haste * np.array([crunch.vfh.max_speed, crunch.max_turn])
    assert not filled(ranges, ranges, (way, 0.0, turn), step=0.025)
    assert filled(ranges, ranges, (4.0 * way, 0.0, 4.0 * turn), step=0.025), "it would if it swept so seldom"


def mapped(bridge: float):
    """How many rays from a place in a room meet a wall, after sweeps every 0.7 m, and how far (m) off the room's."""
    truth = drive(laps=1)
    local_map = LocalMap(LocalMapParams(bridge=bridge, farthest=3.0), {"laser": RING}, border=1.0)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*between(truth[:-1], truth[1:])[:, :2].T))])
    rows = np.unique(np.searchsorted(way, np.arange(0.0, 8.0, 0.7)))
    for row in rows:
        local_map.move(truth[row])
        local_map.fuse("laser", cast(truth[row], RING.bearings), truth[row])
    pose = truth[rows[-2]]
    walls = extract(local_map, pose, WallParams())
    angles = pose[2] + 2.0 * math.pi * np.arange(walls.distances.size) / walls.distances.size
    met = np.isfinite(walls.distances)
    ends = pose[:2] + walls.distances[met, None] * np.stack([np.cos(angles[met]), np.sin(angles[met])], axis=1)
    off = np.minimum(abs(abs(ends[:, 0]) - 3.0), abs(abs(ends[:, 1]) - 2.0))
    return int(met.sum()), off


def test_sparse_sweeps_show_walls_only_when_filled():
    bare, _ = mapped(0.0)
    n, off = mapped(2.0)
    assert n >= 60, "of 120 rays, half of which look back where the beams never did"
    assert n >= 1.5 * bare
    assert np.quantile(off, 0.9) < 0.05


def test_reach_follows_the_sensors_no_farther_than_wanted():
    assert LocalMap(LocalMapParams(), {"laser": RING}).reach == pytest.approx(10.0 / 3.0)
    assert LocalMap(LocalMapParams(farthest=2.0), {"laser": RING}).reach == 2.0
