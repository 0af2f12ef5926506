"""What a claim's measurement gives: tables of plain rows for the page, and longer curves for its picture."""

from __future__ import annotations

import re
from typing import NamedTuple

Row = dict[str, float | int | str]


class Effort(NamedTuple):
    """How much is measured: simulated drives by seed, particles, length (m) of a lap, pairs of vertices."""

    seeds: int = 20
    particles: int = 2000
    length: float = 50.0
    pairs: int = 300


class Findings(NamedTuple):
    """Rows by the table's name: `tables` stand on the page, `curves` are only drawn."""

    tables: dict[str, list[Row]]
    curves: dict[str, list[Row]]


def text_of(value: float | int | str) -> str:
    """A cell: three significant digits of a float."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def markdown(rows: list[Row]) -> str:
    """Rows that share their columns as a table."""
    columns = list(rows[0])
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(text_of(row[column]) for column in columns) + " |" for row in rows]
    return "\n".join(lines)


def renewed(page: str, texts: dict[str, str]) -> str:
    """The page with new text between each `<!-- NAME -->` and `<!-- end -->`; KeyError where a name has no place."""
    for name, text in texts.items():
        between = re.compile(rf"(<!-- {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
        if not between.search(page):
            raise KeyError(f"the page has no place for {name}")
        page = between.sub(lambda found, text=text: f"{found[1]}{text}\n{found[2]}", page)
    return page
