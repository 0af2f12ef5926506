"""How far the two builds of the boards part: their C on this machine, and their real programs under simavr."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.benchmark import Bench, Column, Record, Row, each, runs, tails, values_of
from firmware.virtual import Build, VirtualCrunch, corridor_cycle, corridor_plan

SECONDS = 60.0
STEP = 0.02  # s between two looks at the lean
FARTHEST = 20.0  # mm that two robots of the same C may be apart, for bytes on the line come to one a little later
FALLEN = 0.7  # rad


def drive(build: Build, drift: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """True poses (n, 3) at 50 Hz and leans (n,) of a minute along the corridors."""
    robot = VirtualCrunch(corridor_cycle(seed), seed=seed, drift=drift, plan=corridor_plan(seed), build=build)  # pyright: ignore
    leans = []
    for _ in range(round(SECONDS / STEP)):
        robot.advance(STEP)
        leans.append(robot.tilt)
    return robot.truth()[1], np.array(leans)


def run(drift: str, seed: int) -> Record:
    """The same robot, world, plan and random numbers with both."""
    (host, host_leans), (avr, avr_leans) = drive("host", drift, seed), drive("avr", drift, seed)
    n = min(len(host), len(avr))
    apart = np.hypot(*(host[:n] - avr[:n])[:, :2].T)
    turned = np.degrees(np.abs((host[:n, 2] - avr[:n, 2] + np.pi) % (2.0 * np.pi) - np.pi))
    return {
        "seed": seed,
        "apart_mm": 1000.0 * float(apart.max()),
        "turned": float(turned.max()),
        "lean": 1000.0 * float(np.sqrt(np.mean(host_leans**2))),
        "lean_avr": 1000.0 * float(np.sqrt(np.mean(avr_leans**2))),
        "fell": bool(max(np.abs(host_leans).max(), np.abs(avr_leans).max()) > FALLEN),
    }


def verdict(rows: list[Row]) -> Iterator[str]:
    """Neither may fall, nor may they part."""
    for row in rows:
        if any(values_of(row, "fell")):
            yield f"{row.name}: a robot fell"
        if max(values_of(row, "apart_mm")) > FARTHEST:
            yield f"{row.name}: the builds part by more than {FARTHEST:g} mm"


BENCH = Bench(
    name="builds",
    about="the boards' C on this machine against their real programs: a minute's drive along corridors, by plan",
    rows=each(run, {f"drift {drift}": drift for drift in ("none", "medium", "high")}),
    columns=(
        Column("farthest apart (mm): median / p90 / worst", tails("apart_mm", 1)),
        Column("headings apart (deg)", tails("turned", 2)),
        Column("lean of the one, rms (mrad)", tails("lean", 1)),
        Column("of the other", tails("lean_avr", 1)),
        Column("runs", runs),
    ),
    seeds=10,
    minutes=3,
    heading="minute's drive",
    verdict=verdict,
)
