"""What a benchmark is: a function that yields rows of a table, each made of one record per run, and how it is told.

A benchmark lives in a module of its own as a `Bench`; `bench.catalogue` lists them all. Most are `each(run, cases)`:
`run(case, seed)` gives the record of one run and stands at the top level of its module, for it goes to other processes.
"""

from __future__ import annotations

import math
import re
import signal
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np

Record = dict[str, Any]  # what one run found, by name; plain numbers, texts and lists of them

DEVIATIONS = 1.96  # of a 95 % interval


class Row(NamedTuple):
    """One line of the table: what it is about, and what each run found."""

    name: str
    records: list[Record]


class Column(NamedTuple):
    """A heading, and the text under it for a row."""

    title: str
    text: Callable[[Row], str]


class Bench(NamedTuple):
    """A named benchmark. `rows(crew)` yields them; `minutes` is its rough duration on two cores with its own seeds."""

    name: str
    about: str  # one line
    rows: Callable[[Crew], Iterable[Row]]
    columns: Sequence[Column]
    seeds: int = 1
    minutes: float = 1.0
    quick: int = 0  # seeds in the quick set that `crunch bench` runs alone; 0: not part of it
    needs_data: bool = False  # recordings of other people's robots
    is_timed: bool = False  # runs go one at a time, whatever the number of jobs
    heading: str = "run"
    notes: Callable[[list[Row]], Iterable[str]] | None = None  # lines below the table
    verdict: Callable[[list[Row]], Iterable[str]] | None = (
        None  # a sentence for all that must not be; none if all is well
    )


def each(run: Callable[[Any, int], Record], cases: Mapping[str, Any]) -> Callable[[Crew], Iterator[Row]]:
    """Rows of a benchmark that runs every case with every seed."""

    def rows(crew: Crew) -> Iterator[Row]:
        for name, case in cases.items():
            if crew.wants(name, cases):
                yield Row(name, crew.map(run, [(case, seed) for seed in range(crew.seeds)], name))

    return rows


class Crew:
    """Who does the runs: processes that live as long as the block, and a bar that tells how far they are.

    Only rows whose names have `only` in them as whole words are wanted.
    """

    def __init__(self, seeds: int, jobs: int = 1, only: str = ""):
        self.seeds = seeds
        self.jobs = jobs
        self.only = only
        self.pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *_: object) -> None:
        if self.pool is not None:
            self.pool.shutdown(cancel_futures=True)
            self.pool = None

    def wants(self, name: str, names: Collection[str] = ()) -> bool:
        """Whether a row of this name is to be made; of `names`, the one that is asked for in full alone."""
        if self.only in names:
            return name == self.only
        return not self.only or re.search(rf"(?<!\w){re.escape(self.only)}(?!\w)", name) is not None

    def map(self, run: Callable[..., Any], jobs: Sequence[tuple[Any, ...]], title: str) -> list[Any]:
        """run(*job) of every job, in their order."""
        if self.pool is None:
            self.pool = ProcessPoolExecutor(self.jobs, initializer=end_when_interrupted)
        return list(watched(self.pool.map(run, *zip(*jobs, strict=True)), title, len(jobs)))

    def alone(self, run: Callable[..., Any], *job: Any) -> Any:
        """run(*job) in a fresh process of its own, so that its peak memory is its own."""
        with ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=end_when_interrupted) as pool:
            return pool.submit(run, *job).result()


def end_when_interrupted() -> None:
    """Ctrl-C ends a process that works at once and silently; the one that waits for it tells."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def watched(results: Iterable[Any], title: str, total: int) -> Iterable[Any]:
    """The results as they come, with a bar on standard error where somebody looks."""
    if not sys.stderr.isatty():
        return results
    from rich.console import Console
    from rich.progress import track

    return track(results, title, total, console=Console(stderr=True), transient=True)


# What stands in a column: each takes the name of a value in the records and gives the text of a row.


def values_of(row: Row, key: str) -> list[Any]:
    """What the row's runs have under a name; runs without it are left out."""
    return [record[key] for record in row.records if record.get(key) is not None]


def figures(key: str, digits: int, *quantiles: float) -> Callable[[Row], str]:
    """Quantiles over the runs; how many of them have a number is told where not all do."""

    def text(row: Row) -> str:
        numbers = np.array(values_of(row, key), float)
        numbers = numbers[np.isfinite(numbers)]
        if numbers.size == 0:
            return "-"
        left_out = f" ({numbers.size} of {len(row.records)})" if numbers.size < len(row.records) else ""
        return " / ".join(f"{figure:,.{digits}f}" for figure in np.quantile(numbers, quantiles)) + left_out

    return text


def middle(key: str, digits: int = 2) -> Callable[[Row], str]:
    """The median."""
    return figures(key, digits, 0.5)


def tails(key: str, digits: int = 2) -> Callable[[Row], str]:
    """Median / 90th percentile / worst."""
    return figures(key, digits, 0.5, 0.9, 1.0)


def share(key: str) -> Callable[[Row], str]:
    """How many runs it is true of, in per cent with its 95 % interval."""

    def text(row: Row) -> str:
        values = values_of(row, key)
        if not values:
            return "-"
        low, high = wilson(sum(map(bool, values)), len(values))
        return f"{100.0 * sum(map(bool, values)) / len(values):.0f} % ({100.0 * low:.0f} to {100.0 * high:.0f})"

    return text


def wilson(successes: int, n: int) -> tuple[float, float]:
    """95 % interval of the probability that n runs with so many successes show (Wilson 1927)."""
    part, square = successes / n, DEVIATIONS**2
    centre = part + square / (2 * n)
    half = DEVIATIONS * math.sqrt(part * (1 - part) / n + square / (4 * n * n))
    return max(0.0, (centre - half) / (1 + square / n)), min(1.0, (centre + half) / (1 + square / n))


def failed(key: str) -> Callable[[Row], str]:
    """The seeds of the runs that it is not true of."""

    def text(row: Row) -> str:
        seeds = [str(record["seed"]) for record in row.records if record.get(key) is not None and not record[key]]
        return ", ".join(seeds) or "none"

    return text


def runs(row: Row) -> str:
    """How many there were."""
    return str(len(row.records))


def plain(key: str) -> Callable[[Row], str]:
    """The values themselves, of which such a row has one as a rule."""
    return lambda row: ", ".join(dict.fromkeys(map(str, values_of(row, key)))) or "-"
