"""The motion model: means and spreads follow the formulas, errors act by halves, biases grow with the way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.counter_random import gaussian, vertex_key
from slam.motion import ANGLE, DISTANCE, TURN_BIAS, draw_biases, moved_pose, propagate, step_of
from slam.pose import compose, wrap
from tests.naive import motion as naive

N = 100_000
NOISE = np.array([0.04, 0.055, 0.05])
MOTIONS = [(0.5, 0.0, 0.0), (0.45, 0.1, 0.4), (-0.5, 0.02, -0.1), (0.0, 0.0, 1.5)]


def spread_out(motion, travelled, noise=NOISE, turn_bias=0.0, scale_bias=0.0, n=N, start=(0.0, 0.0, 0.0), seed=1):
    """Poses (n, 3) of n particles after one motion from one start, and their log densities (n,)."""
    poses, moved, plausibilities = np.tile(np.asarray(start, float), (n, 1)), np.empty((n, 3)), np.zeros(n)
    propagate(
        poses, np.arange(n), step_of(np.asarray(motion, float), travelled, np.asarray(noise, float)),
        np.uint64(vertex_key(seed, 7)), np.full(n, turn_bias), np.full(n, scale_bias), 0, n, moved, plausibilities,
    )  # fmt: skip
    return moved, plausibilities


def test_no_noise_is_odometry():
    for motion in MOTIONS:
        for start in ((0.0, 0.0, 0.0), (3.0, -4.0, 2.5), (-70.0, 9.0, -3.1)):
            moved, _ = spread_out(motion, 0.5, np.zeros(3), n=3, start=start)
            expected = compose(np.array(start), np.array(motion))
            np.testing.assert_allclose(moved[:, :2], np.tile(expected[:2], (3, 1)), atol=1e-12)
            np.testing.assert_allclose(wrap(moved[:, 2] - expected[2]), 0.0, atol=1e-12)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize(("turn_bias", "scale_bias"), [(0.0, 0.0), (0.05, -0.03)])
def test_means_and_spreads_follow_the_formulas(motion, turn_bias, scale_bias):
    """Turn ~ N(bias s, turn^2 s + (rotation dtheta)^2), length ~ N(d (1 + bias), distance^2 s), uncorrelated."""
    travelled = 0.6
    moved, _ = spread_out(motion, travelled, turn_bias=turn_bias, scale_bias=scale_bias)
    turns = wrap(moved[:, 2] - motion[2])
    sigma = math.hypot(NOISE[0] * math.sqrt(travelled), NOISE[2] * motion[2])
    assert turns.mean() == pytest.approx(turn_bias * travelled, abs=4.0 * sigma / math.sqrt(N))
    assert turns.std() == pytest.approx(sigma, rel=4.0 / math.sqrt(2.0 * N))
    straight = math.hypot(motion[0], motion[1])
    headings = math.atan2(motion[1], motion[0]) + 0.5 * turns
    lengths = moved[:, 0] * np.cos(headings) + moved[:, 1] * np.sin(headings)
    spread = NOISE[1] * math.sqrt(travelled)
    assert lengths.mean() == pytest.approx(straight * (1.0 + scale_bias), abs=4.0 * spread / math.sqrt(N))
    assert lengths.std() == pytest.approx(spread, rel=4.0 / math.sqrt(2.0 * N))
    across = moved[:, 1] * np.cos(headings) - moved[:, 0] * np.sin(headings)
    np.testing.assert_allclose(across, 0.0, atol=1e-12)  # wheels do not slip sideways
    assert np.corrcoef(turns, lengths)[0, 1] == pytest.approx(0.0, abs=4.0 / math.sqrt(N))


def test_the_mean_place_is_that_of_a_wrapped_gaussian():
    """E cos(turn / 2) = exp(-sigma^2 / 8): the error of angle shortens the mean way."""
    moved, _ = spread_out((0.5, 0.0, 0.0), 0.5, noise=np.array([0.8, 0.1, 0.0]))
    expected = 0.5 * math.exp(-0.5 * 0.8**2 / 8.0)
    assert moved[:, 0].mean() == pytest.approx(expected, abs=4.0 * 0.1 / math.sqrt(N))
    assert moved[:, 1].mean() == pytest.approx(0.0, abs=4.0 * 0.5 / math.sqrt(N))


def test_noise_grows_with_the_root_and_biases_with_the_distance():
    """Four times 0.5 m in a row spread as 2 m at once do."""
    noise = np.array([0.04, 0.05, 0.0])
    once, _ = spread_out((2.0, 0.0, 0.0), 2.0, noise, turn_bias=0.02)
    poses, motion = np.zeros((N, 3)), np.array([0.5, 0.0, 0.0])
    turn_biases, scale_biases = np.full(N, 0.02), np.zeros(N)
    for vertex in range(4):
        moved = np.empty((N, 3))
        step, key = step_of(motion, 0.5, noise), np.uint64(vertex_key(2, vertex))
        propagate(poses, np.arange(N), step, key, turn_biases, scale_biases, 0, N, moved, np.zeros(N))
        poses = moved
    assert poses[:, 2].std() == pytest.approx(once[:, 2].std(), rel=0.02)
    assert poses[:, 2].mean() == pytest.approx(once[:, 2].mean(), abs=0.001)
    assert np.hypot(*poses[:, :2].T).std() == pytest.approx(np.hypot(*once[:, :2].T).std(), rel=0.02)


@pytest.mark.parametrize("seed", range(100))
def test_half_the_turn_acts_before_the_way_and_half_after(seed):
    rng = np.random.default_rng(seed)
    pose, motion, travelled = rng.uniform(-4.0, 4.0, 3), rng.uniform(-1.0, 1.0, 3), rng.uniform(0.0, 2.0)
    angle_error, distance_error, turn_bias, scale_bias = rng.normal(size=4) * [1.0, 1.0, 0.1, 0.1]
    x, y, theta = moved_pose(
        pose[0], pose[1], pose[2], step_of(motion, travelled, NOISE), angle_error, distance_error, turn_bias, scale_bias
    )
    expected = naive.moved_pose(pose, motion, travelled, NOISE, angle_error, distance_error, turn_bias, scale_bias)
    assert (x, y) == pytest.approx(tuple(expected[:2]), abs=1e-12)
    assert math.remainder(theta - expected[2], 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)
    assert -math.pi - 1e-12 <= theta <= math.pi + 1e-12


def test_biases_act_as_turn_per_metre_and_share_of_the_distance():
    straight, _ = spread_out((0.5, 0.0, 0.0), 0.5, np.zeros(3), turn_bias=0.2, scale_bias=0.1, n=1)
    length, turn = 0.5 * 1.1, 0.5 * 0.2
    expected = [length * math.cos(0.5 * turn), length * math.sin(0.5 * turn), turn]
    np.testing.assert_allclose(straight[0], expected, atol=1e-12)
    back, _ = spread_out((-0.5, 0.0, 0.0), 0.5, np.zeros(3), scale_bias=0.1, n=1)
    np.testing.assert_allclose(back[0], [-0.55, 0.0, 0.0], atol=1e-12)


def test_standing_still_adds_nothing_and_is_no_nan():
    moved, _ = spread_out((0.0, 0.0, 0.0), 0.0, turn_bias=0.1, scale_bias=0.1, n=50, start=(1.0, 2.0, 3.0))
    np.testing.assert_array_equal(moved[:, :2], np.tile([1.0, 2.0], (50, 1)))
    np.testing.assert_allclose(moved[:, 2], 3.0, atol=1e-12)


@pytest.mark.parametrize("biases", [(0.0, 0.0), (0.05, -0.03)])
def test_plausibility_is_the_log_density_of_the_corrections(biases):
    """A particle's biases are part of its corrections to the odometry (thesis, 2.4)."""
    motion, travelled = (0.45, 0.1, 0.2), 0.5
    _, plausibilities = spread_out(motion, travelled, turn_bias=biases[0], scale_bias=biases[1], n=2000)
    errors = [[gaussian(1, 7, p, stream) for stream in (ANGLE, DISTANCE)] for p in range(2000)]
    expected = [naive.plausibility(motion, travelled, NOISE, pair, biases) for pair in errors]
    np.testing.assert_allclose(plausibilities, expected, atol=1e-12)
    if biases == (0.0, 0.0):
        assert plausibilities.mean() == pytest.approx(-1.0, abs=4.0 / math.sqrt(2000))  # -chi^2 / 2, two degrees


def test_plausibility_of_a_motion_without_noise_is_a_number():
    for motion in MOTIONS:
        for noise in (NOISE, np.zeros(3)):
            _, plausibilities = spread_out(motion, 0.0, noise, n=5)
            assert np.all(np.isfinite(plausibilities))


def test_particles_and_vertices_err_independently():
    moved, _ = spread_out((0.5, 0.0, 0.0), 0.5)
    other, _ = spread_out((0.5, 0.0, 0.0), 0.5, seed=2)
    assert np.corrcoef(moved[:, 2], other[:, 2])[0, 1] == pytest.approx(0.0, abs=4.0 / math.sqrt(N))
    assert np.corrcoef(moved[:-1, 2], moved[1:, 2])[0, 1] == pytest.approx(0.0, abs=4.0 / math.sqrt(N))


def test_drawn_biases_have_the_spread_asked_for():
    biases = draw_biases(0.03, 5, 0, TURN_BIAS, N)
    assert biases.std() == pytest.approx(0.03, rel=4.0 / math.sqrt(2.0 * N))
    assert biases.mean() == pytest.approx(0.0, abs=4.0 * 0.03 / math.sqrt(N))
    np.testing.assert_array_equal(draw_biases(0.0, 5, 0, TURN_BIAS, 10), 0.0)
    np.testing.assert_array_equal(draw_biases(0.03, 5, 0, TURN_BIAS, 10), biases[:10])
