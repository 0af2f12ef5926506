"""The firmware's own balance law on the nonlinear body: it stands, drives, survives, and falls only when it must."""

import numpy as np
import pytest

from firmware.virtual import VirtualCrunch, World
from tests.firmware.virtual_wire import (
    BALANCE,
    ODOMETRY,
    arm_command,
    drive_for,
    newest_time,
    payloads,
    room,
    stop_command,
)

FALLEN, FAULT = 2, 4
FELL, STALL, LIFTED, DISAGREEMENT = 2, 4, 11, 12


def motion_of(robot, seconds, step=0.02):
    """Largest lean and distance from where it stood while time passes."""
    start = robot.pose
    leans, ways = [], []
    for _ in range(round(seconds / step)):
        robot.advance(step)
        leans.append(abs(robot.tilt))
        ways.append(np.hypot(*(robot.pose - start)[:2]))
    return max(leans), max(ways)


@pytest.mark.parametrize("seed", range(4))
def test_it_stands_for_a_minute(seed):
    robot = VirtualCrunch(room(4, 4), seed=seed)
    lean, way = motion_of(robot, 60.0)
    assert lean < 0.03
    assert way < 0.06
    assert robot.state == "link_lost"  # nobody told it anything, and it kept its balance


@pytest.mark.parametrize("newtons", [-8.0, 4.0, 8.0])
def test_it_recovers_from_pushes(newtons, build):
    robot = VirtualCrunch(room(6, 6), seed=1, build=build)
    robot.advance(2.0)
    robot.push(newtons)
    robot.advance(0.2)
    robot.push(0.0)
    lean, way = motion_of(robot, 10.0)
    assert 0.03 < lean < 0.5
    assert way < 0.8
    lean, way = motion_of(robot, 5.0)
    assert lean < 0.03
    assert np.hypot(*robot.pose[:2]) < 0.3


@pytest.mark.parametrize("speed", [0.15, 0.3, 0.45, -0.2])
def test_it_drives_three_metres_at_the_commanded_speed(speed):
    robot = VirtualCrunch(room(12, 4), start=(-4.0 if speed > 0 else 4.0, 0, 0), seed=2, drift="none")
    begin = robot.pose[0]
    drive_for(robot, 3.0 / abs(speed), speed)
    assert robot.pose[0] - begin == pytest.approx(3.0 * np.sign(speed), abs=0.35)  # it leans before it goes
    _, poses = robot.truth()
    steady = poses[-100:, 0]
    assert (steady[-1] - steady[0]) / (99 * 0.02) == pytest.approx(speed, rel=0.1)
    assert abs(robot.pose[1]) < 0.05


def test_it_turns_as_commanded_without_leaving_its_place(build):
    robot = VirtualCrunch(room(4, 4), seed=3, drift="none", build=build)
    drive_for(robot, 5.0, 0.0, 1.0)
    _, poses = robot.truth()
    assert np.unwrap(poses[:, 2])[-1] == pytest.approx(5.0, abs=0.3)
    assert np.hypot(*poses[:, :2].T).max() < 0.08


def test_it_stops_when_commands_cease_and_stays_up(build):
    robot = VirtualCrunch(room(12, 4), start=(-4, 0, 0), seed=4, drift="none", build=build)
    drive_for(robot, 6.0, 0.4)
    robot.advance(0.45)
    assert robot.state == "link_lost"
    robot.advance(3.0)
    lean, way = motion_of(robot, 20.0)
    assert lean < 0.05
    assert way < 0.08


def test_a_stop_command_stops_it_at_once(build):
    robot = VirtualCrunch(room(12, 4), start=(-4, 0, 0), seed=4, drift="none", build=build)
    drive_for(robot, 6.0, 0.4)
    place = robot.pose[0]
    robot.write(stop_command())
    robot.advance(3.0)
    assert abs(robot.pose[0] - place) < 0.5
    assert motion_of(robot, 5.0)[1] < 0.08


def thrown(seed, newtons, build):
    """A robot after a blow of 0.3 s that no gain stands, and its last words."""
    robot = VirtualCrunch(room(6, 6), seed=seed, build=build)
    robot.advance(1.0)
    robot.push(newtons)
    robot.advance(0.3)
    robot.push(0.0)
    *_, left, right, state, reason, _ = payloads(robot.advance(3.0), BALANCE)[-1]
    return robot, (left, right), state, reason


def assert_latched(robot):
    state = robot.state
    drive_for(robot, 2.0, 0.3)
    assert robot.state == state
    assert abs(robot.tilt) > 1.0


def test_a_fall_switches_off_and_is_latched(build):
    robot, duties, state, reason = thrown(5, 40.0, build)
    assert (duties, state, reason) == ((0, 0), FALLEN, FELL)
    assert robot.state == "fallen"
    assert_latched(robot)


@pytest.mark.parametrize("newtons", [20.0, 25.0, 60.0])
def test_a_blow_that_throws_it_ends_in_a_stop_with_what_was_noticed_first(newtons):
    """Before it leans far enough for a fall the motors are at their limit, or wheels and body tell two motions."""
    for seed in range(1, 7):
        robot, duties, state, reason = thrown(seed, newtons, "host")
        assert duties == (0, 0)
        assert (state, reason) in {(FALLEN, FELL), (FAULT, STALL), (FAULT, LIFTED), (FAULT, DISAGREEMENT)}
        assert_latched(robot)


def test_picked_up_and_armed_again_it_balances(build):
    robot = VirtualCrunch(room(6, 6), seed=5, build=build)
    robot.push(60.0)
    robot.advance(0.4)
    robot.push(0.0)
    robot.advance(2.0)
    assert robot.state == "fallen"
    robot.pick_up()
    robot.write(arm_command(1, newest_time(robot.advance(0.5))))
    robot.advance(4.0)
    assert motion_of(robot, 10.0)[0] < 0.05
    assert robot.state == "link_lost"


def test_the_estimated_tilt_tracks_the_true_one(build):
    robot = VirtualCrunch(room(12, 6), start=(-4, 0, 0), seed=6, drift="medium", build=build)
    errors = []
    rng = np.random.default_rng(1)
    for _ in range(40):
        speed, turn = rng.uniform(-0.3, 0.35), rng.uniform(-0.5, 0.5)
        data = drive_for(robot, 0.5, speed, turn)
        estimate = payloads(data, ODOMETRY)[-1][2] * 1e-4
        errors.append(estimate - robot.tilt)
    assert np.max(np.abs(errors)) < 0.05
    assert np.std(errors) < 0.02


def test_walls_stop_it_and_it_does_not_fall(build):
    robot = VirtualCrunch(room(2.0, 2.0), seed=7, drift="none", build=build)
    drive_for(robot, 10.0, 0.4)
    assert robot.pose[0] == pytest.approx(1.0 - 0.076, abs=0.02)
    assert robot.state == "armed"
    robot.advance(5.0)
    assert robot.state == "link_lost"
    assert abs(robot.tilt) < 0.2


@pytest.mark.parametrize("heading", [0.3, 0.8, 1.3, 2.9])
def test_no_heading_gets_it_through_a_wall(heading):
    robot = VirtualCrunch(room(1.2, 1.2), start=(0, 0, heading), seed=8, drift="high")
    rng = np.random.default_rng(round(heading * 10))
    for _ in range(30):
        drive_for(robot, 0.5, rng.uniform(-0.5, 0.5), rng.uniform(-2.0, 2.0))
    _, poses = robot.truth()
    assert np.abs(poses[:, :2]).max() < 0.6 - 0.06


def test_drift_does_not_disturb_the_balance():
    for seed in range(6):
        robot = VirtualCrunch(World(np.empty((0, 4))), seed=seed, drift="high")
        leans = []
        for _ in range(20):
            drive_for(robot, 0.5, 0.3)
            leans.append(abs(robot.tilt))
        assert max(leans) < 0.25
        assert robot.state == "armed"
