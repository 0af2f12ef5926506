"""Steering without a map: a course is followed in its order, and a wish is bent only by what is in the way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.commands import DriveCommand, StopCommand
from server.messages import Drive, Goal
from server.robots.pilot import Course, Pilot, Reins, detour
from slam.vfh import Vfh, VfhParams

REINS = Reins(goal_radius=0.2, look_ahead=0.6, turn_gain=2.0, max_turn=1.5)
PARAMS = VfhParams()
SECTOR = 2.0 * math.pi / PARAMS.sectors
HERE = np.zeros(3)


def nothing(_: float) -> np.ndarray:
    """Open floor all around."""
    return np.zeros(PARAMS.sectors)


def between(first: float, last: float, density: float = 1.0):
    """A view in which the bearings from first to last (degrees, counter-clockwise) are closed."""
    bearings = np.degrees(np.arange(PARAMS.sectors) * SECTOR)
    return lambda _: np.where((bearings - first) % 360.0 <= (last - first) % 360.0, density, 0.0)


def pilot() -> Pilot:
    return Pilot(Vfh(PARAMS), REINS)


def shared(pilot: Pilot, speed: float, turn: float, see, heading: float = 0.0) -> DriveCommand:
    """The answer to a wish."""
    pilot.follow(Drive(0.0, speed, turn, shared=True))
    command = pilot.steer(HERE, heading, see)
    assert isinstance(command, DriveCommand)
    return command


# Courses


def test_a_course_without_a_route_leads_straight_to_the_goal():
    course = Course(np.zeros(2), Goal(0.0, (5.0, 1.0)), 0.6)
    course.advance(np.array([2.0, -1.0]))
    np.testing.assert_array_equal(course.ahead(), (5.0, 1.0))


def test_a_course_is_driven_in_full_although_it_comes_back_near_itself():
    """There and back again in lanes 0.3 m apart: whoever stands on one lane is not led to the other."""
    route = ((4.0, 0.0), (4.0, 0.3), (0.0, 0.3))
    course = Course(np.zeros(2), Goal(0.0, (0.0, 2.0), route=route), 0.6)
    line = np.vstack([[0.0, 0.0], route, [0.0, 2.0]])
    marks = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    for metres in np.arange(0.0, marks[-1], 0.1):
        position = [np.interp(metres, marks, line[:, axis]) for axis in (0, 1)]
        course.advance(np.array(position) + [0.02, -0.02])
        assert course.passed == pytest.approx(metres, abs=0.35)
        ahead = [np.interp(course.passed + 0.6, marks, line[:, axis]) for axis in (0, 1)]
        np.testing.assert_allclose(course.ahead(), ahead, atol=1e-9)
    assert len(course.rest()) == 0


@given(st.lists(st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)), max_size=6), st.randoms(use_true_random=False))
def test_a_course_never_goes_back(route, chance):
    course = Course(np.zeros(2), Goal(0.0, (1.0, 1.0), route=tuple(route)), 0.6)
    passed, rest = 0.0, len(course.rest())
    for _ in range(20):
        course.advance(np.array([chance.uniform(-6.0, 6.0), chance.uniform(-6.0, 6.0)]))
        assert passed <= course.passed <= passed + 2.0 * 0.6 + 1e-9
        assert len(course.rest()) <= rest
        passed, rest = course.passed, len(course.rest())
        assert np.isfinite(course.ahead()).all()


def test_at_the_goal_it_stops_and_forgets():
    helm = pilot()
    helm.aim(Goal(0.0, (0.1, 0.1)), HERE)
    assert helm.steer(HERE, 0.0, nothing) == StopCommand()
    assert helm.steer(HERE, 0.0, nothing) is None


def test_another_route_to_the_same_goal_keeps_the_way_that_was_begun():
    helm = pilot()
    ahead = between(-30.0, 30.0)
    helm.aim(Goal(0.0, (3.0, 0.0)), HERE)
    helm.steer(HERE, 0.0, ahead)
    begun = helm.steered
    assert begun is not None
    helm.aim(Goal(1.0, (3.0, 0.0), route=((1.0, 0.5),)), HERE)
    assert helm.steered == begun
    helm.aim(Goal(2.0, (3.0, 0.5)), HERE)
    assert helm.steered is None


# Wishes


@given(st.floats(-0.5, 0.5).filter(bool), st.floats(-1.5, 1.5))
def test_where_there_is_room_a_wish_is_what_is_done(speed, turn):
    command = shared(pilot(), speed, turn, nothing)
    assert command.speed == pytest.approx(speed)
    assert command.turn == pytest.approx(turn)


@given(st.floats(0.01, 0.5), st.floats(-1.5, 1.5), st.floats(0.0, 360.0), st.floats(0.0, 359.0), st.floats(0.0, 0.1))
def test_what_stands_in_the_way_never_makes_it_faster_or_go_back(speed, turn, first, width, density):
    command = shared(pilot(), speed, turn, between(first, first + width, density))
    assert 0.0 <= command.speed <= speed
    assert abs(command.turn) <= REINS.max_turn


def test_a_wish_is_bent_to_the_nearer_side():
    right, left = shared(pilot(), 0.3, 0.0, between(-10.0, 30.0)), shared(pilot(), 0.3, 0.0, between(-30.0, 10.0))
    assert right.turn < 0.0 < left.turn


def test_a_wall_all_across_is_no_reason_to_turn():
    assert shared(pilot(), 0.3, 0.0, between(-60.0, 60.0)) == DriveCommand(0.0, 0.0)
    slowly = shared(pilot(), 0.3, 0.0, between(-60.0, 60.0, 0.5 * PARAMS.stop_density))
    assert (slowly.speed, slowly.turn) == (pytest.approx(0.15), 0.0)


def test_who_pushes_straight_on_is_led_back_to_the_old_direction():
    helm = pilot()
    bent = shared(helm, 0.3, 0.0, between(-30.0, 10.0))
    assert bent.turn > 0.0
    back = shared(helm, 0.3, 0.0, nothing, heading=0.6)
    assert back.turn == pytest.approx(-1.2)
    assert shared(helm, 0.3, 0.0, nothing, heading=0.01).turn == pytest.approx(-0.02)
    assert shared(helm, 0.3, 0.0, nothing, heading=0.3).turn == 0.0, "back on it, the robot's own direction counts"


def test_who_turns_means_from_where_the_robot_looks():
    helm = pilot()
    shared(helm, 0.3, 0.0, between(-30.0, 10.0))
    assert shared(helm, 0.3, 0.5, nothing, heading=0.6).turn == pytest.approx(0.5)


def test_backwards_it_minds_what_is_behind_and_turns_as_wished():
    behind = between(170.0, 190.0, 0.5 * PARAMS.stop_density)
    slowly = shared(pilot(), -0.2, 0.4, behind)
    assert (slowly.speed, slowly.turn) == (pytest.approx(-0.1), 0.4)
    assert shared(pilot(), -0.2, 0.4, between(-60.0, 60.0)) == DriveCommand(-0.2, 0.4)


def test_standing_it_turns_as_wished_and_without_a_wish_it_does_nothing():
    assert shared(pilot(), 0.0, -0.7, between(0.0, 359.0)) == DriveCommand(0.0, -0.7)
    helm = pilot()
    helm.follow(Drive(0.0, 0.3, 0.0, shared=True))
    helm.follow(Drive(0.1, 0.0, 0.0, shared=True))
    assert helm.steer(HERE, 0.0, nothing) is None


@given(st.floats(-math.pi, math.pi), st.floats(0.0, 6.2), st.floats(-math.pi, math.pi))
def test_detour_is_the_way_to_the_nearer_side(start, width, bearing):
    found = detour((start, start + width), bearing)
    inside = (bearing - start) % (2.0 * math.pi) <= width
    sides = [abs(math.remainder(bearing - side, 2.0 * math.pi)) for side in (start, start + width)]
    assert found == pytest.approx(0.0 if inside else min(sides), abs=1e-9)
