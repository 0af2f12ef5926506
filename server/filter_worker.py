"""The other side of the pipe: a process that holds a path filter and answers one batch of keyframes at a time.

It beats a counter that the parent watches, ignores Ctrl-C and SIGTERM (the parent decides when to leave) and leaves
when the parent is gone. It knows nothing of robots, links and clocks.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from server.messages import Estimate, Keyframe
from slam.refined_filter import RefinedFilter
from slam.refined_grid_filter import RefinedGridFilter
from slam.uncertainty import Uncertainty

IDLE_BEAT = 0.2  # s between two beats of a worker without work
BRANCHES = 64  # particles whose ways through the tree are shown
REFINED = (RefinedFilter, RefinedGridFilter)  # estimators whose paths are refined where there is time for it


class PathFilterLike(Protocol):
    """What an estimator of paths can do; `slam.path_filter.PathFilter` is one."""

    @property
    def n_particles(self) -> int:
        """How many particles there are now."""
        ...

    def extend(self, pose: np.ndarray, seen: Any, travelled: float, /) -> None:
        """Add a vertex: pose (3,) in the odometry frame, what was seen there, m of path since the last one."""
        ...

    def estimate(self, max_particles: int = 500) -> Any:
        """The best path and the particles' spread, as a `slam.path_filter.PathEstimate`."""
        ...

    def uncertainty(self, n_leaves: int) -> Uncertainty:
        """How certain each vertex is, and the tree's branches under about `n_leaves` particles."""
        ...

    def resize(self, n_particles: int) -> None:
        """Go on with another number of particles."""
        ...


FilterFactory = Callable[[], PathFilterLike]


class Batch(NamedTuple):
    """Keyframes that go over together, and how many particles to compute them with; without any the path is refined."""

    keyframes: Sequence[Keyframe]
    n_particles: int
    is_quick: bool  # whether refining must not take long


class Answer(NamedTuple):
    """The estimate after a batch, the seconds that it took, and whether refining would better its path.

    `is_due` says that a quick refinement pays.
    """

    estimate: Estimate
    seconds: float
    is_rough: bool
    is_due: bool


def estimate_of(path_filter: PathFilterLike, t: float, shown: int) -> Estimate:
    """The filter's present estimate as a message with time `t` and at most `shown` particles."""
    now = path_filter.estimate(shown)
    certainty = path_filter.uncertainty(BRANCHES)
    return Estimate(
        t=t,
        path=now.path,
        profile=now.profile,
        particles=now.particles,
        fixed_depth=int(now.fixed_depth),
        n_particles=int(now.n_particles),
        effective_particles=float(now.effective_particles),
        resamplings=int(now.resamplings),
        affinity=float(now.affinity),
        plausibility=float(now.plausibility),
        spread=certainty.spread,
        revisit_spread=certainty.revisit_spread,
        branches=certainty.branches,
        belief=now.belief,
        walls=now.walls,
    )


def serve(connection: Any, beats: Any, factory: FilterFactory, shown: int) -> None:
    """Answer batches until the parent closes the pipe or dies. Runs as the worker process's main function."""
    for number in (signal.SIGINT, signal.SIGTERM):  # a whole process group may be told
        signal.signal(number, signal.SIG_IGN)
    parent = os.getppid()
    path_filter = factory()
    if isinstance(path_filter, REFINED):
        path_filter.prepare()
    n_particles, t = 0, 0.0
    try:
        connection.send("ready")
        while os.getppid() == parent:
            beats.value += 1
            if not connection.poll(IDLE_BEAT):
                continue
            batch: Batch = connection.recv()
            if batch.n_particles != n_particles:
                n_particles = batch.n_particles
                path_filter.resize(n_particles)
            if batch.keyframes:
                t = batch.keyframes[-1].t
            connection.send(_work(path_filter, batch, t, beats, shown))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


def _work(path_filter: PathFilterLike, batch: Batch, t: float, beats: Any, shown: int) -> Answer:
    """Extend the filter by a batch, or refine its path where there is none; `t` is the newest keyframe's."""
    started = time.perf_counter()
    for keyframe in batch.keyframes:
        path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
        beats.value += 1
    is_rough = is_due = False
    if isinstance(path_filter, REFINED):
        if not batch.keyframes:
            path_filter.refine(batch.is_quick, lambda: beat(beats))
        is_rough, is_due = path_filter.is_rough, path_filter.is_due
    estimate = estimate_of(path_filter, t, shown)
    return Answer(estimate, time.perf_counter() - started, is_rough, is_due)


def beat(beats: Any) -> None:
    """Show the parent that work goes on."""
    beats.value += 1
