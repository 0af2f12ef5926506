"""`crunch calibrate odometry`: logs of one robot in, its odometry's noise and bias out, with intervals and as TOML.

Each log is mapped as `crunch replay` would (its sibling `replay`, and `recorded`); where the paths come back to places
already seen, `slam.odometry_noise` learns how badly odometry erred in between.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from server import config
from server.errors import UserError
from server.formats.logs import Log
from server.recorded import open_log
from server.replay import Options, Result, run_log, with_sensors
from server.robots.crunch import CrunchParams
from slam.evaluate import path_length
from slam.loop_measurements import measure_loops, rasters
from slam.motion import MotionParams
from slam.odometry_chain import Chain
from slam.odometry_noise import LEARNED, Learned, Linearised, NothingRevealed, learn, linearise

SHORTEST = 20  # vertices of a log that can come back to anything
NARROW = 4.0  # ratio of an interval's ends up to which a value counts as learned
UNITS = {
    "turn_noise": "rad per root metre", "distance_noise": "m per root metre", "rotation_noise": "rad per rad",
    "turn_bias": "rad/m", "distance": "m per root metre", "turn": "rad per root metre", "rotation": "rad per rad",
}  # fmt: skip
UNLIKE = 8.1  # of log likelihood for noise of its own: by chance in one log of a thousand (chi square of three degrees)
TABLE = "crunch.filter.motion"  # of the settings

Progress = Callable[[float], None]  # takes the share that is done


@dataclass(frozen=True)
class Row:
    """One parameter: what the logs say, its 95 % interval, what the settings have now, and what they should have."""

    name: str
    estimate: float
    low: float
    high: float
    present: float

    @property
    def is_learned(self) -> bool:
        """Whether the logs fix it, to within `NARROW` between the interval's ends."""
        return self.low > 0.0 and self.high < NARROW * self.low

    @property
    def recommended(self) -> float:
        """The estimate where it is learned; else as little away from the present value as the interval permits."""
        return round_off(self.estimate if self.is_learned else min(max(self.present, self.low), self.high))

    @property
    def interval(self) -> str:
        """From where to where, with 95 %."""
        return f"{self.low:.2g} to {self.high:.2g}" if math.isfinite(self.high) else f"{self.low:.2g} or more"

    @property
    def verdict(self) -> str:
        """What the logs say about it, in words."""
        if self.is_learned:
            return "learned"
        if self.low <= self.present <= self.high:
            return "open: stays as it is"
        return "open, but surely less" if self.present > self.high else "open, but surely more"


@dataclass(frozen=True)
class Drive:
    """One log, mapped: its name, metres driven, measurements, and its turn bias (2,) in rad/m with its deviation."""

    name: str
    metres: float
    measurements: int
    bias: np.ndarray

    @property
    def turn_bias(self) -> str:
        """In degrees per metre, with its standard deviation."""
        bias, deviation = np.degrees(self.bias)
        return f"{bias:+.2f} +- {deviation:.2f}" if self.measurements else "-"


@dataclass(frozen=True)
class Calibration:
    """What the logs say about the robot's odometry; `gain` is how much likelier they are than with present values."""

    rows: list[Row]
    drives: list[Drive]
    left_out: int
    gain: float
    warnings: list[str]
    table: str = TABLE  # of the settings

    def toml(self) -> str:
        """A configuration file with what was learned; what was not stands in it as it was."""
        metres = sum(drive.metres for drive in self.drives)
        lines = [
            f"# Learned by `crunch calibrate odometry` from {counted(len(self.drives), 'log')}, {metres:.0f} m.",
            f"[{self.table}]",
        ]
        lines += [
            f"{row.name} = {row.recommended:g}  # {UNITS[row.name]}; {row.verdict} ({row.interval})"
            for row in self.rows
        ]
        return "\n".join(lines) + "\n"


def round_off(value: float) -> float:
    """To three digits: more is never known."""
    return float(f"{value:.3g}")


def counted(n: int, noun: str) -> str:
    """A number of things in words."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


class Measured(NamedTuple):
    """One log, mapped: metres driven, and what its odometry says at the places that were measured."""

    metres: float
    drive: Linearised


def calibrate(paths: Sequence[Path], options: Options, progress: Progress | None = None) -> Calibration:
    """Learn from logs of one robot; UserError where they cannot be read, are of several robots, or tell nothing."""
    told = progress or (lambda share: None)
    check_distinct(paths)
    logs = [open_log(path, options.beams, options.max_range, options.robot or "crunch") for path in paths]
    settings = [settings_of(log, options) for log in logs]
    for log, params in zip(logs[1:], settings[1:], strict=True):
        check_same_robot(logs[0], settings[0], log, params)
    n_parts = len(logs) + 1
    measured = [
        measure(log, params, options, lambda share, part=part: told((part + share) / n_parts))
        for part, (log, params) in enumerate(zip(logs, settings, strict=True))
    ]
    present = settings[0].filter.motion
    drives = [one.drive for one in measured]
    try:
        learned = learn(drives, present, lambda share: told((n_parts - 1 + share) / n_parts))
    except NothingRevealed as error:
        raise UserError(
            f"nothing is learned, the present values stay: {error}; drive the same way twice, and round it again"
        ) from None
    return calibration(logs, [one.metres for one in measured], learned, present)


def calibration(logs: Sequence[Log], metres: Sequence[float], learned: Learned, present: MotionParams) -> Calibration:
    """What was learned, by parameter and by log."""
    rows = [
        Row(name, float(value), float(low), float(high), getattr(present, name))
        for name, value, (low, high) in zip(LEARNED, learned.values, learned.intervals, strict=True)
    ]
    drives = [
        Drive(log.path.name, way, int(n), bias)
        for log, way, n, bias in zip(logs, metres, learned.n_rows, learned.biases, strict=True)
    ]
    warnings = [warning for log in logs for warning in log.warnings]
    for drive, gain in zip(drives, learned.unlike, strict=True):
        if not drive.measurements:
            warnings.append(f"{drive.name}: comes back to nothing, and tells nothing")
        elif gain > UNLIKE:
            warnings.append(f"{drive.name}: errs otherwise than the rest; is it of another robot, or another floor?")
    return Calibration(rows, drives, learned.n_left_out, learned.gain, warnings)


def settings_of(log: Log, options: Options) -> CrunchParams:
    """The robot's parameters for a log, mapped by the path filter whatever they say."""
    robot = options.robot or log.robot or "crunch"
    config.check_robot(robot, ("crunch",), "robots whose odometry is learned")
    settings = getattr(config.load(options.flags, options.file, log.configuration, options.assignments), robot)
    return settings.model_copy(update={"estimator": "filter"})


def check_distinct(paths: Sequence[Path]) -> None:
    """UserError where a log is named twice: counted twice, it would make the intervals too narrow."""
    seen: set[Path] = set()
    for path in paths:
        if path.resolve() in seen:
            raise UserError(f"{path}: is named twice; name each log once")
        seen.add(path.resolve())


def check_same_robot(first: Log, first_params: CrunchParams, log: Log, params: CrunchParams) -> None:
    """UserError where two logs cannot be of one robot: another kind of log, other wheels, or another present noise."""
    pairs = {
        "kind of log": (first.kind, log.kind),
        "robot": (first.robot, log.robot),
        "`crunch.track`": (first_params.track, params.track),
        "`crunch.calibration`": (first_params.calibration, params.calibration),
        f"`{TABLE}`": (first_params.filter.motion, params.filter.motion),
    }
    differing = [name for name, (expected, found) in pairs.items() if expected != found]
    if differing:
        raise UserError(
            f"{log.path}: is not of the robot of {first.path}, or was recorded with other settings: "
            f"{' and '.join(differing)}; calibrate each robot by its own logs"
        )


def measure(log: Log, params: CrunchParams, options: Options, told: Progress) -> Measured:
    """Map one log and measure where it comes back; UserError where it is too short to come back to anything."""
    result = run_log(log, params, options.seed, options.threads or 1, lambda done: told(done / log.n_odometry))
    metres = float(path_length(result.path)[-1])
    if len(result.path) < SHORTEST:
        raise UserError(f"{log.path}: is too short, {metres:.1f} m; give logs that come back to where they were")
    return Measured(metres, linearised(result, with_sensors(params, log).filter_params().reach))


def linearised(result: Result, reach: float) -> Linearised:
    """What odometry says at the places that a mapped log comes back to; its walls are seen within `reach` m."""
    keyframes = result.drive.keyframes
    poses, travelled = zip(*((keyframe.pose, keyframe.travelled) for keyframe in keyframes), strict=True)
    chain = Chain.along(np.array(poses), np.array(travelled))
    return linearise(chain, result.path, measure_loops(result.path, rasters(result.drive.walls, reach)))
