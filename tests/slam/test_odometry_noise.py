"""Odometry's noise comes back out of drives that were made with it; more drives tell more, and none is made up."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from slam.loop_measurements import Loops, measure_loops, rasters
from slam.motion import MotionParams
from slam.odometry_chain import Chain
from slam.odometry_noise import LEARNED, NothingRevealed, corrections_of, fit, jacobian, learn, linearise
from slam.pose import between, compose, wrap
from tests.slam.drives import REACH, laps

TURN, DISTANCE = 0.05, 0.06  # rad and m per root metre
PRESENT = MotionParams(turn_noise=0.1, distance_noise=0.02)


def erring(truth, travelled, turn_bias, seed):
    """Odometry (n, 3) of a true path by the filter's own motion model: the truth is odometry plus errors."""
    rng = np.random.default_rng(seed)
    poses = [truth[0]]
    for (a, b), way in zip(itertools.pairwise(truth), travelled[1:], strict=True):
        motion = between(a, b)
        turn = TURN * math.sqrt(way) * rng.normal() + turn_bias * way
        length = np.hypot(*motion[:2]) - DISTANCE * math.sqrt(way) * rng.normal()
        bearing = math.atan2(motion[1], motion[0]) - 0.5 * turn
        poses.append(
            compose(poses[-1], np.array([length * math.cos(bearing), length * math.sin(bearing), motion[2] - turn]))
        )
    return np.array(poses)


def drives(n, turn_bias=0.0, seed=0):
    """Chains and paths of n drives, and what each saw; the paths are the truth a little off, as a filter's are."""
    drive = laps(2.5, width=8.0, height=6.0, noise=0.0)
    seen = rasters(drive.walls, REACH)
    chains, paths = [], []
    for k in range(n):
        chains.append(Chain.along(erring(drive.truth, drive.travelled, turn_bias, seed + k), drive.travelled))
        rng = np.random.default_rng(100 + seed + k)
        paths.append(drive.truth + np.cumsum(rng.normal(0.0, [0.004, 0.004, 0.001], drive.truth.shape), axis=0))
    return chains, paths, seen


def measured(n, **changes):
    """The measurements of such drives."""
    chains, paths, seen = drives(n, **changes)
    return [linearise(chain, path, measure_loops(path, seen)) for chain, path in zip(chains, paths, strict=True)]


def test_corrections_lead_from_odometry_to_the_path():
    drive = laps(1.0, noise=1.0)
    chain = Chain.along(drive.odometry, drive.travelled)
    path = drive.truth + np.random.default_rng(1).normal(0.0, 0.02, drive.truth.shape)
    corrections = corrections_of(chain, path)
    np.testing.assert_allclose(between(moved_path(path[0], chain, corrections), path), 0.0, atol=1e-9)
    assert np.abs(corrections[2]).max() > 0.01, "the path slips sideways, too"
    np.testing.assert_allclose(corrections_of(chain, drive.odometry), 0.0, atol=1e-12)


def moved_path(start, chain, corrections):
    """Odometry with corrections (3, n), one motion after the other as `slam.motion.moved_pose` makes them."""
    poses = [start]
    for motion, (turn, extra, slip) in zip(chain.motions[1:], corrections.T[1:], strict=True):
        bearing = math.atan2(motion[1], motion[0]) + 0.5 * turn
        ahead, aside = math.hypot(motion[0], motion[1]) + extra, slip
        x, y = (
            math.cos(bearing) * ahead - math.sin(bearing) * aside,
            math.sin(bearing) * ahead + math.cos(bearing) * aside,
        )
        poses.append(compose(poses[-1], np.array([x, y, motion[2] + turn])))
    return np.array(poses)


def test_the_jacobian_is_the_slope():
    drive = laps(1.5, noise=1.0)
    chain = Chain.along(drive.odometry, drive.travelled)
    rng = np.random.default_rng(2)
    first, second = np.array([0, 3, 10]), np.array([25, 17, 40])
    angles = rng.uniform(0.0, 2.0 * math.pi, 3)
    sides = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rows = jacobian(chain, drive.odometry, Loops(first, second, sides, np.zeros(3), np.ones(3), np.arange(3)))

    def places(corrections):
        path = moved_path(drive.odometry[0], chain, corrections)
        return np.sum(between(path[first], path[second])[:, :2] * sides, axis=1)

    n = len(drive.odometry)
    for kind, step in itertools.product(range(3), rng.integers(1, n, 8)):
        change = np.zeros((3, n))
        change[kind, step] = 1e-5
        np.testing.assert_allclose(rows[kind, :, step], (places(change) - places(-change)) / 2e-5, atol=1e-6)


def test_residuals_are_odometrys_own_whatever_path_they_are_taken_about():
    (chain,), (path,), seen = drives(1)
    drive = laps(2.5, width=8.0, height=6.0, noise=0.0)
    truth = drive.truth
    loops = measure_loops(path, seen)
    true = between(truth[loops.first], truth[loops.second]) - between(path[loops.first], path[loops.second])
    exact = loops._replace(offsets=np.sum(true[:, :2] * loops.directions, axis=1))
    none = loops._replace(offsets=np.zeros(len(true)))
    errors = wrap(erring(truth, drive.travelled, 0.0, 0) - truth)
    calm = Chain.along(truth + 0.1 * errors, drive.travelled)  # what is of second order is small
    off = linearise(calm, path, exact).block.residuals - linearise(calm, truth, none).block.residuals
    assert np.std(off) < 0.3 * np.std(exact.offsets)
    measuring = np.std(loops.offsets - exact.offsets)
    assert np.std(linearise(chain, truth, none).block.residuals) > 5.0 * measuring, "errors of odometry are seen"


def test_noise_comes_back_and_more_drives_tell_it_better():
    widths = []
    for n in (2, 8):
        learned = learn(measured(n), PRESENT)
        for which, true in enumerate((TURN, DISTANCE)):
            value, (low, high), name = learned.values[which], learned.intervals[which], LEARNED[which]
            assert low < value < high
            assert low < true < high, f"{name} of {n} drives: {value}, {low} to {high}"
        assert learned.gain > 0.0
        assert learned.n_rows.size == n
        widths.append([math.log(high / low) for low, high in learned.intervals[:2]])
    assert np.all(np.array(widths[1]) < 0.7 * np.array(widths[0]))


def test_a_bias_in_one_direction_is_found():
    learned = learn(measured(2, turn_bias=0.04), PRESENT)
    for bias, deviation in learned.biases:
        assert deviation < 0.01
        assert bias == pytest.approx(0.04, abs=4.0 * deviation)
    low, high = learned.intervals[LEARNED.index("turn_bias")]
    assert 0.01 < low < 0.04 < high


def test_the_same_drives_give_the_same_bits_and_progress_rises_to_one():
    shares = []
    first, again = learn(measured(1), PRESENT, shares.append), learn(measured(1), PRESENT)
    np.testing.assert_array_equal(first.values, again.values)
    np.testing.assert_array_equal(first.intervals, again.intervals)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)


def test_a_drive_that_errs_otherwise_stands_out():
    chains, paths, seen = drives(4)
    calm = Chain.along(paths[3], chains[3].travelled)  # its odometry is its path: a robot that hardly errs
    unlike = learn([*measured(4)[:3], linearise(calm, paths[3], measure_loops(paths[3], seen))], PRESENT).unlike
    assert unlike[3] > 8.0
    assert np.all(unlike[:3] < 8.0)


def test_the_truth_is_hardly_less_likely_than_the_best_and_what_is_far_off_is():
    found = fit(measured(4), PRESENT)
    assert 0.0 <= found.fall([TURN], [0]) < 4.0
    assert found.fall([4.0 * TURN], [0]) > 20.0
    assert found.fall(np.exp(found.best.log_sizes[:2]), [0, 1]) == pytest.approx(0.0, abs=1e-3)


def test_drives_that_never_come_back_reveal_nothing():
    (chain, _), (path, _), seen = drives(2)
    path, chain = path[:20], Chain(chain.motions[:20], chain.travelled[:20])
    nothing = linearise(chain, path, measure_loops(path, seen))
    with pytest.raises(NothingRevealed, match="0 measurements"):
        learn([nothing, nothing], PRESENT)
    (drive,) = measured(1)
    both = learn([drive, nothing], PRESENT)
    assert both.n_rows[1] == both.unlike[1] == 0
    np.testing.assert_allclose(both.values, learn([drive], PRESENT).values, rtol=1e-6)
