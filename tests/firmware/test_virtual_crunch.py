"""The virtual robot's two ends: the bytes it says, the commands it obeys, and the truth it knows."""

import hashlib
import struct
from collections import Counter

import numpy as np
import pytest

from firmware.virtual import Plan, Radio, VirtualCrunch, corridor_cycle, corridor_plan, load_plan, load_world
from server.link import Decoder, encode
from tests.firmware.virtual_wire import (
    BALANCE,
    DRIVE,
    INFRARED,
    METRES_PER_TICK,
    ODOMETRY,
    POWER,
    SENSOR,
    SONAR,
    STATUS,
    arm_command,
    drive_command,
    drive_for,
    frames,
    newest_time,
    payloads,
    room,
    stop_command,
)


def test_rates_and_bandwidth_are_as_promised(build):
    robot = VirtualCrunch(room(4, 4), seed=1, build=build)
    data = robot.advance(20.0)
    counts = Counter((f.source, f.channel) for f in frames(data))
    assert counts[DRIVE, ODOMETRY] == 1000
    assert counts[SENSOR, INFRARED] == 500
    assert counts[SENSOR, SONAR] == 250
    assert counts[DRIVE, BALANCE] == pytest.approx(41, abs=1)
    assert counts[DRIVE, POWER] == counts[DRIVE, STATUS] == counts[SENSOR, STATUS] == 20
    assert len(data) / 20.0 < 1920 - 180  # leaves room for commands at 10 Hz in half of the line
    decoder = Decoder()
    decoder.feed(data)
    assert decoder.rejected == 0


def test_sequences_count_per_board_and_times_keep_their_step(build):
    robot = VirtualCrunch(room(4, 4), seed=1, build=build)
    said = frames(robot.advance(70.0))  # across the 16-bit clock's wrap
    for source in (DRIVE, SENSOR):
        sequence = [f.sequence for f in said if f.source == source]
        assert set(np.diff(sequence) % 256) == {1}
    for channel, step in ((ODOMETRY, 20), (SONAR, 80), (INFRARED, 40)):
        times = [f.time_ms for f in said if f.channel == channel]
        assert set(np.diff(times) % 65536) == {step}


def test_truth_has_one_pose_for_every_odometry_frame(build):
    robot = VirtualCrunch(room(6, 6), seed=2, plan=Plan.through(np.array([[-2, -2], [2, -2], [2, 2]])), build=build)
    data = robot.advance(12.34)
    times, poses = robot.truth()
    ticks = [f.time_ms for f in frames(data) if f.channel == ODOMETRY]
    assert len(times) == len(poses) == len(ticks)
    assert times[0] == 0.0
    np.testing.assert_allclose(np.diff(times), 0.02, atol=1e-9)
    np.testing.assert_allclose((np.array(ticks) - ticks[0]) % 65536 / 1000, times, atol=1e-9)
    assert poses[0] == pytest.approx(robot.driver.plan.start if robot.driver else 0, abs=1e-3)
    assert np.hypot(*(poses[-1] - robot.pose)[:2]) < 0.02


@pytest.mark.parametrize("steps", [[10.0], [0.02] * 500, [0.0137] * 729 + [0.0127]])
def test_time_passes_the_same_in_any_portions(steps, build):
    """Without a driver nothing depends on how the caller slices time."""
    robot = VirtualCrunch(room(4, 4), seed=3, build=build)
    data = b"".join(robot.advance(step) for step in steps)
    assert robot.time == pytest.approx(10.0, abs=1e-3)
    whole = VirtualCrunch(room(4, 4), seed=3, build=build).advance(10.0)
    assert data[: len(whole) - 100] == whole[: len(whole) - 100]


def test_the_same_seed_says_the_same_bytes(build):
    def digest(seed):
        radio = Radio(chunk_loss=0.05, bit_error_rate=1e-5)
        robot = VirtualCrunch(corridor_cycle(1), seed=seed, radio=radio, plan=corridor_plan(1), build=build)
        return hashlib.sha256(robot.advance(20.0)).hexdigest(), robot.pose.tolist()

    assert digest(7) == digest(7) != digest(8)


def test_ticks_times_radius_is_the_distance_without_drift(build):
    robot = VirtualCrunch(room(12, 4), start=(-4, 0, 0), seed=4, drift="none", build=build)
    data = drive_for(robot, 10.0, 0.3) + robot.advance(4.0)
    left, right, tilt = payloads(data, ODOMETRY).T
    _, poses = robot.truth()
    rolled = np.cumsum(np.diff(np.unwrap((left + right) / 2, period=65536), prepend=(left + right)[0] / 2))
    measured = rolled * METRES_PER_TICK + 0.0508 * tilt * 1e-4
    true = poses[:, 0] - poses[0, 0]
    assert np.abs(measured - true).max() < 0.004  # a tick is 0.3 mm; 0.02 rad of tilt error are 1 mm
    assert np.abs((right - left) * METRES_PER_TICK / 0.19 - poses[:, 2]).max() < 0.01


def test_drift_makes_the_ticks_lie():
    robot = VirtualCrunch(corridor_cycle(1), seed=5, drift="high", plan=corridor_plan(1))
    data = robot.advance(60.0)
    left, right, _ = payloads(data, ODOMETRY).T
    _, poses = robot.truth()
    heading = np.unwrap(right - left, period=65536) * METRES_PER_TICK / 0.19
    assert np.abs(heading - heading[0] - np.unwrap(poses[:, 2]) + poses[0, 2]).max() > 0.05


def test_sonar_and_infrared_see_the_room(build):
    robot = VirtualCrunch(room(1.4, 2.0), seed=6, build=build)
    data = robot.advance(8.0)
    echoes = payloads(data, SONAR)[:, [0, 2, 4, 6]].astype(float)
    echoes[echoes == 0xFFFF] = np.nan
    assert np.nanmedian(echoes, axis=0) * 343e-6 / 2 == pytest.approx([0.63, 0.93, 0.63, 0.93], abs=0.03)
    counts = np.median(payloads(data, INFRARED)[:, [0, 4]], axis=0)
    assert 6787 / (counts - 3) - 4 == pytest.approx([65.0, 65.0], abs=3.0)


def test_a_host_drives_and_its_commands_are_acknowledged(build):
    robot = VirtualCrunch(room(8, 8), seed=7, drift="none", build=build)
    said = drive_for(robot, 5.0, 0.2, 0.0)
    assert robot.state == "armed"
    assert payloads(said, BALANCE)[-1][-1] > 40
    assert robot.pose[0] > 0.6


@pytest.mark.parametrize("spoiled", ["stale", "forged", "cut"])
def test_refused_commands_do_not_move_it_and_are_counted(spoiled, build):
    robot = VirtualCrunch(room(8, 8), seed=8, build=build)
    echo = newest_time(robot.advance(2.0))
    for i in range(30):
        now = echo + 100 * i
        command = drive_command(0.5, 0.0, now - (3000 if spoiled == "stale" else 0), i)
        if spoiled == "forged":  # the frame's own checksum is right, the command's is not
            frame = frames(command)[0]
            command = encode(frame._replace(payload=frame.payload[:-1] + bytes([frame.payload[-1] ^ 1])))
        elif spoiled == "cut":
            command = command[: len(command) // 2] + b"\0"
        robot.write(command)
        data = robot.advance(0.1)
    assert np.hypot(*robot.pose[:2]) < 0.1
    assert robot.state == "link_lost"
    data = robot.advance(1.0)
    errors = [
        struct.unpack("<BBBBIHHHH", f.payload)[7] for f in frames(data) if (f.source, f.channel) == (DRIVE, STATUS)
    ]
    assert errors[-1] == 30


def test_the_host_takes_the_wheel_for_three_seconds(build):
    plan = Plan.through(np.array([[-3, 0], [3, 0]]))
    robot = VirtualCrunch(room(8, 4), seed=9, drift="none", plan=plan, build=build)
    robot.advance(5.0)
    before = robot.pose[0]
    drive_for(robot, 2.0, -0.2)
    robot.advance(2.0)
    assert robot.pose[0] < before + 0.25  # it waits
    robot.advance(30.0)
    assert robot.pose[0] > 2.5
    assert robot.finished


def test_a_stop_holds_the_plan_until_somebody_drives_again(build):
    plan = Plan.through(np.array([[-3, 0], [3, 0]]))
    robot = VirtualCrunch(room(8, 4), seed=9, drift="none", plan=plan, build=build)
    robot.advance(5.0)
    robot.write(stop_command())
    robot.advance(3.0)
    stopped = robot.pose[0]
    data = robot.advance(10.0)
    assert robot.pose[0] == pytest.approx(stopped, abs=0.1)
    robot.write(arm_command(1, newest_time(data)))
    robot.advance(5.0)
    assert robot.pose[0] > stopped + 0.8


def test_autopilot_can_be_switched_off(build):
    robot = VirtualCrunch(room(8, 4), seed=9, plan=Plan.through(np.array([[-3, 0], [3, 0]])), build=build)
    robot.autopilot = False
    robot.advance(5.0)
    assert robot.pose[0] == pytest.approx(-3.0, abs=0.1)


def test_a_disarmed_robot_is_held_until_it_is_armed(build):
    robot = VirtualCrunch(room(4, 4), seed=10, armed=False, build=build)
    data = robot.advance(3.0)
    assert robot.state == "disarmed"
    assert abs(robot.tilt) < 0.004  # as the hand sways
    robot.write(arm_command(1, newest_time(data)))
    robot.advance(0.2)
    assert robot.state == "disarmed"
    robot.advance(3.0)
    assert robot.state in ("armed", "link_lost")
    assert abs(robot.tilt) < 0.05


def test_commands_get_through_a_radio(build):
    radio = Radio(latency=0.06, chunk_loss=0.05, bit_error_rate=1e-5)
    robot = VirtualCrunch(room(10, 4), start=(-3, 0, 0), seed=11, drift="none", radio=radio, build=build)
    decoder, echo, good = Decoder(), 0, 0
    for i in range(100):
        robot.write(drive_command(0.3, 0.0, echo, i))
        for frame in decoder.feed(robot.advance(0.1)):
            echo = frame.time_ms if frame.source == DRIVE else echo
            good += 1
    assert robot.pose[0] > -1.0
    assert 0.85 * 90 < good / 10.0 < 0.99 * 103
    assert decoder.rejected > 0


def test_the_battery_sags_under_load_and_runs_down():
    robot = VirtualCrunch(corridor_cycle(1), seed=12, plan=corridor_plan(1))
    power = payloads(robot.advance(120.0), POWER)
    assert 29000 < power[-1][0] < power[0][0] < 34000
    assert np.all(power[:, 1] > 300)
    assert np.any(np.abs(power[:, 4:]) > 50)


def test_the_demo_tour_ends_where_it_should():
    plan = load_plan("demo")
    robot = VirtualCrunch(load_world("demo"), seed=13, plan=plan)
    while not robot.finished and robot.time < 700.0:
        robot.advance(1.0)
    assert robot.finished
    _, poses = robot.truth()
    assert load_world("demo").clearances(poses[:, :2], 2.0).min() > 0.2
    assert robot.pose[:2] == pytest.approx(plan.points[-1], abs=0.15)


def test_mistakes_are_named():
    with pytest.raises(ValueError, match="no drift 'huge'; known are none, low, medium, high"):
        VirtualCrunch(room(4, 4), drift="huge")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="time does not run backwards"):
        VirtualCrunch(room(4, 4)).advance(-1.0)
