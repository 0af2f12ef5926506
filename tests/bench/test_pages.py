"""The page of results has a place for every benchmark's table, and tells what made it."""

from __future__ import annotations

import re

from bench import cycle
from bench.claims.findings import renewed
from bench.machine import machine
from bench.pages import PAGE, table
from bench.result import Result, ResultRow


def made(*rows: tuple[str, float], load=0.0) -> Result:
    """A result as a benchmark would have kept it, before its table got more columns."""
    return Result(
        name="cycle",
        about="",
        command="crunch bench cycle --seeds 3",
        date="2026-11-22T10:00:00+00:00",
        commit="0123456789",
        machine=machine().model_copy(update={"processor": "a processor", "cores": 2, "load": load}),
        seeds=3,
        jobs=1,
        columns=["drift", "ATE (m)"],
        rows=[ResultRow(name=name, cells=[str(ate)], records=[{"seed": 0, "ate": ate}]) for name, ate in rows],
        notes=["a note"],
    )


def test_parts_of_a_benchmark_are_one_table():
    head, _, low, high, *_ = lines = table([made(("low", 0.1)), made(("high", 0.3), load=2.0)]).splitlines()
    assert [cell.strip() for cell in head.split("|")[1:-1]] == [
        "drift",
        *(column.title for column in cycle.BENCH.columns),
    ]
    assert low.startswith("| low | 1 | - |")
    assert "| 0.10 / 0.10 / 0.10 |" in low
    assert "| 0.30 / 0.30 / 0.30 |" in high
    assert len({line.count("|") for line in lines[:4]}) == 1
    quiet, busy = re.findall(r"\*`(.*)\*", "\n".join(lines))
    assert quiet == "crunch bench cycle --seeds 3`, 2026-11-22, commit 0123456, 2 cores of a processor."
    assert "busy" in busy
    assert lines.count("a note") == 1, "what all parts say stands once"


def test_the_page_has_its_places():
    page = PAGE.read_text()
    places = re.findall(r"<!-- (\w+) -->", page.replace("<!-- end -->", ""))
    assert {"cycle", "real", "worlds", "beams", "scale", "kernels", "speed", "ablation", "calibration"} <= set(places)
    for name in places:
        assert "| low | 1 |" in renewed(page, {name: table([made(("low", 0.1))])})
