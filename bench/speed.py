"""How fast a replay is and where its time goes: semi-real Intel on one thread, with 2,000 particles and as it comes.

Start-up is what passes from a new process to the moment at which every kernel is loaded; it is told apart. The parts
are measured in a run of their own, whose clock readings would slow the timed one; they are processor time, so that
other work on the machine does little to them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from bench.benchmark import Bench, Column, Crew, Record, Row, figures, middle, plain, runs
from bench.recordings import read, semireal
from bench.scores import PARTICLES, params_of
from server.messages import Effect, Keyframe, Ranges
from server.replay import fold, run_log, warm_up
from server.robots.crunch import Crunch, CrunchParams, make_estimator

CASES = {
    "default": lambda: params_of(filter={"particles": PARTICLES}),
    "thesis": lambda: params_of("thesis", {"particles": PARTICLES}),
    "default, all its particles": params_of,
}
REPEATS = 3  # of which the fastest counts: other work on the machine only slows it


class Timed(Crunch):
    """The robot with a clock around what takes long."""

    def __init__(self, params: CrunchParams):
        super().__init__(params)
        self.fusion = self.walls = 0.0

    def look(self, message: Ranges) -> list[Effect]:
        """Fuse a sweep."""
        before = time.thread_time()
        effects = super().look(message)
        self.fusion += time.thread_time() - before
        return effects

    def observe(self) -> Keyframe:
        """Take a vertex's walls."""
        before = time.thread_time()
        keyframe = super().observe()
        self.walls += time.thread_time() - before
        return keyframe


def run(case: str, seed: int, started: float) -> Record:
    """One drive in a process that was started at `started` (s since 1970)."""
    params = CASES[case]()
    warm_up(params, 1)
    startup = time.time() - started
    log = read(semireal("intel", seed))[0]
    busy = time.process_time()
    results = [run_log(log, params, seed) for _ in range(REPEATS)]
    busy = (time.process_time() - busy) / REPEATS  # with loading what is loaded already, which is little
    fastest = min((result.seconds for result in results), key=lambda seconds: seconds["total"])
    duration = float(np.ptp(results[0].drive.times))
    return {
        "seed": seed,
        "startup": startup,
        "speed": duration / fastest["total"],
        "processor_speed": duration / busy,
        "duration": duration,
        "vertices": len(results[0].path),
        "restarts": results[0].verdict.restarts,
        "total": fastest["total"],
        **parts(log, params, seed),
    }


def parts(log, params: CrunchParams, seed: int) -> Record:
    """Processor seconds of decoding, fusion, walls, what else the fold does, the filter, and the refinement.

    Restarts are not in them; that there were none is told.
    """
    before = time.thread_time()
    for _ in log.messages(params.calibration):
        pass
    decoding = time.thread_time() - before
    robot, path_filter, filtering = Timed(params), make_estimator(params, seed, 1), 0.0

    def extend(keyframe: Keyframe) -> None:
        nonlocal filtering
        started = time.thread_time()
        path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
        filtering += time.thread_time() - started

    before = time.thread_time()
    fold(log, robot, extend)
    folded = time.thread_time()
    path_filter.refine()
    return {
        "decoding": decoding,
        "fusion": robot.fusion,
        "walls": robot.walls,
        "rest": folded - before - filtering - decoding - robot.fusion - robot.walls,
        "filter": filtering,
        "refinement": time.thread_time() - folded,
    }


def rows(crew: Crew) -> Iterator[Row]:
    """One for each case; every run in a process of its own."""
    for case in CASES:
        if crew.wants(case):
            yield Row(case, [crew.alone(run, case, seed, time.time()) for seed in range(crew.seeds)])


BENCH = Bench(
    name="speed",
    about="replay of semi-real Intel, 2,000 particles and all, one core: times real time, and where the time goes",
    rows=rows,
    columns=(
        Column("runs", runs),
        Column("x real time, median / least", figures("speed", 0, 0.5, 0.0)),
        Column("by processor time", middle("processor_speed", 0)),
        Column("total (s)", middle("total")),
        Column("decoding (s)", middle("decoding")),
        Column("fusion (s)", middle("fusion")),
        Column("walls (s)", middle("walls")),
        Column("rest of the fold (s)", middle("rest")),
        Column("filter (s)", middle("filter")),
        Column("refinement at the end (s)", middle("refinement")),
        Column("restarts", plain("restarts")),
        Column("start-up, not counted (s)", middle("startup", 1)),
        Column("drive (s)", middle("duration", 0)),
    ),
    seeds=5,
    minutes=4,
    needs_data=True,
    is_timed=True,
    heading="preset",
)
