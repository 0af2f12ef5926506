"""What came of a benchmark: its table with everything that the figures depend on, for the terminal and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from rich.box import MARKDOWN
from rich.console import Console
from rich.table import Table

from bench.machine import Machine

WIDE = 10_000  # columns of a file, in which no table is folded


class ResultRow(BaseModel):
    """One line: its name, the text in each column, and what each run found."""

    name: str
    cells: list[str]
    records: list[dict[str, Any]]


class Result(BaseModel):
    """A benchmark's table. Numbers that are not finite become null in JSON."""

    name: str
    about: str
    command: str
    date: str  # ISO 8601, UTC
    commit: str
    machine: Machine
    seeds: int
    jobs: int
    seconds: float = 0.0
    columns: list[str]  # the first is the rows' name
    rows: list[ResultRow] = []
    notes: list[str] = []
    wrong: list[str] = []  # a sentence for all that must not be

    def show(self) -> None:
        """Print the table with what it depends on."""
        print(f"\n{self.name}: {self.about}\n")
        show_table(self.columns, [[row.name, *row.cells] for row in self.rows])
        for note in ("", *self.notes, *(f"WRONG: {sentence}" for sentence in self.wrong)):
            print(note)
        print(f"{self.command} · {self.date} · commit {self.commit} · {self.seconds:.0f} s\n{self.machine}")


def show_table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table as Markdown; on a terminal its cells fold to the width that there is, in a file they do not."""
    console = Console(markup=False, highlight=False, emoji=False)
    if not console.is_terminal:
        console.width = WIDE
    table = Table(box=MARKDOWN)
    for title in titles:
        table.add_column(title, overflow="fold")
    for row in rows:
        table.add_row(*row)
    with console.capture() as capture:
        console.print(table)
    print(capture.get().strip())


class Results(BaseModel):
    """A file of results by the benchmarks' names."""

    results: dict[str, Result]

    def write(self, path: Path) -> None:
        """Write the file anew."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self.model_dump_json(indent=1) + "\n")

    @classmethod
    def read(cls, path: Path) -> Results:
        """What `write` wrote."""
        return cls.model_validate_json(path.read_text())
