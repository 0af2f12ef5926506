"""Hazards inflicted on the real boards: what they do, how soon, and the reason that they tell."""

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bench import safety
from bench.benchmark import Row
from bench.boards import Rider, hall
from bench.hazards import FALLEN_TILT, HAZARDS, LOST_TILT, off_beyond, suffer
from firmware.virtual import Radio
from server.commands import ArmCommand
from tests.firmware.avr_robot import Driven
from tests.firmware.avr_tools import need_simavr
from tests.firmware.virtual_wire import DRIVE, arm_command, drive_command, frames, newest_time, stop_command

COMMAND = 1
ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("hazard", HAZARDS, ids=lambda hazard: hazard.name)
def test_every_row_of_the_safety_table_is_kept_in_time_and_told(hazard):
    need_simavr()
    suffered = suffer(hazard, seed=1)
    assert suffered["is_right"], suffered


@pytest.mark.parametrize(
    ("sound", "broken", "names"),
    [
        ("FALL_TILT 0.7f", "FALL_TILT 3.0f", ["tipped over by a hand", "tipped over backward"]),
        ("LOST_TILT 0.25f", "LOST_TILT 0.5f", ["a hard shove", "a shove", "a shove from before"]),
        ("LINK_MS 400", "LINK_MS 1700", ["link given up"]),
    ],
    ids=["no fall", "late fall", "late link"],
)
def test_a_broken_rule_breaks_its_rows(sound, broken, names, tmp_path):
    need_simavr()
    for folder in ("bench", "server", "slam", "firmware"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    header = tmp_path / "firmware" / "drive" / "supervisor.h"
    assert sound in header.read_text()
    header.write_text(header.read_text().replace(sound, broken))
    script = f"from bench.safety import run; print([run(name, 1) for name in {names}])"
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    records = ast.literal_eval(done.stdout)
    assert not any(record["is_right"] for record in records), records
    rows = [Row(name, [record]) for name, record in zip(names, records, strict=True)]
    told = [f"{name}: not as it should be with the seeds 1" for name in names]
    assert list(safety.verdict([*rows, Row("kept", [{"seed": 0, "is_right": True}])])) == told


@pytest.mark.parametrize("tilt", [LOST_TILT, FALLEN_TILT])
def test_motors_that_another_rule_has_switched_off_are_no_fall(tilt):
    need_simavr()
    rider = Rider(hall(12.0), (0.0, 0.0, 0.0), 1)
    assert rider.arm()
    rider.wait(0.5)
    rider.send(ArmCommand(False))
    while not rider.is_off:
        rider.live(1)
    assert off_beyond(tilt)(rider) is None
    rider.wait(2.0)  # it lies on the floor
    assert off_beyond(tilt)(rider) == 0


def test_a_disarm_and_a_stop_are_obeyed_however_late():
    driven = Driven(width=8.0).stand()
    driven.drive(2.0, 0.3)
    for _ in range(6):  # a balance frame comes twice a second
        driven.robot.write(stop_command(echo_ms=0))
        driven.wait(0.1)
    assert driven.balance()[5] == COMMAND
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
    lib.microcontroller_hang(robot.drive, True)
    lib.microcontroller_hang(robot.sensor, True)
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
