"""The motor's curve: what it commands moves as fast as was wanted, and trials find it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.motor_curve import MotorCurve, MotorOdometry, MotorParams, fit_curve

PAPER = MotorCurve(0.090149, 6.44209)  # Maze Runner, after equation 2


@given(st.floats(-0.37, 0.37))
def test_a_power_makes_the_speed_it_was_meant_for(speed):
    assert PAPER.speed(PAPER.command(speed)) == pytest.approx(speed, abs=1e-12)


def test_it_stands_without_a_wish_and_within_the_dead_band():
    assert PAPER.command(0.0) == 0.0
    assert PAPER.speed(np.array([0.0, 0.05, -0.09, 0.090149])) == pytest.approx(np.zeros(4), abs=1e-12)
    assert abs(float(PAPER.command(1e-9))) == pytest.approx(0.090149)


def test_no_power_is_beyond_the_whole():
    assert PAPER.fastest == pytest.approx(math.log(1 / 0.090149) / 6.44209)
    assert PAPER.command(np.array([5.0, -5.0])) == pytest.approx([1.0, -1.0])
    assert PAPER.speed(np.array([1.0, -3.0])) == pytest.approx([PAPER.fastest, -PAPER.fastest])


def test_trials_without_error_give_the_curve_back():
    speeds = np.linspace(0.05, 0.35, 7)
    fit = fit_curve(PAPER.command(speeds), 2.0 * speeds, np.full(7, 2.0))
    assert fit.curve == pytest.approx(PAPER)
    assert fit.residuals == pytest.approx(np.zeros(7), abs=1e-9)


def test_it_is_the_paper_s_least_squares():
    rng = np.random.default_rng(2)
    x = rng.uniform(0.05, 0.35, 12)
    y = np.minimum(1.0, PAPER.command(x) * np.exp(0.05 * rng.standard_normal(12)))
    n, log = len(x), np.log(y)
    below = n * np.sum(x**2) - np.sum(x) ** 2
    a = (np.sum(log) * np.sum(x**2) - np.sum(x) * np.sum(x * log)) / below  # equation 2, its symbols set right
    b = (n * np.sum(x * log) - np.sum(x) * np.sum(log)) / below
    assert fit_curve(y, x, np.ones(n)).curve == pytest.approx((math.exp(a), b))


def test_the_deviations_hold_the_truth_as_often_as_they_should():
    rng = np.random.default_rng(7)
    inside = []
    for _ in range(400):
        speeds = rng.uniform(0.02, 0.3, 15)
        fit = fit_curve(PAPER.command(speeds) * np.exp(0.04 * rng.standard_normal(15)), speeds, np.ones(15))
        inside.append(abs(fit.curve.growth - PAPER.growth) < 2.16 * fit.growth_sigma)  # 95 % of Student's t, 13 degrees
    assert np.mean(inside) == pytest.approx(0.95, abs=0.033)  # three deviations of 400 draws


@pytest.mark.parametrize(
    ("powers", "distances", "times", "told"),
    [
        ([0.0, 0.5], [1, 2], [1, 1], "above 0 and at most 1"),
        ([0.5, 1.2], [1, 2], [1, 1], "above 0 and at most 1"),
        ([0.5, math.nan], [1, 2], [1, 1], "above 0 and at most 1"),
        ([0.2, 0.5], [0, 2], [1, 1], "leave out trials"),
        ([0.2, 0.5], [1, 2], [1, math.inf], "leave out trials"),
        ([0.2, 0.5], [1, 1], [1, 1], "two speeds"),
        ([0.2], [1], [1], "two speeds"),
        ([0.5, 0.2], [1, 2], [1, 1], "swapped columns"),
    ],
)
def test_trials_that_tell_no_curve_are_refused(powers, distances, times, told):
    with pytest.raises(ValueError, match=told):
        fit_curve(np.array(powers), np.array(distances), np.array(times))


def test_two_trials_tell_a_curve_and_nothing_of_its_certainty():
    fit = fit_curve(np.array([0.2, 0.5]), np.array([0.1, 0.2]), np.ones(2))
    assert math.isnan(fit.growth_sigma)
    assert fit.curve.command(np.array([0.1, 0.2])) == pytest.approx([0.2, 0.5])


def driven(params, words, seconds, step=0.02):
    """Where an odometry is that was told powers for some seconds each."""
    odometry, t = MotorOdometry(params), 0.0
    for powers, length in zip(words, seconds, strict=True):
        for _ in range(round(length / step)):
            odometry.step(t, powers, params.nominal_volts)
            t += step
    odometry.step(t, (0.0, 0.0), params.nominal_volts)
    return odometry


def test_straight_on_it_goes_as_fast_as_the_curve_says_but_for_the_lag():
    params = MotorParams(lag=0.1)
    power = float(PAPER.command(0.25))
    odometry = driven(params, [(power, power)], [4.0])
    assert odometry.pose == pytest.approx([0.25 * (4.0 - 0.1), 0.0, 0.0], abs=1e-6)


def test_steps_of_any_length_lead_to_the_same_place():
    params, words = MotorParams(), [(0.4, 0.3), (-0.3, 0.5), (0.0, 0.0), (0.6, 0.6)]
    coarse, fine = (driven(params, words, [1.0] * 4, step) for step in (0.05, 0.0025))
    assert coarse.pose == pytest.approx(fine.pose, abs=2e-3)


def test_a_sagging_battery_slows_it_down_and_unlike_motors_turn_it():
    params = MotorParams(lag=0.0)
    full, sagged = MotorOdometry(params), MotorOdometry(params)
    for odometry, volts in ((full, 11.4), (sagged, 10.0)):
        odometry.step(0.0, (0.4, 0.4), volts)
        odometry.step(1.0, (0.4, 0.4), volts)
    assert sagged.pose[0] == pytest.approx(float(PAPER.speed(0.4 * 10.0 / 11.4)))
    assert sagged.pose[0] < full.pose[0]
    unlike = driven(MotorParams(growth=(6.4, 6.8)), [(0.4, 0.4)], [2.0])
    assert unlike.pose[2] < -0.1


def test_time_that_steps_back_moves_nothing():
    odometry = MotorOdometry(MotorParams(lag=0.0))
    odometry.step(1.0, (0.5, 0.5), 11.4)
    assert odometry.step(0.5, (0.5, 0.5), 11.4) == 0.0
    assert np.array_equal(odometry.pose, np.zeros(3))
