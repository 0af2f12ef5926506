"""Hazards of the supervisor's table, inflicted on the real drive board: what it does, how soon, and why."""

import numpy as np
import pytest

from firmware.virtual import Radio
from tests.firmware.avr_robot import ARMED, DISARMED, FALLEN, FAULT, LINK_LOST, Driven
from tests.firmware.virtual_wire import DRIVE, arm_command, drive_command, frames, newest_time, stop_command

COMMAND, FELL, LINK, STALL, CURRENT, BATTERY, SENSOR_DEAD, CHARGER = range(1, 9)
GYRO, ACCELEROMETER, BATTERY_INPUT, LEFT_MOTOR = 0, 1, 3, 6


def ms_until_off(driven, patience=1000):
    """How long the motors stay on, ms."""
    for ms in range(patience):
        if driven.robot.is_off:
            return ms
        driven.said += driven.robot.advance(0.001)
    return patience


def told(driven):
    """(state, reason) as told within half a second."""
    driven.wait(0.6)
    return tuple(driven.balance()[4:6])


def test_nothing_moves_before_it_is_armed():
    driven = Driven()
    for _ in range(150):
        driven.wait(0.02)
        assert driven.robot.is_off
    assert driven.balance()[4] == DISARMED
    driven.drive(1.0, 0.3)
    assert driven.robot.is_off


def test_a_fall_switches_off_and_is_latched():
    driven = Driven().stand()
    driven.robot.push(60.0)
    while abs(driven.robot.tilt) < 0.7 and not driven.robot.is_off:
        driven.said += driven.robot.advance(0.001)
    assert ms_until_off(driven) <= 25  # at its end of 2.6 rad/s the gyro is late
    assert told(driven) == (FALLEN, FELL)
    driven.drive(1.0, 0.3)
    assert driven.robot.is_off


def test_without_commands_it_stops_and_goes_on_balancing():
    driven = Driven(width=12.0, start=(-5.0, 0.0, 0.0)).stand()
    driven.drive(4.0, 0.4)
    assert driven.balance()[4] == ARMED
    driven.wait(0.45)
    assert tuple(driven.balance()[4:6]) == (LINK_LOST, LINK)
    driven.wait(3.0)
    place = driven.robot.pose[0]
    driven.wait(3.0)
    assert abs(driven.robot.pose[0] - place) < 0.1
    assert not driven.robot.is_off


@pytest.mark.parametrize(
    ("channel", "volts", "reason", "limit_ms"),
    [(LEFT_MOTOR, 4.5, CURRENT, 40), (ACCELEROMETER, 0.0, SENSOR_DEAD, 120), (GYRO, 0.0, None, 120)],
    ids=["over-current", "accelerometer dead", "gyro dead"],
)
def test_a_dead_sensor_or_a_short_circuit_ends_it(channel, volts, reason, limit_ms):
    driven = Driven().stand()
    driven.robot.force(channel, volts)
    assert ms_until_off(driven) <= limit_ms
    state, why = told(driven)
    if reason is None:  # a gyro at its rail makes it throw itself over: either name is true
        assert (state, why) in ((FALLEN, FELL), (FAULT, SENSOR_DEAD))
    else:
        assert (state, why) == (FAULT, reason)


@pytest.mark.parametrize("hazard", ["battery low", "charger in"])
def test_it_stands_but_goes_nowhere(hazard):
    driven = Driven().stand()
    if hazard == "battery low":
        driven.robot.force(BATTERY_INPUT, 23.5 / 8.0)
    else:
        driven.robot.robot.charger_volts = 30.0
    driven.drive(3.0, 0.3)
    assert np.hypot(*driven.robot.pose[:2]) < 0.1
    assert tuple(driven.balance()[4:6]) == (ARMED, BATTERY if hazard == "battery low" else CHARGER)


def test_a_disarm_and_a_stop_are_obeyed_however_late():
    driven = Driven(width=8.0).stand()
    driven.drive(2.0, 0.3)
    driven.robot.write(stop_command(echo_ms=0))
    driven.wait(0.6)
    assert driven.balance()[5] in (COMMAND, LINK)
    driven.robot.write(arm_command(0, 0))
    driven.wait(0.05)
    assert driven.robot.is_off


def test_stale_and_spoiled_commands_move_nothing_and_are_counted():
    driven = Driven().stand()
    for i in range(10):
        command = drive_command(0.4, 0.0, newest_time(driven.said) - 2000, i)
        driven.robot.write(command)
        driven.robot.write(command[:2] + bytes([command[2] % 255 + 1]) + command[3:])
        driven.wait(0.1)
    driven.wait(1.1)
    assert np.hypot(*driven.robot.pose[:2]) < 0.1
    assert driven.status(DRIVE)[7] == 20


def test_both_boards_reset_at_once_find_their_turns_again():
    driven = Driven().stand()
    lib, robot = driven.robot.lib, driven.robot.robot
    lib.microcontroller_hang(robot.drive)
    lib.microcontroller_hang(robot.sensor)
    driven.wait(4.0)
    assert lib.microcontroller_resets(robot.drive) == lib.microcontroller_resets(robot.sensor) == 2
    assert driven.robot.collisions == 0
    assert driven.robot.is_off


def test_over_a_bad_radio_it_balances_and_obeys_only_what_was_sent():
    radio = Radio(latency=0.2, chunk_loss=0.3, bit_error_rate=1e-3)
    driven = Driven(width=16.0, start=(-6.0, 0.0, 0.0), radio=radio)
    driven.wait(1.0)
    for _ in range(20):  # an arm command in three gets through
        driven.robot.write(arm_command(1, newest_time(driven.said)))
        driven.wait(0.2)
    assert not driven.robot.is_off
    driven.poses.clear()
    driven.leans.clear()
    driven.drive(20.0, 0.3)
    steps = np.diff([pose[0] for pose in driven.poses])
    assert driven.robot.pose[0] > -6.0 + 2.0  # commands older than a second, or lost ones, cost way
    assert np.mean(steps[-250:]) / 0.02 < 0.33
    assert abs(driven.robot.pose[1]) < 0.1 + 0.1 * (driven.robot.pose[0] + 6.0)
    assert max(driven.leans) < 0.2
    assert driven.robot.collisions == 0
    assert 0.3 < len(frames(driven.said)) / (90 * driven.robot.time) < 0.9
