"""Wheel odometry: exact arcs across the counters' wrap, lean taken out, and poses of the past found by time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from server.messages import Wheels
from server.robots.odometry import WheelOdometry
from slam.pose import wrap
from tests.server.crunch_body import RADIUS, TRACK, WRAP, Body


@pytest.mark.parametrize(("speed", "turn"), [(0.3, 0.0), (0.3, 0.5), (-0.2, 0.3), (0.0, 1.0), (0.5, -2.0)])
@pytest.mark.parametrize("start", [0.0, 20.8, 7.123])
def test_wheels_are_integrated_along_arcs_across_the_counters_wrap(speed, turn, start):
    body, odometry = Body(start), WheelOdometry(TRACK, RADIUS)
    odometry.roll(body.wheels())
    moved = [odometry.roll(wheels) for wheels in body.drive(speed, turn, 8.0)]
    assert math.hypot(odometry.x - body.pose[0], odometry.y - body.pose[1]) < 1e-3
    assert wrap(odometry.theta - body.pose[2]) == pytest.approx(0.0, abs=1e-9)
    assert sum(moved) == pytest.approx(speed * 8.0, abs=1e-9)
    assert -math.pi <= odometry.theta <= math.pi


def test_the_first_reading_moves_nothing():
    odometry = WheelOdometry(TRACK, RADIUS)
    assert odometry.roll(Wheels(0.0, 12.0, 3.0, 0.2, WRAP)) == 0.0
    assert (odometry.x, odometry.y, odometry.theta) == (0.0, 0.0, 0.0)


def test_a_lost_reading_is_made_up_by_the_next():
    body, odometry, sparse = Body(), WheelOdometry(TRACK, RADIUS), WheelOdometry(TRACK, RADIUS)
    readings = [body.wheels(), *body.drive(0.3, 0.2, 4.0)]
    for wheels in readings:
        odometry.roll(wheels)
    for wheels in readings[::10]:
        sparse.roll(wheels)
    assert math.hypot(odometry.x - sparse.x, odometry.y - sparse.y) < 1e-3
    assert odometry.theta == pytest.approx(sparse.theta, abs=1e-9)


def test_leaning_forwards_and_back_is_no_way():
    """Encoders see the wheel against the body: a body that leans over a wheel at rest turns them back."""
    body, odometry = Body(), WheelOdometry(TRACK, RADIUS)
    odometry.roll(body.wheels())
    for tilt in (0.2, -0.15, 0.0):
        for wheels in body.drive(0.0, 0.0, 1.0, tilt):
            assert abs(odometry.roll(wheels)) < 1e-12
    assert (odometry.x, odometry.y, odometry.theta) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    for wheels in body.drive(0.3, 0.0, 2.0, 0.1):
        odometry.roll(wheels)
    assert odometry.x == pytest.approx(0.6, abs=1e-9)


def test_poses_of_the_past_are_found_by_time():
    body, odometry = Body(), WheelOdometry(TRACK, RADIUS)
    for wheels in body.drive(0.5, 1.0, 2.0, 0.2):
        odometry.roll(wheels)
    history = np.array(odometry.history)
    for row in (0, 5, len(history) - 1):
        np.testing.assert_allclose(odometry.at(history[row, 0]), history[row, 1:], atol=1e-12)
    x, y, theta, tilt = odometry.at(0.5 * (history[7, 0] + history[8, 0]))
    np.testing.assert_allclose((x, y, theta, tilt), 0.5 * (history[7, 1:] + history[8, 1:]), atol=1e-9)
    np.testing.assert_array_equal(odometry.at(history[-1, 0] + 9.0), history[-1, 1:])
    np.testing.assert_array_equal(odometry.at(history[0, 0] - 9.0), history[0, 1:])
    assert history[-1, 0] - history[0, 0] > 0.2  # longer than a reading is under way on the board


def test_headings_of_the_past_take_the_shorter_arc():
    odometry = WheelOdometry(TRACK, RADIUS)
    for t, heading in enumerate((0.0, math.pi - 0.1, math.pi + 0.1)):
        odometry.roll(Wheels(float(t), -0.5 * TRACK * heading % WRAP, 0.5 * TRACK * heading, 0.0, WRAP))
    before, after = odometry.at(1.0)[2], odometry.at(2.0)[2]
    assert (before, after) == pytest.approx((math.pi - 0.1, 0.1 - math.pi))
    assert math.remainder(odometry.at(1.5)[2] - math.pi, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_readings_without_a_step_in_time_are_survived():
    odometry = WheelOdometry(TRACK, RADIUS)
    for k in range(5):
        odometry.roll(Wheels(1.0, 0.1 * k, 0.1 * k, 0.0, WRAP))
    odometry.roll(Wheels(0.5, 0.5, 0.5, 0.0, WRAP))
    for t in (0.0, 0.5, 0.7, 1.0, 2.0):
        assert np.all(np.isfinite(odometry.at(t)))
    assert odometry.x == pytest.approx(0.5)


def test_a_board_that_counts_anew_moves_nothing():
    """After a reboot the counts begin at zero; only what is rolled from then on counts."""
    body, odometry = Body(), WheelOdometry(TRACK, RADIUS)
    odometry.roll(body.wheels())
    for wheels in body.drive(0.3, 0.1, 3.0):
        odometry.roll(wheels)
    before, t = (odometry.x, odometry.y, odometry.theta), odometry.history[-1][0]
    assert odometry.roll(Wheels(t + 1.0 / 50.0, 0.0, 0.0, 0.0, WRAP)) == 0.0
    assert (odometry.x, odometry.y, odometry.theta) == before
    assert odometry.restarts == 1
    assert odometry.roll(Wheels(t + 2.0 / 50.0, 0.006, 0.006, 0.0, WRAP)) == pytest.approx(0.006)
