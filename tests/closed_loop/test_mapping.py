"""The virtual robot's bytes become a map that is nearer to the truth than its wheels, and goals are reached by VFH."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware.virtual import Build, Drift, Radio, VirtualCrunch, World, corridor_cycle, corridor_plan
from server import config
from server.messages import Goal
from server.recorded import open_log
from server.replay import run_log
from server.simulate import record
from slam.evaluate import absolute_error, revisits
from slam.timeline import associate
from tests.closed_loop.loop import Loop
from tests.firmware.avr_tools import need_simavr

LENGTH = 24.0  # m of the cycle
ROOM = np.array([[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0], [3, 0, 3, 2.4]], float)  # a wall in the way


def drive_and_map(tmp_path, seed: int, drift: Drift, radio: Radio | None = None, build: Build = "host"):
    """The result of two laps, mapped and odometry's poses where the truth is known, the truth, and all its times."""
    world, plan = corridor_cycle(seed, LENGTH, 1.6), corridor_plan(seed, LENGTH)
    robot = VirtualCrunch(world, seed=seed, drift=drift, plan=plan, radio=radio, build=build)
    path = tmp_path / f"{drift}-{seed}.rlog"
    record(robot, "crunch", path, config.Config(), 400.0, None)
    result = run_log(open_log(path), config.load({"crunch": {"filter": {"particles": 600}}}).crunch, seed)
    times, truth = robot.truth()
    matches = associate(result.drive.times, times)
    true = truth[matches.reference_rows]
    return result, result.trajectory[matches.rows], result.drive.odometry[matches.rows], true, times


@pytest.mark.parametrize("seed", [0, 1])
def test_two_laps_close_although_odometry_does_not(tmp_path, seed):
    closes(*drive_and_map(tmp_path, seed, "high")[1:4])


def test_two_laps_of_the_real_boards_close_as_well(tmp_path):
    need_simavr()
    closes(*drive_and_map(tmp_path, 0, "high", build="avr")[1:4])


def closes(mapped: np.ndarray, odometry: np.ndarray, true: np.ndarray) -> None:
    """That the map closes a loop that odometry does not, and is nearer to the truth."""
    assert not revisits(odometry, true, min_path=10.0).is_closed
    assert revisits(mapped, true, min_path=10.0).is_closed
    assert absolute_error(mapped, true).translation.rmse < absolute_error(odometry, true).translation.rmse


def test_a_bad_radio_costs_frames_and_not_the_map(tmp_path):
    """2 % of the chunks are lost and one bit in 10,000 is flipped; counts of wheels make up for lost frames."""
    radio = Radio(chunk_loss=0.02, bit_error_rate=1e-4)
    result, mapped, _, true, times = drive_and_map(tmp_path, 2, "medium", radio)
    assert 0.9 * len(times) < len(result.drive.times) < 0.995 * len(times)
    assert revisits(mapped, true, min_path=10.0).is_closed


@pytest.mark.parametrize("goal", [(1.0, 0.0), (2.6, 2.4)])
def test_goals_are_reached_without_touching_a_wall(goal):
    start = (1.2, 1.2, 0.0)
    loop = Loop(VirtualCrunch(World(ROOM, start, "room"), seed=5, drift="low"))
    loop.run(1.0)
    loop.say(Goal(loop.robot.time, goal))
    assert loop.reach(60.0), f"stands at {loop.robot.pose}"
    reached = loop.robot.pose[:2] - start[:2]
    assert math.hypot(*(reached - goal)) < 0.4
    assert loop.nearest_wall > 0.076
    assert loop.robot.state in ("armed", "link_lost")
