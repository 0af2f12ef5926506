"""What fast turns cost Maze Runner's map: the laser takes a tenth of a second for a sweep, and turns bend what it sees.

The robot explores random mazes, as in `bench.maze`, and wants to turn at a rate. *Bounded* it turns no faster than
`maze_runner.max_turn`; *unbounded* that is the rate itself; *the laser alone* is unbounded and has no odometry. The
look around is timed by the rate that is wanted: where the robot turns slower than that, it is given longer, so that
it sees all around in every row. What the wheels reached is a column. *Explored* is the explorer's own word: where the
map is torn it may find nowhere to go at once, of which the walls mapped tell.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bench.benchmark import Bench, Column, each, failed, figures, middle, runs, share, tails
from bench.maze import Case, run
from server.robots.maze_runner import MazeRunnerParams

MAZES = ("small", "medium")
RATES = (0.3, 0.6, 1.2, 2.4, 4.0)  # rad/s
BOUNDED, UNBOUNDED, ALONE = "bounded", "unbounded", "unbounded, the laser alone"
WAYS = (BOUNDED, UNBOUNDED, ALONE)


def settings_of(rate: float, way: str) -> Mapping[str, Any]:
    """Robot and explorer that want to turn at a rate (rad/s)."""
    bound = MazeRunnerParams().max_turn if way == BOUNDED else rate
    return {
        "explorer": {"turn": rate},
        "maze_runner": {"max_turn": bound, "odometry": {"is_alone": way == ALONE}},
    }


CASES = {
    f"{size}, {rate:g} rad/s, {way}": Case(size, "medium", settings_of(rate, way))
    for size in MAZES
    for way in WAYS
    for rate in RATES
}
BENCH = Bench(
    name="maze-turns",
    about="what fast turns cost Maze Runner's map, with the bound on them and without",
    rows=each(run, CASES),
    columns=(
        Column("mazes", runs),
        Column("turned really, 99 % (rad/s)", middle("turned")),
        Column("explored, nothing touched (95 %)", share("explored")),
        Column("right maps (95 %)", share("right")),
        Column("a map's worst piece of wall off: median / p90 / worst (m)", tails("worst")),
        Column("walls off: median (m)", figures("median", 3, 0.5)),
        Column("of the walls mapped: median / least", figures("seen", 3, 0.5, 0.0)),
        Column("seconds driven", middle("seconds", 0)),
        Column("not explored", failed("explored")),
        Column("not right", failed("right")),
    ),
    seeds=10,
    minutes=40,
    heading="maze, rate wanted, how",
)
