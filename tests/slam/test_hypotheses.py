"""How hypotheses compare: the lead counts only paths of other maps, wherever maps begin."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware.virtual.lanes import parallel_corridors
from slam.evaluate import absolute_error
from slam.hypotheses import DECIDED, Hypothesis, Verdict, is_elsewhere, verdict
from slam.pose import between, compose


def square(side: float = 8.0, laps: int = 2) -> np.ndarray:
    """Around a square, a pose every metre."""
    steps = np.arange(0.0, side)
    sides = [(side * np.array(corner), angle) for corner, angle in zip(
        ((0, 0), (1, 0), (1, 1), (0, 1)), np.radians([0, 90, 180, 270]), strict=True)]  # fmt: skip
    lap = [
        np.column_stack([corner[0] + steps * math.cos(angle), corner[1] + steps * math.sin(angle), 0 * steps + angle])
        for corner, angle in sides
    ]
    return np.concatenate(laps * lap)


def bent(path: np.ndarray, turn: float) -> np.ndarray:
    """The path with a bend in its middle."""
    half = len(path) // 2
    turned = compose(path[half], np.array([0.0, 0.0, turn]))
    return np.concatenate([path[:half], compose(turned, between(path[half], path[half:]))])


def test_a_map_that_begins_elsewhere_is_the_same_map():
    path = square()
    moved = compose(np.array([3.0, -7.0, 2.1]), path)
    assert not is_elsewhere(path, moved)
    assert is_elsewhere(path, bent(path, 0.6))
    assert is_elsewhere(bent(path, 0.6), path), "it is mutual"


def test_an_end_that_nothing_holds_makes_no_other_map():
    path = np.concatenate([square(), np.array([[-1.0 - step, 0.0, math.pi] for step in range(12)])])
    swung = path.copy()
    swung[-12:] = compose(compose(path[-12], np.array([0.0, 0.0, 0.5])), between(path[-12], path[-12:]))
    assert absolute_error(path, swung).translation.rmse > 0.5
    assert not is_elsewhere(path, swung)


@pytest.mark.parametrize("seed", [0, 2, 4, 6])
def test_a_corridor_laid_on_the_next_makes_another_map(seed):
    points = parallel_corridors(seed).plan.points
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.arange(0.0, way[-1], 0.5)
    path = np.column_stack([*(np.interp(at, way, axis) for axis in points.T), 0.0 * at])
    inside = np.flatnonzero((path[:, 1] > 1.0) & (path[:, 1] < path[:, 1].max() - 1.0))
    lanes = [lane for lane in np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1) if len(lane) > 10]
    lane = lanes[len(lanes) // 2 + 1]  # of the second lap
    steps = np.array([path[other, 0].mean() - path[lane, 0].mean() for other in lanes])
    merged = path.copy()
    merged[lane, 0] += steps[(np.abs(steps) > 0.9) & (np.abs(steps) < 2.0)][0]
    assert absolute_error(path, merged).translation.rmse < 0.5, "which does not show it"
    assert is_elsewhere(path, merged)
    assert is_elsewhere(merged, path)


def test_the_lead_is_over_the_best_of_the_others():
    path = square()
    near = path + np.array([0.15, 0.0, 0.0]) * (np.arange(len(path)) % 2)[:, None]
    known = [Hypothesis(50.0, bent(path, 0.6)), Hypothesis(100.0, path), Hypothesis(99.0, near),
             Hypothesis(60.0, bent(path, -0.9))]  # fmt: skip
    found = verdict(known, restarts=2)
    assert found == Verdict(40.0, agreeing=2, of=4, restarts=2)
    assert not found.is_open


def test_where_nobody_differs_nothing_is_open():
    assert verdict([]) == Verdict(math.inf, 0, 0, 0)
    assert verdict([Hypothesis(-3.0, square())]) == Verdict(math.inf, 1, 1, 0)
    assert not verdict([]).is_open


def test_nearly_as_good_is_open():
    path = square()
    assert verdict([Hypothesis(DECIDED - 0.1, path), Hypothesis(0.0, bent(path, 0.6))]).is_open
    assert not verdict([Hypothesis(DECIDED, path), Hypothesis(0.0, bent(path, 0.6))]).is_open
