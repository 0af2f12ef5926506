"""Maze Runner with optical mice, byte by byte: virtual mice, their lines, the session and the odometry of it all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firmware.virtual.maze_runner import VirtualMazeRunner
from firmware.virtual.mice import PLACES, Floor
from firmware.virtual.worlds import World
from server.config import Config, load
from server.errors import UserError
from server.headless import Headless
from server.messages import Drive, MouseCounts
from server.recorded import open_log
from server.recording import Kind, Reader
from server.replay import Options, replay
from server.simulate import Simulation, simulate_drive, with_mice
from slam.pose import between
from tests.server.rendered import rendered

HALL = World(np.array([[-9, -9, 9, -9], [9, -9, 9, 9], [9, 9, -9, 9], [-9, 9, -9, -9]], float))
BLACK = 1.0  # a marking in each square


class Blind(VirtualMazeRunner):
    """One whose laser is not plugged in, so that nothing but odometry is left to be looked at."""

    def write_laser(self, data: bytes) -> None:
        """Nobody hears it."""


class Odometer(Headless):
    """A drive in an empty hall whose truth is known."""

    virtual: VirtualMazeRunner

    def __init__(self, mice: int, seed: int, density: float = 0.0):
        virtual = Blind(HALL, seed=seed, mice=PLACES[:mice], floor=Floor(density, seed))
        super().__init__(virtual, seed, with_mice(Config(), mice))
        self.run(0.5)
        self.start = virtual.pose

    def drive(self, legs: int = 4) -> None:
        """Straights, curves and turns on the spot."""
        for leg in range(legs):
            self.run(2.5, Drive(0.0, 0.18, 0.0))
            self.run(1.5, Drive(0.0, 0.1, 0.7 if leg % 3 else -0.7))
            self.run(1.0, Drive(0.0, 0.0, 0.6))

    def errors(self, told: np.ndarray) -> tuple[float, float]:
        """How far (m, rad) an odometry (3,) is from the truth."""
        true = between(self.start, self.virtual.pose)
        return float(np.hypot(*(told - true)[:2])), abs(float(between(true, told)[2]))

    @property
    def health(self):
        """Of its mice."""
        assert self.robot.mice is not None
        return self.robot.mice.health


def driven(mice: int, seed: int, density: float = 0.0) -> Odometer:
    drive = Odometer(mice, seed, density)
    drive.drive()
    return drive


def test_two_mice_on_a_clean_floor_err_several_times_less_than_the_motors():
    drives = [driven(2, seed) for seed in range(11)]
    mice = np.median([drive.errors(drive.robot.odometry) for drive in drives], axis=0)
    motors = np.median([drive.errors(drive.robot.reckoning.pose) for drive in drives], axis=0)
    print("two mice", mice, "motors", motors)
    assert np.all(mice < motors / 4.0)
    assert sum(drive.health.filled_in for drive in drives) <= 0.01 * sum(drive.health.steps for drive in drives)


def test_one_of_three_that_looks_at_markings_is_found_and_left_out():
    errors, clean_errors = [], []
    for seed in range(5):
        drive, clean = Odometer(3, seed), driven(3, seed)
        drive.virtual.mice[1].floor = Floor(BLACK, seed)
        drive.drive()
        left_out, steps = drive.health.left_out, drive.health.steps
        assert left_out[1] > 0.04 * steps, "as often as it is over a marking that does not lead its way"
        assert left_out[1] > 4 * max(left_out[0], left_out[2])
        errors.append(drive.errors(drive.robot.odometry))
        clean_errors.append(clean.errors(clean.robot.odometry))
    print("fooled", np.median(errors, axis=0), "clean", np.median(clean_errors, axis=0))
    assert np.all(np.median(errors, axis=0) < np.median(clean_errors, axis=0) + [0.1, 0.1])


class Foil(Floor):
    """Everywhere a line across the way of a robot that goes along x: there is nothing to be counted."""

    def marking(self, x: float, y: float) -> float:
        """Across."""
        return 0.5 * np.pi


def test_where_all_mice_are_fooled_the_motors_fill_in_and_that_is_told():
    drive = Odometer(3, 4)
    for mouse in drive.virtual.mice:
        mouse.floor = Foil()
    drive.run(4.0, Drive(0.0, 0.18, 0.0))
    assert drive.health.filled_in > 0.7 * drive.health.steps
    way, by_motors = (np.hypot(*pose[:2]) for pose in (drive.robot.odometry, drive.robot.reckoning.pose))
    assert way == pytest.approx(by_motors, rel=0.1)
    assert drive.robot.snapshot().mice == drive.health


def test_counts_that_come_late_are_waited_for():
    """A third of the reads find nothing, and the next finds twice as much, mouse by mouse."""
    errors = []
    for seed in range(5):
        drive, rng = Odometer(2, seed), np.random.default_rng(seed)
        take = drive.virtual.take_mouse
        drive.virtual.take_mouse = lambda number, rng=rng, take=take: b"" if rng.random() < 0.3 else take(number)
        drive.drive(3)
        assert drive.health.filled_in <= 0.02 * drive.health.steps
        errors.append([drive.errors(drive.robot.odometry)[0], drive.errors(drive.robot.reckoning.pose)[0]])
    mice, motors = np.median(errors, axis=0)
    assert mice < 0.25 * motors


@pytest.mark.parametrize("gone", [(1,), (0, 1)])
def test_mice_that_vanish_on_the_way_and_come_back_are_survived(gone):
    drive = Odometer(2, 3)
    drive.drive(1)
    for number in gone:
        drive.virtual.mice[number].is_plugged = False
    drive.drive(1)
    health = drive.health
    assert health.filled_in > 0
    for number in gone:
        drive.virtual.mice[number].is_plugged = True
    drive.drive(2)
    assert drive.health.filled_in <= health.filled_in + 3
    mice, motors = drive.errors(drive.robot.odometry), drive.errors(drive.robot.reckoning.pose)
    assert mice[0] < motors[0]


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("mice") / "a.rlog"
    simulate_drive(Simulation("maze_runner", "maze:small:1", None, 1, out, duration=30.0, mice=2), load())
    return out


def test_a_recording_has_the_lines_of_its_mice_and_says_where_they_sit(recording):
    reader = Reader(recording)
    assert {"mouse0", "mouse1"} <= {record.link_id for record in reader if record.kind == Kind.RX}
    assert not any(record.link_id.startswith("mouse") for record in reader if record.kind == Kind.TX)
    assert len(reader.header.configuration["maze_runner"]["mice"]["mice"]) == 2
    told = [message for message in open_log(recording).messages() if isinstance(message, MouseCounts)]
    assert {message.mouse for message in told} == {0, 1}
    assert len(told) > 500
    assert all(message.is_whole for message in told)


def test_a_recording_with_mice_is_mapped_to_the_same_bytes_twice_and_shown(recording, tmp_path):
    few = Options("maze_runner", flags={"maze_runner": {"filter": {"particles": 50}}})
    for name in ("a", "b"):
        assert replay(recording, tmp_path / name, few).settings["maze_runner"]["mice"]
    timed = {"report.json", "map.png"}  # they tell how long it took
    names = {file.name for file in (tmp_path / "a").iterdir()} - timed
    assert len(names) >= 6
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    last, _ = rendered(recording, tmp_path / "cache")
    assert last.complete


def test_settings_that_say_where_mice_sit_are_kept():
    settings = load(assignments=["maze_runner.mice.mice=[{x = 0.2}, {x = -0.2, angle = 1.5}]"])
    assert with_mice(settings, 2) is settings
    with pytest.raises(UserError, match="tells where 2 sit"):
        with_mice(settings, 3)
    assert with_mice(settings, 0).maze_runner.mice is None, "a virtual robot without mice"
    assert with_mice(Config(), 0).maze_runner.mice is None
    known = with_mice(Config(), 3).maze_runner.mice
    assert known is not None
    assert [mouse.x for mouse in known.mice] == [place.x for place in PLACES[:3]]


@pytest.mark.parametrize(("robot", "mice", "remedy"), [("maze_runner", 9, "8 at most"), ("crunch", 1, "leave out")])
def test_more_mice_than_a_robot_may_have_are_refused(tmp_path, robot, mice, remedy):
    with pytest.raises(UserError, match=remedy):
        simulate_drive(Simulation(robot, None, None, 1, tmp_path / "a.rlog", mice=mice), load())
