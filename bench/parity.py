"""The firmware's C computes the same bits on the ATmega32 and on this machine: the tests' comparison, but longer."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from bench.benchmark import Bench, Column, Record, Row, each, middle, plain, values_of
from server.errors import UserError

ROOT = Path(__file__).resolve().parents[1]
TESTS = "tests/firmware/test_parity.py"
STEPS = 10_000
OUTCOMES = ("passed", "failed", "skipped", "error")


def compare(steps: int) -> subprocess.CompletedProcess[str]:
    """The tests with so many steps of the drive board's loop, and of each of its files; UserError without pytest."""
    if find_spec("pytest") is None:
        raise UserError("no pytest here; run `make setup`")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", TESTS]
    environment = {**os.environ, "PARITY_STEPS": str(steps)}
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


def told(said: str) -> Record:
    """How many tests ended how, by pytest's last line, and which did not pass."""
    *_, last = said.strip().splitlines() or [""]
    counts = {name: int(count) for count, name in re.findall(rf"(\d+) ({'|'.join(OUTCOMES)})", last)}
    if not counts:
        raise RuntimeError(f"the tests did not run:\n{said[-2000:]}")
    differing = re.findall(r"^(?:FAILED|ERROR) \S+::(\S+)", said, re.MULTILINE)
    return {name: counts.get(name, 0) for name in OUTCOMES} | {"differing": ", ".join(differing) or "none"}


def run(steps: int, seed: int) -> Record:
    """One comparison; its random input has seeds of its own."""
    done = compare(steps)
    return {"seed": seed, **told(done.stdout + done.stderr)}


def verdict(rows: list[Row]) -> Iterator[str]:
    """Every comparison is to be made, and to find no other bit."""
    for row in rows:
        for name in OUTCOMES[1:]:
            if count := sum(values_of(row, name)):
                yield f"{row.name}: {count} {name}"


BENCH = Bench(
    name="parity",
    about="the boards' C on an ATmega32 under simavr against this machine, bit by bit, over 10,000 steps",
    rows=each(run, {f"{STEPS:,} steps": STEPS}),
    columns=(
        Column("comparisons the same", middle("passed", 0)),
        Column("not the same", middle("failed", 0)),
        Column("left out", middle("skipped", 0)),
        Column("which", plain("differing")),
    ),
    minutes=2,
    heading="length",
    verdict=verdict,
)
