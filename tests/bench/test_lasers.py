"""The benchmarks of lasers in small: pairs of known truth, ways to align them, turn rates, times, and the pictures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench import basin, laser, laser_pictures, maze, maze_turns
from bench.alignments import by_lines, by_points, maze_pairs, rigid, searched
from bench.benchmark import Bench, Row
from bench.command import run as run_bench
from bench.result import Result, ResultRow
from bench.timed_mapper import TimedMapper
from server.replay import rehearsal, run_mapper
from server.robots.maze_runner import MazeRunnerParams
from slam.laser_scan import LaserParams
from slam.pose import between, compose, transform
from tests.slam.laser_world import ring, scan_at


def made(bench: Bench, records: dict[str, list[dict]]) -> Result:
    """A result of such rows, without running."""
    rows = [Row(name, found) for name, found in records.items()]
    (*_, result) = run_bench(bench._replace(rows=lambda crew: rows), 1)
    return result


def test_a_rigid_motion_is_found_from_the_points_that_it_moved():
    points, motion = np.random.default_rng(3).normal(size=(20, 2)), np.array([0.3, -0.2, 2.5])
    assert rigid(points, transform(motion, points)) == pytest.approx(motion)


@pytest.mark.parametrize("align", [by_points, by_lines, searched])
def test_every_way_aligns_from_close_by(align):
    pose, walls = np.array([5.0, 1.0, 0.1]), ring()
    motion = np.array([0.05, 0.02, 0.03])
    scan, other = scan_at(compose(pose, motion), walls, 1), scan_at(pose, walls, 2)
    assert basin.is_found(basin.Pair(scan, other, motion), align(scan, other, np.zeros(3)))


def test_a_pair_in_a_maze_is_where_its_scans_lie_upon_each_other():
    for pair in maze_pairs(3, 1):
        error = between(pair.pose, by_lines(pair.scan, pair.other, pair.pose))
        assert np.hypot(*error[:2]) < 0.03
        assert abs(error[2]) < 0.02


def test_the_basin_is_counted_for_every_guess(monkeypatch):
    monkeypatch.setattr(basin, "PAIRS", 1)
    monkeypatch.setattr(basin, "METHODS", {name: basin.METHODS[name] for name in ("point to line", "search, then ICP")})
    for name, record in basin.run(basin.MAZES, 2).items():
        held = np.array(record["held"])
        assert held.shape == (len(basin.DEGREES), len(basin.METRES))
        assert held[0, 0] == record["pairs"] == 1, name
    row = Row("row", [{"pairs": 4, "held": np.full((7, 8), 3)}, {"pairs": 4, "held": np.full((7, 8), 1)}])
    pairs, over_metres, over_degrees, *_ = (column.text(row) for column in basin.BENCH.columns)
    assert (pairs, over_metres, over_degrees) == ("8", " / ".join(["50"] * 8), " / ".join(["50"] * 7))


@pytest.mark.parametrize("rate", maze_turns.RATES)
def test_the_robot_turns_as_fast_as_is_wanted_unless_it_is_bounded(rate):
    bounds = {way: maze_turns.settings_of(rate, way)["maze_runner"]["max_turn"] for way in maze_turns.WAYS}
    assert bounds.pop(maze_turns.BOUNDED) == MazeRunnerParams().max_turn
    assert set(bounds.values()) == {rate}


def test_the_fast_turns_of_a_drive_are_told_whatever_it_did_else():
    times = np.arange(0.0, 100.0, 0.02)
    heading = np.cumsum(np.where((times > 50.0) & (times < 55.0), 0.02 * 2.0, 0.0))
    poses = np.column_stack([0.0 * times, times, np.remainder(heading + math.pi, 2.0 * math.pi) - math.pi])
    assert maze.fast_turns(times, poses) == pytest.approx(2.0)


def test_a_log_s_steps_and_vertices_are_timed():
    params = MazeRunnerParams(laser=LaserParams(beams=90, step_deg=2.0, first_deg=-89.0))
    mapper = TimedMapper(params, 0, 1)
    result = run_mapper(rehearsal(params), mapper)
    record = mapper.times_taken()
    assert len(mapper.robot.steps) == 8
    assert len(mapper.extends) == len(result.path)
    assert record["interval_ms"] == pytest.approx(1000.0)
    assert 0.0 < record["step_p99_ms"] <= record["step_worst_ms"]
    assert 0.0 < record["extend_p99_ms"] <= record["extend_worst_ms"]
    row = Row("row", [record, record | {"step_worst_ms": 5e6}])
    assert laser.longest("step")(row).endswith(" / 5,000,000.0")


def test_a_basin_is_drawn_of_the_rows_that_there_are():
    held = np.zeros((len(basin.DEGREES), len(basin.METRES)), int)
    held[0] = 2
    result = made(basin.BENCH, {"ACES, point to line": [{"seed": 0, "pairs": 2, "held": held.tolist()}]})
    figure = laser_pictures.basin(result)
    drawn = {axes.get_title(): [text.get_text() for text in axes.texts] for axes in figure.axes}
    assert drawn["mazes: point to line"] == []
    assert drawn["real logs: point to line"] == ["100"] * 8 + ["0"] * 48


def test_memory_is_drawn_beside_a_growth_in_proportion():
    keys = ("megabytes", "apart", "peak_mb", "vertex_ms", "worst_ms", "patches")
    rows = {f"{n} particles": [{"seed": 0, "particles": n} | dict.fromkeys(keys, 2.0 * n**0.5)] for n in (25, 100)}
    memory, _ = laser_pictures.laser_memory(made(laser.MEMORY, rows)).axes
    lines = {str(line.get_label()): list(np.asarray(line.get_ydata())) for line in memory.get_lines()}
    assert lines["shared patches"] == [10.0, 20.0]
    assert lines["in proportion"] == [10.0, 40.0]


def test_errors_are_drawn_against_turn_rates_even_where_a_map_is_empty():
    worst = {1.2: [0.1, 0.3, None], 2.4: [None]}  # as JSON has what is infinite
    rows = [
        ResultRow(name=f"small, {rate:g} rad/s, bounded", cells=[], records=[{"worst": x, "median": x} for x in found])
        for rate, found in worst.items()
    ]
    result = made(maze_turns.BENCH, {"small, 1.2 rad/s, bounded": [{"seed": 0}]}).model_copy(update={"rows": rows})
    figure = laser_pictures.maze_turns(result)
    middle = figure.axes[0].get_lines()[0]
    assert list(np.asarray(middle.get_xdata())) == [1.2]
    assert list(np.asarray(middle.get_ydata())) == pytest.approx([0.2])
