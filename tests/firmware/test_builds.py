"""Both builds of the boards are one robot: they drive alike, they are chosen by one flag, what they need is told."""

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from firmware.virtual import Plan, VirtualCrunch, corridor_cycle, corridor_plan
from firmware.virtual.__main__ import main
from firmware.virtual.avr.programs import programs
from firmware.virtual.pace import LEAST_SHARE, NAP, WINDOW, Pace
from tests.firmware.avr_tools import need_simavr
from tests.firmware.virtual_wire import ODOMETRY, arm_command, drive_for, frames, newest_time, room


def both(**kind):
    need_simavr()
    return VirtualCrunch(build="host", **kind), VirtualCrunch(build="avr", **kind)


def degrees(a, b):
    return abs(np.degrees((a - b + np.pi) % (2.0 * np.pi) - np.pi))


def test_the_same_seed_drives_the_same_way_on_both():
    """The real board hears the plan 7 ms later and ten times a second, samples within a ms, and has 800 duties."""
    robots = both(world=corridor_cycle(2), seed=2, drift="medium", plan=corridor_plan(2))
    for robot in robots:
        robot.advance(20.0)
    (_, host), (_, avr) = (robot.truth() for robot in robots)
    assert len(host) == len(avr) == 1000
    assert np.hypot(*(host - avr)[:, :2].T).max() < 0.01
    assert max(degrees(*headings) for headings in zip(host[:, 2], avr[:, 2], strict=True)) < 0.5


def test_both_recover_alike_from_the_same_push():
    leans = []
    for robot in both(world=room(6, 6), seed=1):
        robot.advance(1.0)
        robot.push(8.0)
        robot.advance(0.2)
        robot.push(0.0)
        leans.append([abs(robot.tilt) for _ in range(200) if robot.advance(0.01) is not None])
    assert max(leans[0]) == pytest.approx(max(leans[1]), rel=0.05)


def test_who_drives_a_plan_beside_the_radio_harms_no_frame_of_the_host_s():
    """What the host sends while the plan commands is obeyed as if nobody else were there, and what was cut is over."""
    need_simavr()
    robot = VirtualCrunch(
        room(12, 4), start=(-5, 0, 0), seed=1, plan=Plan.through(np.array([[-5, 0], [5, 0]])), build="avr"
    )
    robot.advance(4.0)
    before = robot.pose[0]
    robot.write(b"\x07cut")
    robot.advance(0.5)
    assert robot.pose[0] > before + 0.05
    drive_for(robot, 2.0, -0.3)
    assert robot.boards.accepted[0] == 20
    assert robot.pose[0] < before


def test_the_truth_goes_on_when_the_drive_board_begins_anew():
    need_simavr()
    robot = VirtualCrunch(room(4, 4), seed=1, build="avr")
    robot.advance(1.0)
    boards: Any = robot.boards
    boards.lib.microcontroller_hang(boards.robot.drive, True)
    robot.advance(0.5)
    assert robot.state == "disarmed"
    robot.pick_up()
    robot.write(arm_command(1, newest_time(robot.advance(0.5))))
    told = robot.advance(4.0)
    assert robot.state in ("armed", "link_lost")
    times, poses = robot.truth()
    assert np.all(np.diff(times) > 0.0)
    assert times[-1] == pytest.approx(robot.time, abs=0.05)
    assert np.hypot(*(poses[-1] - robot.pose)[:2]) < 0.01
    heard = sum(frame.channel == ODOMETRY for frame in frames(told))
    assert abs(heard - np.sum(times > 2.0)) <= 1, "one may be under way as it begins"


def test_a_machine_without_the_tools_is_told_what_to_install(monkeypatch, capsys):
    monkeypatch.setenv("PATH", "/nonexistent")
    programs.cache_clear()
    assert main(["--avr", "--tcp", "127.0.0.1:0"]) == 2
    error = capsys.readouterr().err
    assert "no avr-gcc or no make here" in error
    assert "apt-get install gcc-avr avr-libc make libsimavr-dev" in error
    assert error.count("\n") == 1


def test_a_machine_without_simavr_is_told_what_to_install(tmp_path, monkeypatch):
    need_simavr()
    refusing = tmp_path / "cc"
    refusing.write_text(
        '#!/bin/sh\ncase "$*" in *avr/microcontroller.c*) echo "fatal error: no simavr/avr_adc.h" >&2; exit 1;; esac\n'
        'exec cc "$@"\n'
    )
    refusing.chmod(0o755)
    monkeypatch.setenv("CC", str(refusing))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    command = [sys.executable, "-m", "server", "simulate", "--avr", "--out", str(tmp_path / "a.rlog")]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    assert told.returncode == 2
    assert "simavr is needed (Debian/Ubuntu: apt-get install gcc-avr avr-libc make libsimavr-dev)" in told.stderr
    assert told.stderr.count("\n") == 1


def test_an_unknown_build_is_told():
    with pytest.raises(ValueError, match="no build 'arm' of the boards; known are host, avr"):
        VirtualCrunch(room(4, 4), build="arm")  # pyright: ignore[reportArgumentType]


def test_a_machine_that_is_too_slow_is_told_once_and_until_it_is_not():
    pace, beat = Pace(), 0.05
    beats = round(WINDOW / beat) + 1
    assert not any(pace.note(beat, 0.0) for _ in range(beats))
    assert sum(pace.note(beat, 0.4 * beat) for _ in range(2 * beats)) == 1
    assert "too slow" in pace.complaint
    assert "0.60 s" in pace.complaint
    assert not any(pace.note(beat, 0.5 * (1.0 - LEAST_SHARE) * beat) for _ in range(beats))
    assert pace.complaint == ""
    assert not pace.note(NAP + 1000.0, 1000.0)  # the machine slept
    assert pace.complaint == ""
