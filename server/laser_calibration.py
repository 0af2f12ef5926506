"""`crunch calibrate odometry --robot maze_runner`: how badly the odometry errs that a laser betters.

Each log is gone through as `crunch replay` would (its sibling `replay`); from vertex to vertex the laser tells how the
robot truly moved. Uses its siblings `mapping`, `odometry_calibration`, for tables and checks, and `recorded`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from server import config
from server.errors import UserError
from server.mapping import mapper_of, with_sensors
from server.odometry_calibration import Calibration, Drive, Row, check_distinct
from server.recorded import open_log
from server.replay import Options, fold
from slam.evaluate import path_length
from slam.motion_noise import LEARNED, learn_noise
from slam.pose import between

TABLE = "maze_runner.odometry.motion.odometry"  # of the settings
NAME = "maze_runner"

Progress = Callable[[float], None]  # takes the share that is done


def calibrate(paths: Sequence[Path], options: Options, progress: Progress | None = None) -> Calibration:
    """Learn from logs of one robot; UserError where they cannot be read, or tell nothing."""
    check_distinct(paths)
    logs = [open_log(path, options.beams, options.max_range, NAME) for path in paths]
    told, true, metres = [], [], []
    present = None
    for part, log in enumerate(logs):
        params = config.load(options.flags, options.file, log.configuration, options.assignments).maze_runner
        noise = params.odometry.motion.odometry
        present = np.array([getattr(noise, name) for name in LEARNED])
        mapper = mapper_of(with_sensors(params, log))
        drive = fold(log, mapper.robot, lambda keyframe: None)
        poses = np.array([keyframe.pose for keyframe in drive.keyframes])
        stood = np.array(mapper.robot.told)
        told.append(between(stood[:-1], stood[1:]))
        true.append(between(poses[:-1], poses[1:]))
        metres.append(float(path_length(poses)[-1]))
        if progress:
            progress((part + 1) / len(logs))
    assert present is not None
    try:
        found = learn_noise(np.concatenate(told), np.concatenate(true), present)
    except ValueError as error:
        raise UserError(f"nothing is learned, the present values stay: {error}; drive farther") from None
    rows = [
        Row(name, float(value), float(low), float(high), float(was))
        for name, value, (low, high), was in zip(LEARNED, found.values, found.intervals, present, strict=True)
    ]
    drives = [
        Drive(log.path.name, way, len(steps), veer_of(steps, truly))
        for log, way, steps, truly in zip(logs, metres, told, true, strict=True)
    ]
    warnings = [warning for log in logs for warning in log.warnings]
    warnings.append(
        f"on the whole true ways are {found.way_scale:.3f} of what the odometry tells, turns {found.turn_scale:.3f}, "
        f"and it veers by {np.degrees(found.veer):+.2f} degrees a metre; trials of the motors would mend that"
    )
    return Calibration(rows, drives, 0, found.gain, warnings, TABLE)


def veer_of(told: np.ndarray, true: np.ndarray) -> np.ndarray:
    """(2,) rad/m by which motions (n, 3) veer from what was told, and its standard deviation."""
    ways = np.hypot(told[:, 0], told[:, 1])
    off = np.arctan2(np.sin(true[:, 2] - told[:, 2]), np.cos(true[:, 2] - told[:, 2]))
    veer = float(off @ ways / np.maximum(ways @ ways, 1e-9))
    left = off - veer * ways
    return np.array([veer, float(np.sqrt(left @ left / max(1, len(left) - 1) / np.maximum(ways @ ways, 1e-9)))])
