"""Scores: zero for the truth itself, known numbers for known errors, one line for what cannot be compared."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from server.errors import UserError
from server.formats.tum import write_tum
from server.score import score
from slam.pose import between, compose

N = 400
ANGLES = np.linspace(0.0, 4.0 * np.pi, N)  # twice around a circle of 5 m
TRUTH = np.column_stack([5.0 * np.cos(ANGLES), 5.0 * np.sin(ANGLES), ANGLES + 0.5 * np.pi])
TIMES = 1000.0 + 0.1 * np.arange(N)


@pytest.fixture
def truth(tmp_path) -> Path:
    write_tum(tmp_path / "truth.tum", TIMES, TRUTH)
    return tmp_path / "truth.tum"


def write_trajectory(folder: Path, poses: np.ndarray, times: np.ndarray = TIMES) -> Path:
    folder.mkdir(exist_ok=True)
    write_tum(folder / "trajectory.tum", times, poses)
    return folder


def test_the_truth_moved_rigidly_has_no_error(tmp_path, truth):
    moved = compose(np.array([3.0, -4.0, 1.1]), TRUTH)
    scores = score(write_trajectory(tmp_path / "out", moved), truth)
    assert scores["poses_used"] == N
    assert scores["ate"]["translation_m"]["max"] < 1e-5
    assert scores["rpe_per_metre"]["translation_m"]["max"] < 1e-5
    assert scores["revisits"]["closed"]
    unaligned = score(tmp_path / "out", truth, is_aligned=False)
    assert unaligned["ate"]["translation_m"]["mean"] > 1.0
    json.dumps(scores, allow_nan=False)


def test_a_folder_and_its_trajectory_score_alike(tmp_path, truth):
    folder = write_trajectory(tmp_path / "out", TRUTH)
    assert score(folder, truth) == score(folder / "trajectory.tum", truth)


def test_time_offset_is_truth_minus_estimate(tmp_path, truth):
    folder = write_trajectory(tmp_path / "out", TRUTH, TIMES - 1000.0)
    assert score(folder, truth, time_offset=1000.0)["ate"]["translation_m"]["max"] < 1e-5
    with pytest.raises(UserError, match="shift them with --time-offset"):
        score(folder, truth)


def test_poses_without_a_true_one_are_not_used(tmp_path, truth):
    folder = write_trajectory(tmp_path / "out", np.vstack([TRUTH, TRUTH]), np.concatenate([TIMES, TIMES + 500.0]))
    scores = score(folder, truth)
    assert (scores["poses"], scores["poses_used"]) == (2 * N, N)


def test_relations_have_the_errors_that_were_put_in(tmp_path):
    first, second = np.arange(0, 300, 10), np.arange(50, 350, 10)
    motions = between(TRUTH[first], TRUTH[second])
    motions[:, 0] += 0.3
    motions[:, 1] -= 0.4
    motions[:, 2] += math.radians(2.0)
    rows = [
        f"{TIMES[a]} {TIMES[b]} {x} {y} 0 0 0 {theta}\n"
        for a, b, (x, y, theta) in zip(first, second, motions, strict=True)
    ]
    (tmp_path / "a.relations").write_text("".join(rows))
    scores = score(write_trajectory(tmp_path / "out", TRUTH), relations=tmp_path / "a.relations")
    assert scores["relations"]["n"] == 30
    assert scores["relations"]["translation_m"]["mean"] == pytest.approx(0.5, abs=1e-4)
    assert scores["relations"]["rotation_deg"]["mean"] == pytest.approx(2.0, abs=1e-4)


def test_nothing_to_compare_with_is_told(tmp_path, truth):
    folder = write_trajectory(tmp_path / "out", TRUTH)
    with pytest.raises(UserError, match="give --truth"):
        score(folder)
    with pytest.raises(UserError, match=r"trajectory\.tum: no such file"):
        score(tmp_path / "nothing", truth)
    (tmp_path / "late.relations").write_text("1 2 0 0 0 0 0 0\n")
    with pytest.raises(UserError, match="no relation lies within"):
        score(folder, relations=tmp_path / "late.relations")
