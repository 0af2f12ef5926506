"""What `crunch bench` does: find the benchmarks by name, run them one after the other, print and keep their tables."""

from __future__ import annotations

import difflib
import time
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

from bench.benchmark import Bench, Crew
from bench.catalogue import CATALOGUE, SETS
from bench.machine import commit, machine
from bench.recordings import CACHE, data_folder
from bench.result import Result, ResultRow, Results, show_table
from server.errors import UserError


def show_list() -> None:
    """Print each benchmark's name, its line, and what it takes; then the names of several."""
    rows = [
        [bench.name, bench.about, str(bench.seeds), f"{bench.minutes:g}", "recordings" if bench.needs_data else ""]
        for bench in CATALOGUE
    ]
    show_table(["benchmark", "what it measures", "seeds", "minutes", "needs"], rows)
    for name, benches in SETS.items():
        minutes = sum(bench.minutes for bench in benches)
        print(f"\n{name}: {', '.join(bench.name for bench in benches)}; {minutes:g} minutes")


def chosen(names: Sequence[str]) -> list[Bench]:
    """The benchmarks of these names, each once; UserError for a name that neither one nor a set has."""
    by_name = {bench.name: (bench,) for bench in CATALOGUE} | SETS
    for name in names:
        if name not in by_name:
            near = difflib.get_close_matches(name, by_name, 3, 0.7)
            hint = (
                f"did you mean {' or '.join(f'`{other}`' for other in near)}?"
                if near
                else f"choose {', '.join(by_name)}"
            )
            raise UserError(f"`{name}` is no benchmark; {hint}")
    found = {bench.name: bench for name in names for bench in by_name[name]}
    return list(found.values())


def run_all(names: Sequence[str], seeds: int | None, jobs: int, only: str, output: Path | None) -> bool:
    """Run the named benchmarks, or a quick set with few seeds, and write their results as JSON.

    False if one of them found what must not be.
    """
    together = Results(results={})
    is_well = True
    for bench in chosen(names) if names else [bench for bench in CATALOGUE if bench.quick]:
        if bench.needs_data and data_folder() is None:
            print(f"\n{bench.name}: skipped: it needs other people's recordings; set CRUNCH_DATA to their folder")
            continue
        path = output or CACHE / f"{bench.name}.json"
        kept = together if output else Results(results={})
        n_seeds = seeds or (bench.seeds if names else bench.quick)
        for result in run(bench, n_seeds, jobs, only):
            kept.results[bench.name] = result
            kept.write(path)
        kept.results[bench.name].show()
        print(path, flush=True)
        is_well &= not kept.results[bench.name].wrong
    return is_well


def run(bench: Bench, seeds: int, jobs: int = 1, only: str = "") -> Iterator[Result]:
    """What is known of a benchmark after each row and at its end; UserError where `only` leaves no row."""
    jobs = 1 if bench.is_timed else jobs
    words = ["crunch bench", bench.name, f"--seeds {seeds}", f"--jobs {jobs}", f"--only {only!r}" if only else ""]
    result = Result(
        name=bench.name,
        about=bench.about,
        command=" ".join(filter(None, words)),
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        commit=commit(),
        machine=machine(),
        seeds=seeds,
        jobs=jobs,
        columns=[bench.heading, *(column.title for column in bench.columns)],
    )
    began = time.perf_counter()
    rows = []
    with Crew(seeds, jobs, only) as crew:
        for row in bench.rows(crew):
            rows.append(row)
            cells = [column.text(row) for column in bench.columns]
            result.rows.append(ResultRow(name=row.name, cells=cells, records=row.records))
            result.seconds = round(time.perf_counter() - began, 1)
            yield result
    if not rows:
        raise UserError(f"no row of `{bench.name}` has `{only}` in its name; leave out --only to see them all")
    result.notes = list(bench.notes(rows)) if bench.notes else []
    result.wrong = list(bench.verdict(rows)) if bench.verdict else []
    yield result
