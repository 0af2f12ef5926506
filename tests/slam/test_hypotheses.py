"""How hypotheses compare: the lead counts only paths of other maps, wherever maps begin."""

from __future__ import annotations

import math

import numpy as np

from slam.hypotheses import APART, DECIDED, Hypothesis, Verdict, is_elsewhere, verdict
from slam.pose import compose


def square(side: float = 8.0) -> np.ndarray:
    """Once around a square, a pose every metre."""
    steps = np.arange(0.0, side)
    sides = [(side * np.array(corner), angle) for corner, angle in zip(
        ((0, 0), (1, 0), (1, 1), (0, 1)), np.radians([0, 90, 180, 270]), strict=True)]  # fmt: skip
    return np.concatenate([
        np.column_stack([corner[0] + steps * math.cos(angle), corner[1] + steps * math.sin(angle), 0 * steps + angle])
        for corner, angle in sides
    ])  # fmt: skip


def bent(path: np.ndarray, turn: float) -> np.ndarray:
    """The path with a bend in its middle."""
    half = len(path) // 2
    pivot = path[half].copy()
    return np.concatenate([path[:half], compose(pivot, compose(np.array([0, 0, turn]), compose(
        np.array([*(-pivot[:2] @ rotation(-pivot[2]).T), -pivot[2]]), path[half:])))])  # fmt: skip


def rotation(angle: float) -> np.ndarray:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def test_a_map_that_begins_elsewhere_is_the_same_map():
    path = square()
    moved = compose(np.array([3.0, -7.0, 2.1]), path)
    assert not is_elsewhere(path, moved)
    assert is_elsewhere(path, bent(path, 0.6))
    assert is_elsewhere(bent(path, 0.6), path), "it is mutual"


def test_the_lead_is_over_the_best_of_the_others():
    path = square()
    near = path + np.array([0.3 * APART, 0.0, 0.0]) * (np.arange(len(path)) % 2)[:, None]
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
