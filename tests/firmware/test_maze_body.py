"""Maze Runner's body goes as its motors' curve says, worse on a bad floor, and not through walls."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware.virtual.maze_body import CAPACITY, GROWTH, NOMINAL, RADIUS, STANDING, TRACK, MazeBody
from firmware.virtual.worlds import World
from slam.motor_curve import MotorCurve, fit_curve

HALL = World(np.array([[-9, -9, 9, -9], [9, -9, 9, 9], [9, 9, -9, 9], [-9, 9, -9, -9]], float))
CURVE = MotorCurve(STANDING, GROWTH)


def body(**changes) -> MazeBody:
    made = MazeBody(HALL, 0.0, 0.0, 0.0, **{"drift": "none", **changes})
    made.battery.charge = CAPACITY * 0.66  # where it has about the volts of the curve
    return made


def drive(made: MazeBody, powers: tuple[float, float], seconds: float) -> None:
    for _ in range(round(seconds / 0.01)):
        made.step(powers, 0.01)


@pytest.mark.parametrize("power", [0.15, 0.3, 0.6])
def test_speed_follows_the_curve_at_the_batterys_volts(power):
    made = body()
    drive(made, (power, power), 2.0)
    before, volts = made.distance, made.battery.volts
    drive(made, (power, power), 2.0)
    assert (made.distance - before) / 2.0 == pytest.approx(float(CURVE.speed(power * volts / NOMINAL)), rel=0.01)
    assert made.y == pytest.approx(0.0, abs=1e-9)


def test_the_paper_s_fit_finds_the_curve_again_from_trials():
    powers, distances, times = np.linspace(0.15, 0.9, 6), [], []
    for power in powers:
        made = body()
        drive(made, (power, power), 1.0)
        before = made.distance
        drive(made, (power, power), 4.0)
        distances.append(made.distance - before)
        times.append(4.0)
    fit = fit_curve(powers, np.array(distances), np.array(times))
    assert fit.curve.growth == pytest.approx(GROWTH, rel=0.05)
    assert fit.curve.standing == pytest.approx(STANDING, rel=0.1)


def test_below_the_dead_band_it_stands():
    made = body()
    drive(made, (0.08, -0.08), 3.0)
    assert np.array_equal(made.pose, np.zeros(3))


def test_wheels_against_each_other_turn_it_on_the_spot():
    made = body()
    drive(made, (-0.3, 0.3), 1.0)
    start = made.heading
    drive(made, (-0.3, 0.3), 1.0)
    rate = math.remainder(made.heading - start, 2.0 * math.pi)
    assert rate == pytest.approx(2.0 * made.speeds[1] / TRACK, rel=0.01)
    assert math.hypot(made.x, made.y) < 1e-6


def test_unlike_motors_and_slip_drive_arcs_that_differ_by_seed():
    ends = []
    for seed in range(6):
        made = body(seed=seed, drift="high")
        drive(made, (0.4, 0.4), 5.0)
        ends.append(made.pose)
    assert np.std([end[2] for end in ends]) > 0.1
    again = body(seed=3, drift="high")
    drive(again, (0.4, 0.4), 5.0)
    assert np.array_equal(again.pose, ends[3])


def test_walls_stop_it_and_let_it_slide_and_turn():
    made = body()
    made.x, made.heading = 8.5, 0.3
    drive(made, (0.5, 0.5), 4.0)
    assert made.x <= 9.0 - RADIUS + 1e-6
    assert made.y > 0.1
    assert made.bumps == 1
    drive(made, (-0.4, 0.4), 3.0)
    drive(made, (0.5, 0.5), 3.0)
    assert made.x < 9.0 - RADIUS
    assert made.bumps <= 2


def test_the_battery_sags_under_load_and_with_time():
    made = body()
    drive(made, (0.0, 0.0), 0.1)
    idle = made.battery.volts
    drive(made, (1.0, 1.0), 0.1)
    assert made.battery.volts < idle - 0.3
    for _ in range(200):
        made.battery.drain(3.0, 20.0)
    assert made.battery.volts < 10.0
