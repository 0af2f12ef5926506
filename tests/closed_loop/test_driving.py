"""Whoever holds the stick forward in shared mode touches nothing, and a route is driven in the order of its places."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware.virtual import VirtualCrunch, World
from server.messages import Drive, Goal, Stop
from tests.closed_loop.loop import Loop

BODY = 0.076  # m, the robot's radius
HALL = np.array([[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0]], float)
POST = np.array([[3.0, 1.9, 3.2, 1.9], [3.2, 1.9, 3.2, 2.2], [3.2, 2.2, 3.0, 2.2], [3.0, 2.2, 3.0, 1.9]])
ROOMS = np.vstack([HALL, [[3.0, 0.0, 3.0, 2.8]]])  # two rooms, open at the top


def loop_in(walls: np.ndarray, start: tuple[float, float, float], seed: int = 5) -> Loop:
    """A robot that has stood and looked around for a second."""
    loop = Loop(VirtualCrunch(World(walls, start, "hall"), seed=seed, drift="low"))
    loop.run(1.0)
    return loop


def hold(loop: Loop, seconds: float, speed: float, turn: float = 0.0, shared: bool = True) -> np.ndarray:
    """Hold the stick, said again ten times a second; the robot's poses (n, 3)."""
    poses = []
    for _ in range(round(seconds / 0.1)):
        loop.say(Drive(loop.robot.time, speed, turn, shared))
        loop.run(0.1)
        poses.append(loop.robot.pose.copy())
    return np.array(poses)


@pytest.mark.parametrize("heading", [0.0, 0.3, 1.2, 2.5])
@pytest.mark.parametrize("speed", [0.3, 0.5])
def test_the_stick_held_forward_touches_no_wall(heading, speed):
    loop = loop_in(HALL, (3.0, 2.0, heading))
    poses = hold(loop, 30.0, speed)
    assert math.dist(poses[-1, :2], (3.0, 2.0)) > 0.8, "it went as far as there was room"
    assert loop.nearest_wall > 3.0 * BODY
    assert loop.robot.state == "armed"


def test_without_help_the_same_stick_runs_into_the_wall():
    loop = loop_in(HALL, (4.5, 2.0, 0.0))
    hold(loop, 8.0, 0.3, shared=False)
    assert loop.nearest_wall <= BODY


def test_what_stands_in_the_way_is_passed():
    loop = loop_in(np.vstack([HALL, POST]), (1.2, 2.0, 0.0))
    poses = hold(loop, 20.0, 0.3)
    assert loop.nearest_wall > BODY
    behind = poses[(poses[:, 0] > 4.0) & (poses[:, 0] < 5.0)]  # and not yet before the wall at the end
    assert len(behind) > 10
    assert np.abs(behind[:, 2]).max() < 0.2, "behind it the old direction holds again"


def test_where_there_is_room_the_stick_does_what_it_does_without_help():
    wide = 10.0 * HALL
    driven = []
    for shared in (True, False):
        loop = loop_in(wide, (30.0, 20.0, 0.0))
        driven.append(hold(loop, 3.0, 0.3, 0.8, shared))
    np.testing.assert_array_equal(driven[0], driven[1])


@pytest.mark.parametrize("speed", [-0.2, -0.3])
def test_backwards_it_halts_before_what_is_behind(speed):
    loop = loop_in(HALL, (1.5, 2.0, 0.0))
    hold(loop, 15.0, speed)
    assert loop.nearest_wall > BODY
    assert loop.robot.pose[0] < 1.2, "it went back as far as there was room"


def test_a_wish_ends_with_a_stop_although_sweeps_go_on():
    loop = loop_in(HALL, (3.0, 2.0, 0.0))
    hold(loop, 1.0, 0.3)
    loop.say(Stop(loop.robot.time))
    loop.run(3.0)
    stood = loop.robot.pose[:2].copy()
    loop.run(1.0)
    assert math.dist(stood, loop.robot.pose[:2]) < 0.02


def test_a_route_leads_into_the_other_room():
    start = (1.5, 1.0, 0.0)
    goal = (3.0, 0.0)  # in the other room, behind the wall
    route = ((0.0, 2.3), (3.0, 2.3))  # through the opening
    loop = loop_in(ROOMS, start)
    loop.say(Goal(loop.robot.time, goal, route=route))
    assert loop.reach(90.0), f"stands at {loop.robot.pose}"
    assert math.dist(loop.robot.pose[:2] - start[:2], goal) < 0.4
    assert loop.nearest_wall > BODY
