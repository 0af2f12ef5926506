"""The thesis's own claims, measured: a module for each, of which `measure` gives rows and `draw` a picture.

As a benchmark each claim is a row, and the tables of `docs/claims.md` stand below.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from bench.benchmark import Bench, Column, Crew, Record, Row, middle
from bench.claims import blur, crossing, points, resampling, search
from bench.claims.findings import Effort, Findings, markdown
from bench.claims.plots import Draw

CLAIMS: dict[str, tuple[Callable[[Effort], Findings], Draw]] = {
    "blur": (blur.measure, blur.draw),
    "crossing": (crossing.measure, crossing.draw),
    "points": (points.measure, points.draw),
    "search": (search.measure, search.draw),
    "resampling": (resampling.measure, resampling.draw),
}


def run(name: str, seeds: int) -> Record:
    """Everything measured for a claim, and the processor time (s) that it took."""
    started = time.process_time()
    findings = CLAIMS[name][0](Effort(seeds=seeds))
    return {**findings._asdict(), "seconds": time.process_time() - started}


def tables(rows: list[Row]) -> Iterator[str]:
    """The tables of the page."""
    for row in rows:
        for record in row.records:
            for title, table in record["tables"].items():
                yield f"{title}\n\n{markdown(table)}\n"


def one_after_the_other(crew: Crew) -> Iterator[Row]:
    """A row for each claim; seeds are inside of it."""
    for name in CLAIMS:
        if crew.wants(name):
            yield Row(name, crew.map(run, [(name, crew.seeds)], name))


BENCH = Bench(
    name="claims",
    about="the thesis's own claims, measured: docs/claims.md",
    rows=one_after_the_other,
    columns=(Column("processor time (s)", middle("seconds", 0)),),
    seeds=20,
    minutes=12,
    is_timed=True,
    heading="claim",
    notes=tables,
)
