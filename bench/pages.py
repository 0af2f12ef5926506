"""Puts the tables that `crunch bench` kept into docs/results.md.

    crunch bench cycle --only high --output high.json
    python -m bench.pages build/bench/scale.json high.json ...

Each benchmark's table goes to the page's place of its name; of one that was run in parts the rows stand in the order
of the files. Its columns are those of now, made of what each run found; a dash stands for what was not kept then.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from bench.benchmark import Row
from bench.catalogue import CATALOGUE
from bench.claims.findings import renewed
from bench.recordings import ROOT
from bench.result import Result, Results

PAGE = ROOT / "docs" / "results.md"


def table(parts: Sequence[Result]) -> str:
    """The rows of a benchmark's parts as one table, what the columns cannot say, and what made them."""
    [bench] = [bench for bench in CATALOGUE if bench.name == parts[0].name]
    columns = [bench.heading, *(column.title for column in bench.columns)]
    found = [Row(row.name, row.records) for part in parts for row in part.rows]
    rows = [[row.name, *(column.text(row) for column in bench.columns)] for row in found]
    lines = [f"| {' | '.join(cells)} |" for cells in (columns, *rows)]
    lines.insert(1, "|" + "---|" * len(columns))
    notes = [f"\n{note}" for note in dict.fromkeys(note for part in parts for note in part.notes)]
    return "\n".join([*lines, *notes, *(f"\n*{made_by(part)}*" for part in parts)])


def made_by(result: Result) -> str:
    """The command, when it was run, at which commit and on what."""
    busy = ", busy with other work" if result.machine.is_busy else ""
    machine = f"{result.machine.cores} cores of {result.machine.processor}{busy}"
    return f"`{result.command}`, {result.date[:10]}, commit {result.commit[:7]}, {machine}."


def main() -> None:
    """Renew the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE")
    parts: dict[str, list[Result]] = {}
    for path in parser.parse_args().files:
        for name, result in Results.read(path).results.items():
            parts.setdefault(name, []).append(result)
    PAGE.write_text(renewed(PAGE.read_text(), {name: table(results) for name, results in parts.items()}))
    print(PAGE)


if __name__ == "__main__":
    main()
