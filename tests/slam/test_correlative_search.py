"""A search of all poses finds the best of its lattice, also where an alignment from the guess would slide elsewhere."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.correlative_search import SearchParams, paint, search, try_poses
from slam.pose import between, compose
from slam.scan_matching import ScanMatchingParams, match_scans
from slam.scan_motion import ScanMotionParams, motion_between
from tests.naive import correlative_search as naive
from tests.slam.laser_world import blind, ring, scan_at

PARAMS = SearchParams()
SIGMAS = np.array([0.2, 0.2, 0.3])


@pytest.mark.parametrize("seed", range(4))
def test_the_best_pose_is_that_of_looking_each_up(seed):
    rng = np.random.default_rng(seed)
    points, others = (scan_at(np.array([1.0, x, 1.5]), ring(), seed).points[::9] for x in (3.0, 3.3))
    guess = rng.uniform([-0.3, -0.3, -0.2], [0.3, 0.3, 0.2])
    half = 300
    grid, best = np.zeros((2 * half, 2 * half), np.float32), np.empty(3)
    paint(others, 0.1, half, grid)
    told = try_poses(points, grid, half, guess, SIGMAS, 3, 2, (0.1, 0.05, 0.2), best)
    assert told == pytest.approx(naive.best_score(points, others, guess, SIGMAS, 3, 2, 0.1, 0.05, 0.2), abs=1e-4)
    off = best - guess
    at_best = naive.score(points, others, best, 0.1, 0.2) - 0.5 * np.sum((off / SIGMAS) ** 2)
    assert at_best == pytest.approx(told, abs=1.0)  # a rounded shift may put an end into the next cell


@settings(deadline=None, max_examples=25)
@given(st.floats(-0.3, 0.3), st.floats(-0.15, 0.15), st.floats(-0.7, 0.7), st.integers(0, 1000))
def test_a_fast_turn_is_found_without_odometry(x, y, turn, seed):
    pose = np.array([5.0, 1.0, 0.1])
    moved = compose(pose, np.array([x, y, turn]))
    scan, before = scan_at(moved, ring(), seed), scan_at(pose, ring(), seed + 1)
    error = between(between(pose, moved), search(scan, before, np.zeros(3), SIGMAS, PARAMS))
    assert np.hypot(*error[:2]) < 0.2
    assert abs(error[2]) < 0.06


def test_motions_are_found_that_an_alignment_alone_does_not_find():
    pose, turns = np.array([5.0, 1.0, 0.1]), np.linspace(-0.7, 0.7, 15)
    params = ScanMotionParams()
    loose = params.model_copy(update={"odometry": params.odometry.model_copy(update={"rotation": 1.0, "turn": 1.0})})
    errors = np.empty((len(turns), 2))
    for row, turn in enumerate(turns):
        moved = compose(pose, np.array([0.2, 0.0, turn]))
        scan, before = scan_at(moved, ring(), row), scan_at(pose, ring(), 100 + row)
        told = np.array([0.2, 0.0, 0.0])
        alone = match_scans(scan, before, told, loose.odometry.information(told), ScanMatchingParams())
        both = motion_between(before, scan, told, loose)
        for column, found in enumerate((alone.pose, both.pose)):
            errors[row, column] = abs(found[2] - turn)
    assert np.sum(errors[:, 0] > 0.05) >= 3
    assert np.all(errors[:, 1] < 0.02)


def test_scans_of_nothing_leave_the_guess_alone():
    guess = np.array([0.1, 0.2, 0.3])
    nothing, some = blind(), scan_at(np.ones(3), ring())
    for scan, other in ((nothing, some), (some, nothing), (nothing, nothing)):
        assert np.array_equal(search(scan, other, guess, SIGMAS, PARAMS), guess)
