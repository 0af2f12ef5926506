"""A 250 m drive through real floor plans (the length of the thesis's Figure 6) with drift medium."""

from __future__ import annotations

from bench.benchmark import Bench, Record, each
from bench.recordings import floor, read
from bench.scores import COLUMNS, PARTICLES_OFFLINE, against, beside_thesis, oracle_of


def run(name: str, seed: int) -> Record:
    """One tour through a floor plan."""
    log, times, truth = read(floor(name, seed, "medium"))
    return beside_thesis(log, against(times, truth), seed, PARTICLES_OFFLINE, oracle_of(times, truth, seed))


BENCH = Bench(
    name="floor",
    about="250 m through real floor plans, drift medium; a seed is a tour",
    rows=each(run, {"freiburg": "freiburg", "longwood": "longwood"}),
    columns=COLUMNS,
    seeds=10,
    minutes=10,
    needs_data=True,
    heading="floor",
)
