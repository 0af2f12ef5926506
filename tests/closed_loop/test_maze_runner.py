"""Maze Runner in a maze, byte by byte: the motor board's own C, a laser that speaks SCIP, our session and its fold."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial import KDTree

from bench.maze import visible
from firmware.virtual.maze_body import Drift
from firmware.virtual.maze_runner import VirtualMazeRunner
from firmware.virtual.mazes import CELL, maze
from server import channels, link
from server.commands import PowersCommand, StopCommand
from server.headless import BOARD, SETTINGS, STEP, Headless
from server.messages import Drive, Goal, Stop
from server.robots.maze_runner import MazeRunner
from slam.pose import between, compose, inverse, transform, wrap

PARAMS = SETTINGS.maze_runner


class InMaze(Headless):
    """A robot in a maze, whose truth is known."""

    virtual: VirtualMazeRunner


def loop_in(size="medium", seed=0, drift: Drift = "medium") -> InMaze:
    return InMaze(VirtualMazeRunner(maze(size, seed), seed=seed, drift=drift), seed)


def test_it_drives_as_told_and_stops_when_nobody_tells_it_any_more():
    loop = loop_in(drift="none")
    loop.run(0.5)
    loop.run(2.0, Drive(0.0, 0.2, 0.0))
    way = float(np.hypot(*loop.virtual.pose[:2]))
    assert 0.2 < way < 0.42
    loop.run(1.5)
    still = loop.virtual.pose
    loop.run(1.0)
    assert loop.virtual.pose == pytest.approx(still, abs=1e-3)
    assert loop.robot.stop_reason == "link"


def test_a_stop_stops_it_at_once():
    loop = loop_in(drift="none")
    loop.run(0.5)
    loop.run(1.0, Drive(0.0, 0.2, 0.0))
    effects = loop.session.command(Stop(0.0), loop.virtual.time)
    assert any(isinstance(effect, StopCommand) for effect in effects)
    loop.obey(effects)
    loop.run(0.8)
    still = loop.virtual.pose
    loop.run(0.5)
    assert loop.virtual.pose == pytest.approx(still, abs=1e-3)
    assert loop.robot.stop_reason == "command"


def test_turns_are_bounded_and_powers_never_beyond_the_whole():
    robot = MazeRunner(PARAMS)
    [command] = robot.step(Drive(0.0, 0.1, 9.0))
    assert isinstance(command, PowersCommand)
    [bounded] = robot.step(Drive(0.0, 0.1, PARAMS.max_turn))
    assert command == bounded
    [fast] = robot.step(Drive(0.0, 5.0, 0.3))
    assert isinstance(fast, PowersCommand)
    assert fast.right == pytest.approx(1.0)
    assert 0.0 < fast.left < fast.right


def test_it_knows_where_it_is_though_its_motors_lie():
    """Turns and straights in a maze at the worst drift: the laser's own odometry errs by centimetres."""
    loop = loop_in(seed=3, drift="high")
    loop.run(0.5)
    start = loop.virtual.pose
    for _ in range(4):
        loop.run(4.0, Drive(0.0, 0.0, 0.7))
        loop.run(1.0, Drive(0.0, 0.1, 0.0))
        loop.run(1.0, Drive(0.0, -0.1, 0.0))
    true = between(start, loop.virtual.pose)
    told = between(np.zeros(3), loop.robot.here())
    off = between(true, told)
    assert math.hypot(off[0], off[1]) < 0.04
    assert abs(off[2]) < 0.03
    reckoned = between(true, loop.robot.reckoning.pose)
    assert math.hypot(reckoned[0], reckoned[1]) + abs(reckoned[2]) > 0.1


def test_turned_slowly_in_a_corner_it_follows_the_walls_and_not_its_motors():
    """They turn it at half the rate that they were told, a hand's breadth from walls."""
    loop = loop_in("small", 5)
    loop.run(0.1)
    start = loop.virtual.pose
    loop.run(22.0, Drive(0.0, 0.0, 0.3))
    turned = between(start, loop.virtual.pose)[2]
    assert abs(wrap(loop.robot.reckoning.pose[2] - turned)) > 0.3
    assert abs(wrap(loop.robot.here()[2] - turned)) < 0.03


@pytest.mark.parametrize("seed", [1, 2])
def test_it_goes_to_a_place_without_touching_a_wall(seed):
    loop = loop_in("small", seed)
    loop.run(0.5)
    ahead = compose(loop.virtual.pose, np.array([CELL, 0.0, 0.0]))
    goal = between(loop.virtual.pose, ahead)
    loop.tell(Goal(0.0, (float(goal[0]), float(goal[1])), 0.2))
    loop.run(12.0)
    assert loop.robot.goal is None, "it has arrived"
    assert np.hypot(*(loop.virtual.pose - ahead)[:2]) < 0.2
    assert loop.virtual.body.bumps == 0
    snapshot = loop.robot.snapshot()
    assert snapshot.robot == "maze_runner"
    assert snapshot.local_map.size > 1000
    assert len(loop.keyframes) >= 2


def test_noise_on_both_lines_is_counted_and_survived():
    loop, rng = loop_in(drift="none"), np.random.default_rng(1)
    for _ in range(100):
        loop.run(STEP, Drive(0.0, 0.1, 0.0))
        for line in (BOARD, "laser"):
            noise = rng.integers(0, 256, 20, dtype=np.uint8).tobytes() + b"\n\n"
            loop.obey(loop.session.receive(line, noise, loop.virtual.time))
        loop.virtual.write(noise)
    assert loop.session.health(loop.virtual.time)["rejected"] > 50
    assert loop.session.frames["laser"] > 5
    assert np.hypot(*loop.virtual.pose[:2]) > 0.03


def test_frames_of_boards_that_are_not_its_own_are_refused():
    loop = loop_in()
    frame = link.encode(link.Frame(channels.DRIVE, channels.STATUS, 0, 0, bytes(16)))
    assert loop.session.receive(BOARD, frame, 0.0) == []
    assert loop.session.refused["source"] == 1


@pytest.mark.parametrize(("size", "seed"), [("small", 0), ("small", 1), ("medium", 2), ("medium", 3), ("large", 2)])
def test_it_explores_a_maze_until_the_map_is_closed_and_stops(size, seed):
    loop = loop_in(size, seed)
    explorer = loop.explore(300.0)
    assert explorer.progress == ("done", 0)
    assert loop.virtual.body.bumps == 0
    loop.run(1.0)
    still = loop.virtual.pose
    loop.run(2.0)
    assert loop.virtual.pose == pytest.approx(still, abs=0.01)
    true = transform(inverse(loop.virtual.world.start), visible(size, seed))
    points = loop.wall_points()
    assert KDTree(true).query(points)[0].max() < 0.2
    assert np.mean(KDTree(points).query(true)[0] < 0.2) > 0.95
