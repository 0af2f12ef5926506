"""Maze Runner's odometry from its mice: their word where they are sound, the motors' where they are not."""

from __future__ import annotations

import numpy as np
import pytest

from server.config import Config, ConfigError, load
from server.errors import UserError
from server.live import LiveOptions, check_mouse_lines
from server.messages import Motors, MouseCounts
from server.robots.maze_runner import MazeRunner, MazeRunnerParams
from server.robots.mice import PATIENCE, STEP, Mice
from slam.mouse_odometry import MouseOdometryParams, MouseParams, equations_of
from slam.pose import compose

TICK = 0.02  # s
THREE = (MouseParams(x=0.09, y=0.07), MouseParams(x=0.09, y=-0.07, angle=1.0), MouseParams(x=-0.09, angle=2.5))


class Drive:
    """Mice on a floor, and motors that say something else of the same drive."""

    def __init__(self, mice=THREE):
        self.params = mice
        self.mice = Mice(MouseOdometryParams(mice=mice))
        self.true = self.motors = np.zeros(3)
        self.t = 0.0
        self.owed = np.zeros((len(mice), 2))  # counts that are not whole yet
        self.mice.step(0.0, self.motors)

    def run(self, seconds, motion=(0.004, 0.0, 0.01), by_motors=None, told=lambda number, counts: counts):
        """Goes on with a motion (3,) per tick, the motors' way being another if they say so."""
        for _ in range(round(seconds / TICK)):
            self.t += TICK
            for number, mouse in enumerate(self.params):
                counts = told(number, mouse.counts_per_metre * (equations_of(mouse) @ motion))
                if counts is None:
                    continue
                self.owed[number] += counts
                x, y = (int(count) for count in np.round(self.owed[number]))
                self.owed[number] -= (x, y)
                if x or y:
                    self.mice.count(MouseCounts(self.t, number, x, y))
            half = 0.5 * motion[2]
            turned = np.array([[np.cos(half), -np.sin(half)], [np.sin(half), np.cos(half)]])
            self.true = compose(self.true, np.array([*(turned @ motion[:2]), motion[2]]))
            self.motors = compose(self.motors, np.array(motion if by_motors is None else by_motors))
            self.mice.step(self.t, self.motors)


def test_sound_mice_lead_though_the_motors_err_by_a_third():
    drive = Drive()
    drive.run(5.0, by_motors=(0.003, 0.0, 0.013))
    assert drive.mice.pose == pytest.approx(drive.true, abs=0.01)
    assert drive.mice.health.filled_in == 0
    assert drive.mice.health.steps == pytest.approx(5.0 / STEP, rel=0.2)
    assert drive.mice.health.left_out == (0, 0, 0)


def test_the_pose_moves_with_every_reading_and_not_only_with_the_steps():
    drive, xs = Drive(), []
    for _ in range(20):
        drive.run(TICK, (0.004, 0.0, 0.0))
        xs.append(drive.mice.pose[0])
    assert np.diff(xs) == pytest.approx(0.004, abs=1e-4)


def test_one_of_three_that_counts_too_little_is_left_out():
    drive = Drive()
    drive.run(3.0, told=lambda number, counts: 0.3 * counts if number == 1 else counts)
    health = drive.mice.health
    assert health.left_out[1] > 0.9 * health.steps
    assert (health.left_out[0], health.left_out[2], health.filled_in) == (0, 0, 0)
    assert drive.mice.pose == pytest.approx(drive.true, abs=0.01)


def test_of_two_that_disagree_the_motors_decide():
    drive = Drive(THREE[:2])
    drive.run(3.0, told=lambda number, counts: 0.2 * counts if number == 1 else counts)
    assert drive.mice.health.filled_in > 0.9 * drive.mice.health.steps
    assert drive.mice.pose == pytest.approx(drive.motors, abs=0.1), "but for what nobody notices before a step is over"


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_where_all_count_far_too_little_the_motors_fill_in(share):
    drive = Drive()
    drive.run(3.0, told=lambda number, counts: share * counts)
    assert drive.mice.health.filled_in > 0.9 * drive.mice.health.steps
    assert drive.mice.pose == pytest.approx(drive.motors, abs=0.02)


def test_a_robot_that_stands_is_believed_to():
    drive = Drive()
    drive.run(3.0, (0.0, 0.0, 0.0))
    assert drive.mice.pose == pytest.approx(np.zeros(3))
    assert drive.mice.health.filled_in == 0


def test_a_mouse_that_vanishes_is_left_out_and_taken_back_when_it_returns():
    drive = Drive(THREE[:2])
    drive.run(2.0)
    drive.run(2.0, told=lambda number, counts: None if number == 1 else counts)
    health = drive.mice.health
    assert health.filled_in <= PATIENCE / STEP + 2, "as long as nobody knows that it has gone"
    assert health.left_out[1] == pytest.approx((2.0 - PATIENCE) / STEP, abs=3)
    drive.run(2.0)
    assert drive.mice.health.left_out[1] <= health.left_out[1] + 1
    assert drive.mice.pose == pytest.approx(drive.true, abs=0.1), "but for what nobody noticed within a step"


def test_counts_of_which_some_were_lost_are_not_believed():
    mice = Mice(MouseOdometryParams(mice=THREE))
    for step in range(1, 30):
        for number, mouse in enumerate(THREE):
            x, y = np.round(mouse.counts_per_metre * (equations_of(mouse) @ [0.004, 0.0, 0.0])).astype(int)
            mice.count(MouseCounts(step * TICK, number, int(x), int(y), is_whole=number != 2))
        mice.step(step * TICK, np.array([0.004 * step, 0.0, 0.0]))
    assert mice.health.left_out == (0, 0, mice.health.steps)


def test_counts_of_a_mouse_that_the_settings_do_not_have_are_nobodys():
    mice = Mice(MouseOdometryParams(mice=THREE[:1]))
    mice.step(0.0, np.zeros(3))
    mice.count(MouseCounts(0.1, 5, 100, 100))
    assert mice.step(0.2, np.zeros(3)) == pytest.approx(np.zeros(3))


def test_without_mice_in_the_settings_their_counts_change_nothing():
    robot = MazeRunner(MazeRunnerParams())
    for step in range(20):
        robot.step(MouseCounts(step * TICK, 0, 50, 50))
        robot.step(Motors(step * TICK, 0.3, 0.3, 11.4, "driving", "none", 0))
    assert robot.odometry == pytest.approx(robot.reckoning.pose)
    assert robot.snapshot().mice is None


def options_with(mice: int) -> LiveOptions:
    """Options of a robot whose settings tell where so many mice sit."""
    places = {"mice": {"mice": [{"x": 0.1 * number} for number in range(mice)]}} if mice else {}
    return LiveOptions(load({"maze_runner": places}), "maze_runner")


@pytest.mark.parametrize(
    ("given", "known", "remedy"),
    [(2, 0, "where 0 sit"), (0, 2, "given 0 times"), (1, 2, "where 2 sit"), (9, 2, "give 8 at most")],
)
def test_mice_are_served_only_where_the_settings_tell_where_they_sit(given, known, remedy):
    with pytest.raises(UserError, match=remedy):
        check_mouse_lines(options_with(known), given)


def test_as_many_mice_as_the_settings_tell_of_are_served():
    check_mouse_lines(options_with(2), 2)
    check_mouse_lines(options_with(0), 0)
    check_mouse_lines(LiveOptions(Config(), "crunch"), 0)
    with pytest.raises(UserError, match="leave out --mouse"):
        check_mouse_lines(LiveOptions(Config(), "crunch"), 1)


def test_a_misspelt_key_of_the_mice_is_named_with_the_nearest():
    with pytest.raises(ConfigError, match=r"maze_runner\.mice\.gaet.*did you mean `maze_runner\.mice\.gate`"):
        load(assignments=["maze_runner.mice.gaet=2.0"])
