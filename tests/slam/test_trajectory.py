"""From vertices to every reading: hit exactly, rigid, continuous, and the same as one row at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.pose import between, compose, wrap
from slam.trajectory import correct
from tests.naive import trajectory as naive


def drive(seed, n=120, step=0.05):
    """Odometry (n, 3) of a winding drive."""
    rng = np.random.default_rng(seed)
    headings = np.cumsum(rng.normal(0.0, 0.1, n)) + rng.uniform(-3.0, 3.0)
    places = np.cumsum(step * np.stack([np.cos(headings), np.sin(headings)], axis=1), axis=0)
    return np.column_stack([places, wrap(headings)])


def corrections(seed, odometry, rows):
    """A path (v, 3) through the rows that differs more and more."""
    rng = np.random.default_rng(seed + 100)
    drift = np.cumsum(rng.normal(0.0, [0.05, 0.05, 0.03], (len(rows), 3)), axis=0)
    return compose(odometry[rows], drift)


def assert_same(a, b, atol=1e-9):
    np.testing.assert_allclose(a[:, :2], b[:, :2], atol=atol)
    np.testing.assert_allclose(wrap(a[:, 2] - b[:, 2]), 0.0, atol=atol)


@given(st.integers(0, 1000), st.lists(st.integers(0, 119), min_size=1, max_size=12, unique=True).map(sorted))
def test_correction_agrees_with_row_by_row(seed, rows):
    odometry = drive(seed)
    path = corrections(seed, odometry, rows)
    found = correct(odometry, np.array(rows), path)
    assert found.shape == odometry.shape
    assert np.all(np.abs(found[:, 2]) <= math.pi)
    assert_same(found, naive.correct(odometry, rows, path))


@pytest.mark.parametrize("rows", [[0], [60], [119], [0, 119], [3, 40, 41, 100], list(range(120))])
def test_a_path_that_is_the_odometry_changes_nothing(rows):
    odometry = drive(1)
    assert_same(correct(odometry, np.array(rows), odometry[rows]), odometry)


@pytest.mark.parametrize("rows", [[0], [60], [3, 40, 41, 100]])
def test_a_rigidly_moved_path_moves_everything_rigidly(rows):
    odometry, motion = drive(2), np.array([5.0, -3.0, 2.5])
    assert_same(correct(odometry, np.array(rows), compose(motion, odometry[rows])), compose(motion, odometry))


@pytest.mark.parametrize("seed", range(5))
def test_vertices_are_hit_exactly(seed):
    odometry, rows = drive(seed), np.array([0, 11, 25, 26, 70, 119])
    path = corrections(seed, odometry, rows)
    assert_same(correct(odometry, rows, path)[rows], path)


@pytest.mark.parametrize("seed", range(5))
def test_nothing_jumps(seed):
    """Each step differs from the odometry's by no more than its share of the correction between two vertices."""
    odometry, rows = drive(seed, 1200, 0.005), np.arange(0, 1200, 100)
    path = corrections(seed, odometry, rows)
    poses = correct(odometry, rows, path)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    assert np.all(np.abs(steps - 0.005) < 0.3 / 100 + 0.002)
    turns = wrap(np.diff(poses[:, 2]) - np.diff(odometry[:, 2]))
    assert np.all(np.abs(turns) < 0.15 / 100 + 1e-9)


def test_what_lies_before_and_after_the_vertices_follows_rigidly():
    odometry, rows = drive(3), np.array([30, 80])
    path = corrections(3, odometry, rows)
    poses = correct(odometry, rows, path)
    assert_same(between(poses[30], poses[:30]), between(odometry[30], odometry[:30]))
    assert_same(between(poses[80], poses[81:]), between(odometry[80], odometry[81:]))


def test_standing_still_is_no_division_by_zero():
    odometry = np.vstack([drive(4)[:20], np.repeat(drive(4)[19:20], 30, axis=0), drive(4)[20:]])
    rows = np.array([0, 19, 40, 45, 100])
    path = corrections(4, odometry, rows)
    poses = correct(odometry, rows, path)
    assert np.all(np.isfinite(poses))
    assert_same(poses[rows], path)


@pytest.mark.parametrize(("rows", "n"), [([], 0), ([1, 2], 3), ([1], 0)])
def test_rows_and_path_must_go_together(rows, n):
    with pytest.raises(ValueError, match="vertex rows"):
        correct(drive(5), np.array(rows, int), np.zeros((n, 3)))
