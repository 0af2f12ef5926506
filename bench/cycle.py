"""Two laps of a 50 m corridor cycle (the shape of the thesis's Figure 5): levels of drift, widths, the way back.

Worlds are `corridor_cycle(seed)`; without a width of their own the corridors are 1.5, 1.8, 2.1 and 2.4 m wide in turn.
A run's speed includes decoding, fusion and the filter on one thread.
"""

from __future__ import annotations

from typing import NamedTuple

from bench.benchmark import Bench, Record, each
from bench.recordings import cycle, read
from bench.scores import COLUMNS, against, beside_thesis, oracle_of


class Cycle(NamedTuple):
    """One kind of drive."""

    drift: str
    width: float | None = None  # m
    is_reversed: bool = False  # in the second lap


CASES = {
    **{drift: Cycle(drift) for drift in ("low", "medium", "high")},
    **{f"{drift}, second lap reversed": Cycle(drift, is_reversed=True) for drift in ("low", "medium", "high")},
    **{f"{drift}, {width} m wide": Cycle(drift, width) for width in (1.8, 2.4, 3.0) for drift in ("medium", "high")},
}


def run(case: Cycle, seed: int) -> Record:
    """One seed of a kind of drive."""
    log, times, truth = read(cycle(seed, *case))
    return beside_thesis(log, against(times, truth), seed, oracle=oracle_of(times, truth, seed))


BENCH = Bench(
    name="cycle",
    about="two laps of a 50 m corridor cycle: drift, second lap reversed, corridor widths",
    rows=each(run, CASES),
    columns=COLUMNS,
    seeds=100,
    minutes=90,
    quick=4,
    heading="drift",
)
