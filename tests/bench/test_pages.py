"""The page of results has a place for every benchmark's table, and tells what made it."""

from __future__ import annotations

import re

import pytest

from bench.claims.findings import renewed
from bench.machine import machine
from bench.pages import PAGE, table
from bench.result import Result, ResultRow


def made(*rows: tuple[str, str], columns=("drift", "ATE (m)"), load=0.0) -> Result:
    """A result as a benchmark would keep it."""
    return Result(
        name="cycle",
        about="",
        command="crunch bench cycle --seeds 3",
        date="2026-11-22T10:00:00+00:00",
        commit="0123456789",
        machine=machine().model_copy(update={"processor": "a processor", "cores": 2, "load": load}),
        seeds=3,
        jobs=1,
        columns=list(columns),
        rows=[ResultRow(name=name, cells=[cell], records=[]) for name, cell in rows],
        notes=["a note"],
    )


def test_parts_of_a_benchmark_are_one_table():
    text = table([made(("low", "0.1")), made(("high", "0.3"), load=2.0)])
    assert text.startswith("| drift | ATE (m) |\n|---|---|\n| low | 0.1 |\n| high | 0.3 |\n\na note\n")
    quiet, busy = re.findall(r"\*`(.*)\*", text)
    assert quiet == "crunch bench cycle --seeds 3`, 2026-11-22, commit 0123456, 2 cores of a processor."
    assert "busy" in busy


def test_parts_that_differ_in_columns_are_refused():
    with pytest.raises(ValueError, match="parts of cycle"):
        table([made(("low", "0.1")), made(("high", "0.3"), columns=("drift", "ATE"))])


def test_the_page_has_its_places():
    page = PAGE.read_text()
    places = re.findall(r"<!-- (\w+) -->", page.replace("<!-- end -->", ""))
    assert {"cycle", "real", "worlds", "beams", "scale", "kernels", "speed", "ablation", "calibration"} <= set(places)
    for name in places:
        assert "| low | 0.1 |" in renewed(page, {name: table([made(("low", "0.1"))])})
