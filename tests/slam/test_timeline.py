"""Poses are matched and interpolated by times that may repeat and step back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.timeline import associate, interpolate, merge_repeats
from tests.naive import evaluate as naive

MESSY_TIMES = st.lists(st.integers(0, 20).map(float), min_size=1, max_size=40).map(np.array)


def random_trajectory(n, seed):
    """Strictly ascending times (n,) and poses (n, 3)."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.1, 1.0, n))
    return times, np.column_stack([rng.normal(size=(n, 2)), rng.uniform(-math.pi, math.pi, n)])


@given(MESSY_TIMES)
def test_equal_times_match_row_by_row_in_any_order(times):
    matches = associate(times, times)
    np.testing.assert_array_equal(matches.rows, np.arange(times.size))
    np.testing.assert_array_equal(matches.reference_rows, np.arange(times.size))


@given(MESSY_TIMES, MESSY_TIMES)
def test_matches_are_the_nearest_in_time(times, reference_times):
    matches = associate(times + 0.3, reference_times, max_difference=2.0)
    shorter_is_estimate = times.size <= reference_times.size
    assert np.all(np.diff(matches.rows if shorter_is_estimate else matches.reference_rows) > 0)
    differences = np.abs(times[:, None] + 0.3 - reference_times)
    nearest = differences.min(axis=1 if shorter_is_estimate else 0)
    assert len(matches.rows) == np.sum(nearest <= 2.0)
    found = differences[matches.rows, matches.reference_rows]
    np.testing.assert_array_equal(found, nearest[nearest <= 2.0])


def test_offset_is_added_to_the_estimate():
    times = np.arange(10.0)
    matches = associate(times, times + 100.0, offset=103.0)
    np.testing.assert_array_equal(matches.reference_rows - matches.rows, 3)
    assert matches.rows.size == 7


def test_far_times_do_not_match():
    assert associate(np.array([1.0, 2.0]), np.array([1.02, 2.005])).rows.tolist() == [1]
    assert associate(np.array([1.0]), np.empty(0)).rows.size == 0
    assert associate(np.empty(0), np.empty(0)).rows.size == 0


def test_repeats_match_in_file_order_and_the_last_stands_for_the_missing():
    matches = associate(np.array([5.0, 5.0, 5.0]), np.array([5.0, 9.0, 5.0, 7.0]))
    assert matches.reference_rows.tolist() == [0, 2, 2]


def test_interpolation_agrees_with_two_rows_at_a_time():
    times, poses = random_trajectory(40, 1)
    at = np.random.default_rng(2).uniform(times[0] - 2.0, times[-1] + 2.0, 200)
    found, is_known = interpolate(times, poses, at)
    for time, pose, known in zip(at, found, is_known, strict=True):
        expected = naive.interpolate(times, poses, time)
        assert known == (expected is not None)
        if expected is not None:
            np.testing.assert_allclose(pose[:2], expected[:2], atol=1e-12)
            assert math.remainder(pose[2] - expected[2], 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)
        else:
            assert np.all(np.isnan(pose))


def test_rows_are_reproduced_at_their_own_times():
    times, poses = random_trajectory(30, 3)
    shuffled = np.random.default_rng(4).permutation(30)
    found, is_known = interpolate(times[shuffled], poses[shuffled], times)
    assert is_known.all()
    np.testing.assert_allclose(found, poses, atol=1e-12)


def test_headings_take_the_shorter_arc():
    poses = np.array([[0.0, 0.0, 3.0], [1.0, 0.0, -3.0]])
    found, _ = interpolate(np.array([0.0, 1.0]), poses, np.array([0.5]))
    np.testing.assert_allclose(found, [[0.5, 0.0, math.pi]], atol=1e-12)


def test_wide_gaps_are_unknown():
    times, poses = np.array([0.0, 1.0, 5.0, 6.0]), np.zeros((4, 3))
    _, is_known = interpolate(times, poses, np.array([0.5, 1.0, 3.0, 5.0, 5.5]), max_gap=2.0)
    assert is_known.tolist() == [True, True, False, True, True]


def test_repeated_times_are_averaged_on_the_circle():
    times = np.array([2.0, 1.0, 2.0])
    poses = np.array([[0.0, 4.0, 3.1], [7.0, 7.0, 0.1], [2.0, 0.0, -3.1]])
    distinct, merged = merge_repeats(times, poses)
    assert distinct.tolist() == [1.0, 2.0]
    np.testing.assert_allclose(merged[0], [7.0, 7.0, 0.1])
    np.testing.assert_allclose(merged[1], [1.0, 2.0, math.pi])


def test_an_empty_trajectory_knows_nothing():
    found, is_known = interpolate(np.empty(0), np.empty((0, 3)), np.array([1.0, 2.0]))
    assert found.shape == (2, 3)
    assert not is_known.any()
