"""From how far off a guess two scans are still aligned: the basin of convergence, for each way to align them.

A guess is off by so many metres in a random direction and so many degrees to a random side, or by both; the alignment
holds where it ends within 0.05 m and 2 degrees of the truth. Searches are those of `slam.scan_motion`, which are made
where the scans cannot both be true as ICP, point to line, lays them: within what the laser's odometry without any other
thinks possible (0.3 m and 26 degrees), or widely (1 m and 60 degrees). `bench.alignments` has the ways, and says what
the truth is: that of a simulation in mazes, one of our own making in logs. A seed is another maze, or other pairs of a
log.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from bench.alignments import Align, Pair, by_lines, by_points, log_pairs, maze_pairs, searched, searched_widely
from bench.benchmark import Bench, Column, Crew, Record, Row, wilson
from slam.pose import between, compose

METRES = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.75, 1.0)
DEGREES = (0.0, 5.0, 10.0, 20.0, 30.0, 45.0, 60.0)
NEAR, NEAR_TURN = 0.05, math.radians(2.0)
PAIRS = 20  # of a seed
MAZES = "mazes"
WORLDS: Mapping[str, Callable[[int, int], list[Pair]]] = {
    MAZES: maze_pairs,
    "Intel, dense": partial(log_pairs, "intel/intel-dense.log"),
    "ACES": partial(log_pairs, "aces/aces.log"),
    "mine 1": partial(log_pairs, "mines/exp1.dat"),
}
METHODS: Mapping[str, Align] = {
    "point to point": by_points,
    "point to line": by_lines,
    "search, then ICP": searched,
    "wide search, then ICP": searched_widely,
}


def run(world: str, seed: int) -> dict[str, Record]:
    """What every method makes of the same guesses: `held` counts pairs, a row for each rotation, over translations."""
    pairs = WORLDS[world](PAIRS, seed)
    rng = np.random.default_rng([seed, 0x6E55])
    held = {name: np.zeros((len(DEGREES), len(METRES)), int) for name in METHODS}
    for pair in pairs:
        for row, degrees in enumerate(DEGREES):
            for column, metres in enumerate(METRES):
                way, side = rng.uniform(-math.pi, math.pi), rng.choice([-1.0, 1.0])
                off = np.array([metres * math.cos(way), metres * math.sin(way), side * math.radians(degrees)])
                guess = compose(pair.pose, off)
                for name, align in METHODS.items():
                    held[name][row, column] += is_found(pair, align(pair.scan, pair.other, guess))
    return {name: {"seed": seed, "pairs": len(pairs), "held": counts.tolist()} for name, counts in held.items()}


def is_found(pair: Pair, pose: np.ndarray) -> bool:
    """Whether a pose (3,) is the true one."""
    error = between(pair.pose, pose)
    return math.hypot(error[0], error[1]) < NEAR and abs(error[2]) < NEAR_TURN


def rows(crew: Crew) -> Iterator[Row]:
    """Every world, and in it every method."""
    for world in WORLDS:
        names = {f"{world}, {method}": method for method in METHODS}
        wanted = [name for name in names if crew.wants(name, names)]
        if wanted:
            found = crew.map(run, [(world, seed) for seed in range(crew.seeds)], world)
            for name in wanted:
                yield Row(name, [each[names[name]] for each in found])


def held_of(records: list[Record]) -> np.ndarray:
    """The share (rotations, translations) of all pairs that is aligned."""
    return np.sum([record["held"] for record in records], axis=0) / sum(record["pairs"] for record in records)


def pairs_of(row: Row) -> str:
    """How many there are."""
    return str(sum(record["pairs"] for record in row.records))


def along(cells: list[tuple[int, int]]) -> Callable[[Row], str]:
    """The shares at some (rotation, translation), in per cent."""
    return lambda row: " / ".join(f"{100.0 * held_of(row.records)[cell]:.0f}" for cell in cells)


def notes(rows: list[Row]) -> Iterator[str]:
    """How exact a share is."""
    pairs = min(sum(record["pairs"] for record in row.records) for row in rows)
    low, high = wilson(pairs // 2, pairs)
    yield f"of {pairs} pairs, half are aligned by {100.0 * low:.0f} to {100.0 * high:.0f} % (95 %)"


def listed(numbers: tuple[float, ...]) -> str:
    """Numbers for a heading."""
    return " / ".join(f"{number:g}" for number in numbers)


BENCH = Bench(
    name="basin",
    about="from how far off a guess two scans are still aligned, by ICP alone and after a search",
    rows=rows,
    columns=(
        Column("pairs", pairs_of),
        Column(f"aligned (%) from {listed(METRES)} m off", along([(0, n) for n in range(len(METRES))])),
        Column(f"from {listed(DEGREES)} degrees off", along([(n, 0) for n in range(len(DEGREES))])),
        Column("from 0.2 m and 20 degrees off", along([(DEGREES.index(20.0), METRES.index(0.2))])),
        Column("from 0.5 m and 45 degrees off", along([(DEGREES.index(45.0), METRES.index(0.5))])),
    ),
    seeds=10,
    minutes=10,
    needs_data=True,
    heading="scans, method",
    notes=notes,
)
