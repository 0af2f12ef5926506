"""Noise of motions is found where it was drawn from, with intervals that hold it as often as they say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.motion_noise import LEAST_MOTIONS, cost_of, learn_noise
from slam.scan_motion import LEAST

PRESENT = np.array([0.1, 0.1, 0.2])


def motions(rng, n, sizes, way_scale=1.0, turn_scale=1.0, veer=0.0):
    """Motions told (n, 3), and what they truly were."""
    told = np.column_stack([rng.uniform(0.0, 0.5, n), np.zeros(n), rng.normal(0.0, 0.4, n)])
    distance, turn, rotation = sizes
    root, turned = np.sqrt(told[:, 0]), np.abs(told[:, 2])
    true = told * [way_scale, 1.0, turn_scale] + np.column_stack([np.zeros((n, 2)), veer * told[:, 0]])
    true[:, :2] += np.hypot(distance * root, LEAST[0])[:, None] * rng.standard_normal((n, 2))
    true[:, 2] += np.hypot(np.hypot(turn * root, rotation * turned), LEAST[2]) * rng.standard_normal(n)
    return told, true


@pytest.mark.parametrize("sizes", [(0.1, 0.1, 0.2), (0.03, 0.2, 0.05), (0.2, 0.02, 0.3)])
def test_what_it_was_drawn_from_is_found(sizes):
    found = learn_noise(*motions(np.random.default_rng(1), 4000, sizes), PRESENT)
    assert found.values == pytest.approx(sizes, rel=0.12)
    assert np.all(found.intervals[:, 0] < found.values)
    assert np.all(found.values < found.intervals[:, 1])
    assert found.gain >= 0.0


def test_intervals_hold_the_truth_as_often_as_they_say():
    sizes, held = np.array([0.05, 0.08, 0.15]), []
    for seed in range(24):
        found = learn_noise(*motions(np.random.default_rng(seed), 300, sizes), PRESENT)
        held.append((found.intervals[:, 0] <= sizes) & (sizes <= found.intervals[:, 1]))
    assert np.all(np.mean(held, axis=0) > 0.87)
    assert np.mean(held) < 0.995


def test_what_errs_always_alike_is_told_as_such():
    rng = np.random.default_rng(3)
    found = learn_noise(*motions(rng, 3000, (0.02, 0.02, 0.02), 1.05, 0.9, 0.1), PRESENT)
    assert found.way_scale == pytest.approx(1.05, abs=0.01)
    assert found.turn_scale == pytest.approx(0.9, abs=0.01)
    assert found.veer == pytest.approx(0.1, abs=0.01)


def test_what_is_not_there_has_no_lower_end_and_what_nobody_saw_no_upper_one():
    rng = np.random.default_rng(4)
    told, true = motions(rng, 400, (0.1, 0.1, 0.0))
    assert learn_noise(told, true, PRESENT).intervals[2, 0] == 0.0
    straight = told * [1.0, 1.0, 0.0]
    found = learn_noise(straight, true - told + straight, PRESENT)
    assert found.intervals[2].tolist() == [0.0, math.inf]


def test_the_gradient_is_that_of_the_cost():
    rng = np.random.default_rng(5)
    told, true = motions(rng, 50, (0.1, 0.1, 0.2))
    given = true - told, told[:, 0], np.abs(told[:, 2])
    for _ in range(20):
        here = rng.uniform(-4.0, 0.0, 3)
        for row in range(3):
            step = 1e-6 * np.eye(3)[row]
            slope = (cost_of(here + step, *given)[0] - cost_of(here - step, *given)[0]) / 2e-6
            assert cost_of(here, *given)[1][row] == pytest.approx(slope, rel=1e-4, abs=1e-4)


def test_too_little_is_no_answer():
    told = np.zeros((LEAST_MOTIONS - 1, 3))
    with pytest.raises(ValueError, match="are needed at least"):
        learn_noise(told + [0.1, 0.0, 0.0], told, PRESENT)
    with pytest.raises(ValueError, match="that move"):
        learn_noise(np.zeros((50, 3)), np.zeros((50, 3)), PRESENT)
