"""What a log of a robot with a bumper holds, whatever its file looks like: stages of drive, back up, turn.

Robots that tell their wheels' counts all the time are cut into such stages: where they turn round, and where a bumper
closes. A way that is no arc of one radius becomes several stages, so that added end to end they lead where it led.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from server.messages import Cart, CartStage, Message
from slam.cart_odometry import BACK, DRIVE, TURN, CartParams, Stage, arc
from slam.pose import between, compose

LEAST_TICKS = 4  # of both wheels together; less is no stage of its own, unless a bumper closed
SMOOTHED = 5  # samples whose motion tells what a robot does; ticks are too coarse for one
NOT_TOLD = math.nan  # V of a battery
STRAY = 0.002  # m that the arc of a stage may end beside the way


class CartLog(NamedTuple):
    """A run, the build of its robot, and when each stage ended (n,) in s, nan where the log does not say."""

    path: Path
    stages: list[Stage]
    params: CartParams
    times: np.ndarray
    truncated_at: int | None = None  # line of a last row that was cut


def stages_of(
    left: np.ndarray, right: np.ndarray, bumpers: np.ndarray, params: CartParams
) -> tuple[list[Stage], np.ndarray]:
    """Stages of wheels that stood at `left` and `right` ticks (n,), `bumpers` (n,) closed; their last rows (m,).

    Switches count at the end of a stage only in the row in which the first of them closes.
    """
    left, right, bumpers = np.asarray(left, np.int64), np.asarray(right, np.int64), np.asarray(bumpers, np.int64)
    closes = np.flatnonzero((bumpers[1:] > 0) & (bumpers[:-1] == 0)) + 1
    kinds = kinds_of(left, right)
    stages: list[Stage] = []
    ends: list[int] = []
    for low, high in runs_of(kinds, closes, left, right):
        bumper = int(bumpers[high]) if high in closes else 0
        cuts = [*cuts_of(left, right, low, high, params), high]
        for start, end in zip([low, *cuts], cuts, strict=False):
            ways = int(left[end] - left[start]), int(right[end] - right[start])
            stages.append(Stage(kind_of(*ways), *ways, bumper if end == high else 0))
            ends.append(end)
    return stages, np.array(ends, np.int64)


def kind_of(left: int, right: int) -> int:
    """What a stage of such ways is."""
    return TURN if abs(right - left) > abs(left + right) else BACK if left + right < 0 else DRIVE


def kinds_of(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """What the robot does on its way to each row (n,); where it stands, what it did before."""
    window = np.ones(SMOOTHED)
    way, turn = (np.convolve(np.diff(each, prepend=each[:1]), window, "same") for each in (left + right, right - left))
    kinds = np.where(np.abs(turn) > np.abs(way), TURN, np.where(way < 0, BACK, DRIVE))
    moves = np.flatnonzero((way != 0) | (turn != 0))
    if not len(moves):
        return np.full(len(left), DRIVE)
    return kinds[moves[np.clip(np.searchsorted(moves, np.arange(len(left)), "right") - 1, 0, None)]]


def runs_of(kinds: np.ndarray, closes: np.ndarray, left: np.ndarray, right: np.ndarray) -> list[tuple[int, int]]:
    """First and last rows of stretches of one kind that end where it changes or a bumper closes.

    A stretch in which next to nothing moved belongs to the next one, and at the end to none.
    """
    ends = np.union1d(np.flatnonzero(np.diff(kinds)), closes)
    ends = np.union1d(ends, [len(kinds) - 1])
    runs, low = [], 0
    for high in ends[ends > 0].tolist():
        moved = abs(int(left[high] - left[low])) + abs(int(right[high] - right[low]))
        if moved >= LEAST_TICKS or (moved and high in closes):
            runs.append((low, high))
            low = high
    return runs


def cuts_of(left: np.ndarray, right: np.ndarray, low: int, high: int, params: CartParams) -> list[int]:
    """Rows between the first and the last of a stretch at which it has to be cut, for it is no arc of one radius."""
    cuts, start, pose = [], low, np.zeros(3)
    for row in range(low + 1, high + 1):
        stepped = compose(pose, arc(left[row] - left[row - 1], right[row] - right[row - 1], params))
        whole = arc(left[row] - left[start], right[row] - right[start], params)
        if row - 1 > start and np.hypot(*between(whole, stepped)[:2]) > STRAY:
            cuts.append(row - 1)
            start = row - 1
            stepped = arc(left[row] - left[start], right[row] - right[start], params)
        pose = stepped
    return cuts


def cart_messages(stages: Sequence[Stage], times: np.ndarray) -> Iterator[Message]:
    """What a cart that logs these stages tells, each at its time (n,) s: counters, and the stage."""
    left = right = bumps = 0
    yield Cart(float(times[0]) - 1.0 if len(times) else 0.0, 0, 0, NOT_TOLD, 0, 0, "drive", 0, 1, "armed", "none", 0)
    for number, (stage, t) in enumerate(zip(stages, times, strict=True)):
        left, right, bumps = left + stage.left, right + stage.right, bumps + bool(stage.bumper)
        told = (
            wrapped(left),
            wrapped(right),
            NOT_TOLD,
            number + 1,
            bumps,
            "drive",
            stage.bumper,
            1,
            "armed",
            "none",
            0,
        )
        yield Cart(float(t), *told)
        yield CartStage(float(t), 1, number, stage)


def wrapped(ticks: int) -> int:
    """A counter of 16 bits."""
    return (ticks + 32_768) % 65_536 - 32_768
