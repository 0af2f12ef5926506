"""Does the interval of a learned noise hold the true one as often as it says? Drives whose wheels slip as is known.

The virtual robot's wheels err per root metre as the parameters have it, so that the truth stands in its table of
drifts. Each drive is mapped as `crunch calibrate odometry` would, and calibrated alone; then all drives of a drift
together. *Twice the fall* is how much less likely the truth is than the best value: if the likelihood were
exact, 95 % of the drives would be within 3.84, its mean 1 and its median 0.45.

Only two sizes are compared: the virtual robot's other errors, shares of the way and of the turns that stay the same for
a whole drive, are not what the parameters of the same kind stand for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from bench.benchmark import Bench, Column, Crew, Record, Row, figures, middle, runs, share
from bench.recordings import cycle, read
from bench.scores import PARTICLES, params_of
from firmware.virtual import DRIFTS
from server.odometry_calibration import linearised
from server.replay import run_log
from slam.motion import MotionParams
from slam.odometry_noise import LEARNED, Linearised, NothingRevealed, fit, learn
from slam.variance_components import CHI_SQUARE

LEVELS = ("low", "medium", "high")
COMPARED = {"turn_noise": 1, "distance_noise": 0}  # and which column of `DRIFTS` is the truth


def run(drift: str, seed: int) -> Linearised:
    """What the odometry of one drive says where its map comes back to a place."""
    log, _, _ = read(cycle(seed, drift))
    params = params_of(filter={"particles": PARTICLES})
    return linearised(run_log(log, params, seed), params.filter_params().reach)


def judged(drift: str, seed: int, drives: Sequence[Linearised]) -> dict[str, Record]:
    """What is learned from drives of one drift, as multiples of the truth: a record for each size."""
    present = MotionParams()
    try:
        learned, found = learn(drives, present), fit(drives, present)
    except NothingRevealed:
        return {name: {"seed": seed} for name in COMPARED}
    records = {}
    for name, column in COMPARED.items():
        which, truth = LEARNED.index(name), DRIFTS[drift][column]
        low, high = learned.intervals[which] / truth
        fall = 2.0 * found.fall([truth], [which])
        records[name] = {
            "seed": seed,
            "truth": truth,
            "estimate": float(learned.values[which]) / truth,
            "low": float(low),
            "high": float(high),
            "held": bool(low <= 1.0 <= high),
            "fall": fall,
            "plain": fall <= CHI_SQUARE,
            "measured": int(learned.n_rows.sum()),
        }
    return records


def rows(crew: Crew) -> Iterator[Row]:
    """Two for each drift and size: of each drive alone, and of all together."""
    for drift in LEVELS:
        if crew.wants(drift):
            drives = crew.map(run, [(drift, seed) for seed in range(crew.seeds)], drift)
            alone = crew.map(judged, [(drift, seed, [drive]) for seed, drive in enumerate(drives)], drift)
            together = crew.alone(judged, drift, 0, drives)
            for name in COMPARED:
                yield Row(f"{drift}, {name}, each drive", [records[name] for records in alone])
                yield Row(f"{drift}, {name}, all drives together", [together[name]])


def spread(key: str) -> Callable[[Row], str]:
    """10th percentile / median / 90th percentile."""
    return figures(key, 2, 0.1, 0.5, 0.9)


BENCH = Bench(
    name="odometry",
    about="do the intervals of learned odometry noise hold the truth? drives alone and together, 2,000 particles",
    rows=rows,
    columns=(
        Column("calibrations", runs),
        Column("truth", middle("truth", 4)),
        Column("estimate / truth (p10, median, p90)", spread("estimate")),
        Column("interval from, median", middle("low")),
        Column("to", middle("high")),
        Column("holds the truth (95 %)", share("held")),
        Column("twice the fall (p10, median, p90)", spread("fall")),
        Column("within 3.84", share("plain")),
        Column("measurements", middle("measured", 0)),
    ),
    seeds=24,
    minutes=8,
    heading="drift, size, of",
)
