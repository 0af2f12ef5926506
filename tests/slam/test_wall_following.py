"""Following a wall: it turns as the nearest point says, keeps its distance along walls and around their ends."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.pose import compose, inverse, transform
from slam.wall_following import Lap, WallFollowingParams, follow

PARAMS = WallFollowingParams()
STEP = 0.05  # s


def wall(start, end):
    """Points each 2 cm along a wall."""
    start, end = np.array(start, float), np.array(end, float)
    n = max(2, int(np.hypot(*(end - start)) / 0.02))
    return start + np.linspace(0.0, 1.0, n)[:, None] * (end - start)


def path_along(world, pose, seconds, params=PARAMS):
    """Poses of a robot that does as it is told, and sees all points within 3 m that are not behind it."""
    poses = [np.array(pose, float)]
    for _ in range(round(seconds / STEP)):
        points = transform(inverse(poses[-1]), world)
        seen = points[(np.hypot(*points.T) < 3.0) & (np.abs(np.arctan2(points[:, 1], points[:, 0])) < 2.0)]
        speed, turn = follow(seen, params)
        poses.append(compose(poses[-1], np.array([speed * STEP, 0.0, turn * STEP])))
    return np.array(poses)


def mirrored(points):
    return points * np.array([1.0, -1.0])


@pytest.mark.parametrize("offset", [0.15, 0.26, 0.6, 1.2])
def test_it_comes_to_its_distance_from_a_straight_wall(offset):
    poses = path_along(wall((-1.0, 0.0), (12.0, 0.0)), (0.0, offset, 0.0), 60.0)
    assert poses[-200:, 1] == pytest.approx(PARAMS.distance, abs=0.02)
    assert np.abs(poses[-200:, 2]).max() < 0.1
    assert poses[-1, 0] > 4.0


def test_left_is_right_in_a_mirror():
    rng = np.random.default_rng(3)
    other = PARAMS.model_copy(update={"side": "left"})
    for _ in range(100):
        points = rng.uniform(-1.5, 1.5, (40, 2))
        speed, turn = follow(points, PARAMS)
        assert follow(mirrored(points), other) == pytest.approx((speed, -turn))


def test_what_it_tells_is_never_beyond_its_bounds():
    rng = np.random.default_rng(4)
    for _ in range(300):
        speed, turn = follow(rng.normal(0.0, 1.0, (int(rng.integers(0, 30)), 2)), PARAMS)
        assert 0.0 <= speed <= PARAMS.speed
        assert abs(turn) <= PARAMS.max_turn


def test_without_a_wall_it_goes_straight_on():
    assert follow(np.empty((0, 2)), PARAMS) == (0.0, 0.0), "it is blind"
    assert follow(np.array([[-1.0, 0.0], [0.0, 1.0]]), PARAMS) == (PARAMS.speed, 0.0), "behind, and on the other side"


def test_in_front_of_a_wall_it_only_turns_away():
    ahead = wall((0.18, -0.1), (0.18, 0.1))
    assert follow(ahead, PARAMS) == (0.0, PARAMS.max_turn)


def test_it_goes_around_a_room_and_around_a_board_without_coming_too_near():
    room = np.concatenate([wall((0, 0), (3, 0)), wall((3, 0), (3, 2)), wall((3, 2), (0, 2)), wall((0, 2), (0, 0))])
    inside = path_along(room, (0.5, 0.3, 0.0), 120.0)
    board = np.concatenate([wall((0, 0), (1.5, 0)), wall((1.5, 0.01), (0, 0.01))])
    around = path_along(board, (0.3, 0.3, 0.0), 120.0)
    for poses, walls in ((inside, room), (around, board)):
        gaps = np.sqrt(((poses[:, None, :2] - walls) ** 2).sum(axis=2)).min(axis=1)
        assert gaps.min() > 0.13, "the robot's own radius"
        assert gaps[200:].max() < 0.6
        lap = Lap(PARAMS)
        told = [lap.step(pose) for pose in poses]
        assert any(told), "it comes around"
        assert not any(told[:250])


def test_a_lap_needs_a_way_a_place_and_a_heading():
    lap = Lap(PARAMS)
    circle = [np.array([math.cos(a), math.sin(a), a + 0.5 * math.pi]) for a in np.linspace(0.0, 2.0 * math.pi, 100)]
    told = [lap.step(pose) for pose in circle]
    assert not any(told[:95])
    assert told[-1]
    back = Lap(PARAMS)
    there = [np.array([x, 0.0, 0.0]) for x in np.linspace(0.0, 2.0, 30)]
    assert not any(
        back.step(pose) for pose in [*there, *(compose(pose, np.array([0.0, 0.0, math.pi])) for pose in there[::-1])]
    )
