"""The oracle knows every revisit, and is as good as the truth that it is told."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.oracle import oracle_path, true_loops
from bench.scores import oracle_of
from slam.evaluate import absolute_error, path_length, wrong_meetings
from slam.motion import MotionParams
from slam.pose import between, compose
from tests.slam.test_hypotheses import square

LAPS = 3


@pytest.fixture
def truth():
    """Three laps of a square of 8 m, a vertex every metre."""
    return square(8.0, LAPS)


def drifting(truth, rng, turn=0.02):
    """What odometry makes of a path (n, 3)."""
    motions = between(truth[:-1], truth[1:]) + rng.normal(size=(len(truth) - 1, 3)) * (0.01, 0.0, turn)
    poses = [truth[0]]
    for motion in motions:
        poses.append(compose(poses[-1], motion))
    return np.array(poses)


def test_every_earlier_visit_is_told(truth):
    pairs = true_loops(truth, path_length(truth))
    per_lap = len(truth) // LAPS
    last = pairs[pairs[:, 1] == len(truth) - 3][:, 0]
    assert last.tolist() == [per_lap - 3, 2 * per_lap - 3]


def test_loops_take_drift_away(truth):
    odometry = drifting(truth, np.random.default_rng(1))
    path = oracle_path(odometry, truth, MotionParams(), 0)
    by_odometry, by_loops = (absolute_error(poses, truth).translation.rmse for poses in (odometry, path))
    assert by_loops < 0.3 * by_odometry


def test_a_sparse_truth_misleads_no_oracle(truth):
    """Where true poses stand three metres apart, around corners, the odometry tells the way between them."""
    times = np.arange(len(truth), dtype=float)
    drive = SimpleNamespace(times=times, odometry=truth, rows=np.arange(len(truth)))
    result: Any = SimpleNamespace(drive=drive)
    known = np.arange(1, len(truth), 3)
    assert oracle_of(times[known], truth[known], 0)(result)["oracle_ate"] < 0.02


def test_meetings_of_two_places_are_counted(truth):
    assert wrong_meetings(truth, truth) == 0.0
    moved = truth + np.array([1.0, 0.0, 0.0]) * (np.arange(len(truth)) >= 2 * len(truth) // LAPS)[:, None]
    assert wrong_meetings(truth, moved) == pytest.approx(0.5, abs=0.05), "the third lap is off, the second is not"
    unknown = np.where(np.arange(len(truth))[:, None] < 10, np.nan, truth)
    assert wrong_meetings(truth, unknown) == 0.0
