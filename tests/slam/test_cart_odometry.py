"""A cart's arcs are exact, and stages add up."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.cart_odometry import (
    BACK,
    DRIVE,
    MIDDLE,
    TURN,
    CartParams,
    Stage,
    arc,
    arcs,
    bumper_points,
    bumps_of,
    grown,
    raw_path,
    turn_variance,
    way_variance,
)
from slam.pose import compose, inverse, wrap
from tests.naive import cart_odometry as naive

PARAMS = CartParams()
TICKS = st.integers(-900, 900)


@pytest.mark.parametrize(
    ("left", "right"),
    [(300, 300), (300, 340), (340, 300), (-60, -60), (-60, -70), (-40, 40), (55, -50), (0, 80), (1, 0), (0, 0)],
)
def test_agrees_with_many_small_steps(left, right):
    small = naive.arc(left, right, PARAMS.wheelbase, PARAMS.tick)
    np.testing.assert_allclose(arc(left, right, PARAMS), small, atol=1e-7)


def test_a_quarter_circle_ends_where_it_should():
    radius, quarter = 0.5, math.pi / 2.0
    cart = CartParams(wheelbase=0.1, tick=quarter / 1000.0)  # the inner wheel's circle is 0.45 m, the outer's 0.55 m
    np.testing.assert_allclose(arc(450, 550, cart), [radius, radius, quarter], atol=1e-12)


def test_a_turn_on_the_spot_leaves_the_cart_where_it_is():
    np.testing.assert_allclose(arc(-50, 50, PARAMS), [0.0, 0.0, 100 * PARAMS.tick / PARAMS.wheelbase], atol=1e-15)


@given(left=TICKS, right=TICKS)
def test_driving_back_undoes_it(left, right):
    there_and_back = compose(arc(left, right, PARAMS), arc(-left, -right, PARAMS))
    np.testing.assert_allclose(there_and_back, 0.0, atol=1e-9)


@given(left=TICKS, right=TICKS, share=st.integers(1, 9))
def test_an_arc_is_the_sum_of_its_parts(left, right, share):
    parts = compose(arc(share * left, share * right, PARAMS), arc((10 - share) * left, (10 - share) * right, PARAMS))
    whole = arc(10 * left, 10 * right, PARAMS)
    np.testing.assert_allclose(parts[:2], whole[:2], atol=1e-9)
    assert abs(wrap(parts[2] - whole[2])) < 1e-9


@given(left=TICKS, right=TICKS)
def test_the_mirrored_cart_takes_the_mirrored_way(left, right):
    np.testing.assert_allclose(arc(right, left, PARAMS), arc(left, right, PARAMS) * [1.0, -1.0, -1.0], atol=1e-12)


@given(ticks=st.integers(-900, 900))
def test_nearly_straight_is_nearly_as_straight(ticks):
    straight, bent = arc(ticks, ticks, PARAMS), arc(np.array([ticks]), np.array([ticks + 1e-9]), PARAMS)[0]
    np.testing.assert_allclose(bent, straight, atol=1e-9)


def test_many_stages_at_once_are_each_one():
    ticks = np.random.default_rng(1).integers(-500, 500, (20, 2))
    together = arc(ticks[:, 0], ticks[:, 1], PARAMS)
    np.testing.assert_array_equal(together, [arc(left, right, PARAMS) for left, right in ticks])


def test_the_raw_path_adds_stages_end_to_end():
    stages = [Stage(DRIVE, 300, 310, MIDDLE), Stage(BACK, -60, -61), Stage(TURN, -30, 33), Stage(DRIVE, 200, 190, 0)]
    start = np.array([0.3, 0.4, 1.0])
    path = raw_path(stages, PARAMS, start)
    np.testing.assert_array_equal(path[0], start)
    np.testing.assert_allclose(compose(inverse(path[:-1]), path[1:])[:, :2], arcs(stages, PARAMS)[:, :2], atol=1e-12)
    np.testing.assert_array_equal(bumps_of(stages), [0])
    assert raw_path([], PARAMS).shape == (1, 3)


def test_the_bumper_is_ahead_and_as_wide_as_told():
    points = bumper_points(np.array([1.0, 2.0, math.pi / 2.0]), PARAMS)
    half = 0.5 * PARAMS.bumper_width
    np.testing.assert_allclose(points, [[1 - half, 2.09], [1.0, 2.09], [1 + half, 2.09]], atol=1e-12)
    assert bumper_points(np.zeros((4, 5, 3)), PARAMS).shape == (4, 5, 3, 2)


@pytest.mark.parametrize("params", [CartParams(wheelbase=0.0), CartParams(tick=-1.0), CartParams(wheelbase=math.nan)])
def test_a_cart_without_a_size_is_refused(params):
    with pytest.raises(ValueError, match="positive"):
        arc(1, 1, params)


def test_a_variance_grows_as_that_of_slip_that_lasts():
    rng, step, length = np.random.default_rng(5), 0.002, 0.05
    decay = math.exp(-step / length)
    slip, off = rng.standard_normal(20_000), np.zeros(20_000)
    ways, variances = [0.02, 0.05, 0.1, 0.3], []
    for way in np.arange(1, 151) * step:
        off += step * slip
        slip = decay * slip + math.sqrt(1.0 - decay**2) * rng.standard_normal(len(slip))
        if np.any(np.isclose(way, ways)):
            variances.append(np.var(off) / (2.0 * length))  # of a slip of one, per metre in the end
    np.testing.assert_allclose(variances, [grown(way, length) for way in ways], rtol=0.06)


def test_a_variance_grows_as_the_way_where_slip_is_short_and_as_its_square_where_it_is_long():
    assert grown(0.7, 0.0) == 0.7
    np.testing.assert_allclose(grown(0.7, 1e-6), 0.7, rtol=1e-5)
    np.testing.assert_allclose(grown(2e-4, 1.0), 0.5 * 4e-8, rtol=1e-3)
    assert grown(0.0, 0.05) == 0.0


@given(way=st.floats(-3.0, 3.0), turn=st.floats(-6.0, 6.0))
def test_errors_are_the_same_both_ways_and_larger_for_more(way, turn):
    variance = turn_variance(way, turn, PARAMS)
    assert variance == turn_variance(-way, -turn, PARAMS) >= 0.0
    assert turn_variance(2.0 * way, turn, PARAMS) >= variance <= turn_variance(way, 2.0 * turn, PARAMS)
    assert 0.0 <= way_variance(way, PARAMS) <= PARAMS.distance_noise**2 * abs(way)
