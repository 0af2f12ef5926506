"""The motor's curve: what it commands moves as fast as was wanted, and trials find it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.motor_curve import MotorCurve, fit_curve

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
