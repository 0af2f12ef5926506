"""A Crunch whose motion is somebody else's: real odometry turned into wheel ticks, its sensors simulated at true poses.

It speaks the same bytes at the same rates as the balancing one, stands upright all the time and obeys nobody.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from firmware.virtual.host import HostCrunch
from firmware.virtual.on_air import STEP_MS
from firmware.virtual.radio import Radio
from firmware.virtual.worlds import World

TRACK = 0.19  # m, as BODY_TRACK
MAX_SPEED = 1.5  # m/s of anybody's indoor robot
TURN_SHARE = 0.2  # m per rad
TIME_SHARE = 0.1  # m per s
STRAIGHT = 1e-6  # rad of turn below which an arc is a line


def wrap(angles: np.ndarray) -> np.ndarray:
    """Angles in (-pi, pi]."""
    return np.pi - np.mod(np.pi - angles, 2.0 * np.pi)


def ordered(times: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows in file order with times that rise strictly, and no faster motion than a robot's; of equal times the last.

    Clocks of logs stammer and step back. Each row is put half-way between the earliest time at which the robot can have
    come there after all rows before it, and the latest from which it can still reach all rows after it.
    """
    times, poses = np.asarray(times, float), np.asarray(poses, float)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T) + TURN_SHARE * np.abs(wrap(np.diff(poses[:, 2])))
    needed = np.concatenate([[0.0], np.cumsum(steps / MAX_SPEED)])
    slack = times - needed
    times = 0.5 * (np.maximum.accumulate(slack) + np.minimum.accumulate(slack[::-1])[::-1]) + needed
    is_last = np.append(np.diff(times) > 1e-6, True)
    return times[is_last], poses[is_last]


def arcs(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed arc length and turn (n-1,) between successive poses (n, 3); sideways motion is lost: wheels have none."""
    step = np.diff(poses[:, :2], axis=0)
    turn = wrap(np.diff(poses[:, 2]))
    middle = poses[:-1, 2] + 0.5 * turn
    chord = np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1]
    half = np.where(np.abs(turn) > STRAIGHT, 0.5 * turn, 0.5)
    return np.where(np.abs(turn) > STRAIGHT, chord * half / np.sin(half), chord), turn


def along_arcs(poses: np.ndarray, lengths: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Poses (n, 3) after driving an arc from each of `poses`."""
    half = np.where(np.abs(turns) > STRAIGHT, 0.5 * turns, 0.5)
    chord = lengths * np.where(np.abs(turns) > STRAIGHT, np.sin(half) / half, 1.0)
    middle = poses[:, 2] + 0.5 * turns
    return np.column_stack(
        [poses[:, 0] + chord * np.cos(middle), poses[:, 1] + chord * np.sin(middle), poses[:, 2] + turns]
    )


def at_times(times: np.ndarray, poses: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Poses (m, 3) at times between those of poses (n, 3): along the arc of each step, headings continuous."""
    lengths, turns = arcs(poses)
    poses = np.column_stack([poses[:, :2], poses[0, 2] + np.concatenate([[0.0], np.cumsum(turns)])])
    aside = poses[1:] - along_arcs(poses[:-1], lengths, turns)  # what is no arc, spread evenly
    row = np.clip(np.searchsorted(times, wanted, side="right") - 1, 0, len(times) - 2)
    part = np.clip((wanted - times[row]) / (times[row + 1] - times[row]), 0.0, 1.0)
    return along_arcs(poses[row], part * lengths[row], part * turns[row]) + part[:, None] * aside[row]


def carried(reference: np.ndarray, anchor: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Poses (m, 3) moved rigidly so that `anchor` (m, 3), of the same frame, comes to `reference` (m, 3)."""
    turn = reference[:, 2] - anchor[:, 2]
    cos, sin = np.cos(turn), np.sin(turn)
    dx, dy = poses[:, 0] - anchor[:, 0], poses[:, 1] - anchor[:, 1]
    x = reference[:, 0] + cos * dx - sin * dy
    y = reference[:, 1] + sin * dx + cos * dy
    return np.column_stack([x, y, reference[:, 2] + poses[:, 2] - anchor[:, 2]])


def progress_of(times: np.ndarray, odometry: np.ndarray) -> np.ndarray:
    """What a correction is spread along (n,): distance, with a little of turning and of time for when it stands."""
    steps = np.hypot(*np.diff(odometry[:, :2], axis=0).T) + TURN_SHARE * np.abs(np.diff(odometry[:, 2]))
    return np.concatenate([[0.0], np.cumsum(steps)]) + TIME_SHARE * times


def filled_in(times: np.ndarray, references: np.ndarray, wanted: np.ndarray, odometry: np.ndarray) -> np.ndarray:
    """Poses (m, 3) at `wanted` between sparse references (n, 3): odometry's shape, the correction spread along it.

    `odometry` (m, 3) stands at the wanted times, headings continuous; so do the result's.
    """
    nodes = np.searchsorted(wanted, times).clip(0, len(wanted) - 1)
    anchors = odometry[nodes]
    row = np.clip(np.searchsorted(times, wanted, side="right") - 1, 0, len(times) - 2)
    progress = progress_of(wanted, odometry)
    share = (progress - progress[nodes[row]]) / np.maximum(progress[nodes[row + 1]] - progress[nodes[row]], 1e-9)
    share = np.clip(share, 0.0, 1.0)
    forward = carried(references[row], anchors[row], odometry)
    backward = carried(references[row + 1], anchors[row + 1], odometry)
    heading = forward[:, 2] + share * wrap(backward[:, 2] - forward[:, 2])
    position = forward[:, :2] + share[:, None] * (backward[:, :2] - forward[:, :2])
    return np.column_stack([position, np.unwrap(heading)])


class ScriptedCrunch(HostCrunch):
    """Crunch's senses on a given drive: `true_poses` (n, 3) at `times` (n,), sparse; `odometry_poses` (m, 3) at theirs.

    Time runs from the later of the two starts to the earlier of the two ends; `start_time` is that start on the log's
    clock, `duration` the seconds after which it is `finished`.
    """

    def __init__(
        self,
        world: World,
        times: np.ndarray,
        true_poses: np.ndarray,
        odometry_times: np.ndarray,
        odometry_poses: np.ndarray,
        seed: int = 0,
        radio: Radio | None = None,
    ):
        times, true_poses = ordered(times, true_poses)
        odometry_times, odometry_poses = ordered(odometry_times, odometry_poses)
        if len(times) < 2 or len(odometry_times) < 2:
            raise ValueError("a scripted robot needs at least two true poses and two rows of odometry")
        self.start_time = float(max(times[0], odometry_times[0]))
        self.duration = float(min(times[-1], odometry_times[-1])) - self.start_time
        if self.duration <= 0.0:
            raise ValueError("true poses and odometry do not overlap in time; are both on the log's clock?")
        grid = self.start_time + np.arange(0.0, self.duration + 1e-9, STEP_MS * 1e-3)
        odometry = at_times(odometry_times, odometry_poses, grid)
        self.script_poses = np.ascontiguousarray(filled_in(times, true_poses, grid, odometry))
        self.script_rolled = rolled_by(odometry)
        super().__init__(world, self.script_poses[0], seed, radio=radio)
        pointers: list[Any] = [
            self.ffi.cast("double *", array.ctypes.data) for array in (self.script_rolled, self.script_poses)
        ]
        self.lib.robot_script(self.robot, *pointers, len(grid))

    @property
    def finished(self) -> bool:
        """True when the given drive has been played to its end."""
        return self.time >= self.duration


def rolled_by(odometry: np.ndarray) -> np.ndarray:
    """Metres (n, 2) that left and right wheel have rolled along poses (n, 3): distance -+ turn x track / 2."""
    lengths, turns = arcs(odometry)
    rolled = np.zeros((len(odometry), 2))
    rolled[1:, 0] = np.cumsum(lengths - 0.5 * TRACK * turns)
    rolled[1:, 1] = np.cumsum(lengths + 0.5 * TRACK * turns)
    return np.ascontiguousarray(rolled)
