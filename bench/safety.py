"""The supervisor's safety table, each row inflicted on the real boards: how soon they act, and what they say."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from bench.benchmark import Bench, Column, Record, Row, each, failed, figures, runs, share, values_of
from bench.hazards import HAZARDS, suffer

BY_NAME = {hazard.name: hazard for hazard in HAZARDS}


def run(name: str, seed: int) -> Record:
    """One robot and one hazard."""
    return suffer(BY_NAME[name], seed)


def words(row: Row) -> str:
    """What was told, and by how many where they did not all tell the same."""
    counts = Counter(values_of(row, "told")).most_common()
    return "; ".join(told if len(counts) == 1 else f"{told} ({count})" for told, count in counts)


def verdict(rows: list[Row]) -> Iterator[str]:
    """Every row of the table is to be kept by every robot."""
    for row in rows:
        if not all(values_of(row, "is_right")):
            yield f"{row.name}: not as it should be with the seeds {failed('is_right')(row)}"


BENCH = Bench(
    name="safety",
    about="hazards inflicted on the real boards under simavr: what they do, how soon, and what they tell",
    rows=each(run, {name: name for name in BY_NAME}),
    columns=(
        Column("rule", lambda row: BY_NAME[row.name].rule),
        Column("allowed (ms)", lambda row: str(BY_NAME[row.name].allowed_ms)),
        Column("measured: median / worst (ms)", figures("ms", 0, 0.5, 1.0)),
        Column("state and reason told", words),
        Column("as it should be (95 %)", share("is_right")),
        Column("runs", runs),
    ),
    seeds=20,
    minutes=6,
    heading="hazard",
    verdict=verdict,
)
