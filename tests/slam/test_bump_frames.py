"""Maps laid on each other: frames are found by the walls, doubt is told, and wrong maps are outvoted."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.bump_frames import BumpFrameParams, agreed, frame_of, near_share
from slam.bump_mapper import BumpMap
from slam.bump_swarm import BEYOND, COLUMNS, HIGH, HITS, LOW, PHI, X, Y
from slam.bump_walls import walls_of
from slam.pose import compose, inverse, transform, wrap
from tests.naive import bumps_felt as naive
from tests.slam.bump_world import AREAS, rectangle

FRAMES = BumpFrameParams()


def drawn(corners: np.ndarray, pose: np.ndarray) -> BumpMap:
    """A perfect map of a room of corners (n, 2), counter-clockwise, the room being at a pose in the map's frame."""
    corners = transform(pose, corners)
    lines = np.zeros((len(corners), COLUMNS))
    contacts = []
    for row, (start, end) in enumerate(zip(corners, np.roll(corners, -1, axis=0), strict=True)):
        length = math.hypot(*(end - start))
        phi = math.atan2(*(end - start)[::-1]) - 0.5 * math.pi
        lines[row, [X, Y]] = 0.5 * (start + end)
        lines[row, PHI], lines[row, BEYOND], lines[row, HITS] = phi, 0.0, 9.0
        lines[row, LOW], lines[row, HIGH] = 0.05 - 0.5 * length, 0.5 * length - 0.05
        contacts.append(start + np.linspace(0.1, 0.9, 9)[:, None] * (end - start))
    none = np.zeros((0, 3))
    return BumpMap(none, np.zeros(0, bool), np.concatenate(contacts), walls_of(lines), np.zeros(0, int), lines,
                   np.zeros(2), 0.0)  # fmt: skip


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (1.0, -2.0, 2.5), (-0.3, 0.4, -1.3)])
def test_frames_are_found_by_the_walls_shape(pose):
    corners = AREAS["cut rectangle"][0]
    one, other = drawn(corners, np.zeros(3)), drawn(corners, np.array(pose))
    frame = frame_of(one, other, FRAMES)
    off = compose(frame.pose, np.array(pose))
    assert np.hypot(*off[:2]) < 0.01
    assert abs(float(wrap(off[2]))) < 0.01
    assert frame.score > 0.95
    assert frame.second < FRAMES.doubtful * frame.score


def test_a_rectangle_lies_as_well_the_other_way_round():
    one = drawn(rectangle(1.5, 1.1), np.zeros(3))
    frame = frame_of(one, one, FRAMES)
    assert frame.second > FRAMES.doubtful * frame.score


def test_other_rooms_fit_badly():
    one, other = drawn(AREAS["triangle"][0], np.zeros(3)), drawn(AREAS["cut rectangle"][0], np.zeros(3))
    assert frame_of(one, other, FRAMES).score < FRAMES.least_shared


def test_maps_of_nothing_fit_nowhere():
    one = drawn(AREAS["triangle"][0], np.zeros(3))
    bare = one._replace(lines=one.lines[:0], contacts=one.contacts[:0], walls=[])
    assert frame_of(one, bare, FRAMES).score == 0.0
    assert frame_of(bare, one, FRAMES).score == 0.0


def test_contacts_near_walls_count_as_the_twin_says():
    rng = np.random.default_rng(1)
    points, segments = rng.uniform(-1, 1, (5, 2)), rng.uniform(-1, 1, (3, 4))
    pose = np.array([0.1, -0.2, 0.7])
    assert near_share(points, segments, pose, 0.3) == pytest.approx(naive.near_share(points, segments, pose, 0.3), 1e-3)


POSES = np.array([(0.0, 0.0, 0.0), (1.0, -2.0, 2.5), (-0.3, 0.4, -1.3), (0.2, 0.2, 0.4)])


def test_a_wrong_map_among_five_is_outvoted():
    """Even if it comes first, as that which explains its own bumps best."""
    maps = [drawn(AREAS["pentagon"][0], POSES[1]), *(drawn(AREAS["cut rectangle"][0], pose) for pose in POSES)]
    rows, frames = agreed(maps, FRAMES)
    assert rows == [1, 2, 3, 4]
    for row, frame in zip(rows, frames, strict=True):
        off = compose(frame, compose(POSES[row - 1], inverse(POSES[0])))
        assert np.hypot(*off[:2]) < 0.01
        assert abs(float(wrap(off[2]))) < 0.01


def test_maps_that_agree_with_none_leave_the_first_alone():
    rows, frames = agreed([drawn(AREAS[name][0], np.zeros(3)) for name in ("triangle", "cut rectangle", "L")], FRAMES)
    assert rows == [0]
    np.testing.assert_array_equal(frames, np.zeros((1, 3)))
