"""Maze Runner's mapper that keeps how long each scan took in the fold, and each vertex in the filter.

Whoever maps live has to be done with a scan before the next comes; what is told of a log as a whole does not show that.
"""

from __future__ import annotations

import time

import numpy as np

from bench.benchmark import Record
from server.mapping import MazeMapper
from server.messages import Effect, Keyframe, Message, Ranges
from server.robots.maze_runner import MazeRunner, MazeRunnerParams


class TimedRunner(MazeRunner):
    """The robot, with the seconds that each scan's step took, and when the scans came."""

    def __init__(self, params: MazeRunnerParams):
        super().__init__(params)
        self.steps: list[float] = []  # s
        self.scanned: list[float] = []  # s, in the log's time

    def step(self, message: Message) -> list[Effect]:
        """Take one message up."""
        if not isinstance(message, Ranges):
            return super().step(message)
        began = time.perf_counter()
        effects = super().step(message)
        self.steps.append(time.perf_counter() - began)
        self.scanned.append(message.t)
        return effects


class TimedMapper(MazeMapper):
    """The mapper, with the seconds that each vertex took in the filter."""

    def __init__(self, params: MazeRunnerParams, seed: int, threads: int):
        super().__init__(params, seed, threads)
        self.robot: TimedRunner = TimedRunner(params)
        self.extends: list[float] = []  # s

    def extend(self, keyframe: Keyframe) -> None:
        """Add a vertex."""
        began = time.perf_counter()
        super().extend(keyframe)
        self.extends.append(time.perf_counter() - began)

    def times_taken(self) -> Record:
        """Milliseconds of steps and vertices: 99th percentile and longest, and the median between two scans."""
        parts = {"step": self.robot.steps, "extend": self.extends}
        return {"interval_ms": 1e3 * float(np.median(np.diff(self.robot.scanned)))} | {
            f"{part}_{name}_ms": 1e3 * float(np.quantile(seconds, quantile))
            for part, seconds in parts.items()
            for name, quantile in (("p99", 0.99), ("worst", 1.0))
        }
