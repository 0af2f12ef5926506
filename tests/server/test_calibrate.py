"""`crunch calibrate odometry`: a table and settings that load, the same every time, and one line for every mistake."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from server.config import load
from server.odometry_calibration import Calibration, Drive, Row
from tests.server.logs import write_room_log
from tests.server.test_cli import Outcome, assert_mendable, crunch  # noqa: F401

MOTION = load({}).crunch.filter.motion
FEW = ("--particles", "200", "--beams", "31", "--max-range", "4")


@pytest.fixture
def room(tmp_path) -> Path:
    """A log that goes round a room four times."""
    write_room_log(tmp_path / "room.log", laps=4, turn_bias=0.001)
    return tmp_path / "room.log"


def test_a_table_and_settings_come_out_and_load(crunch, room, tmp_path):  # noqa: F811
    outcome: Outcome = crunch("calibrate", "odometry", room, *FEW, "--output", "learned.toml")
    assert (outcome.code, outcome.err) == (0, "")
    for name in ("turn_noise", "distance_noise", "rotation_noise", "turn_bias", "room.log", "95 %"):
        assert name in outcome.out
    assert outcome.out.endswith("learned.toml: written\n")
    text = (tmp_path / "learned.toml").read_text()
    learned = tomllib.loads(text)["crunch"]["filter"]["motion"]
    assert set(learned) == {"turn_noise", "distance_noise", "rotation_noise", "turn_bias"}
    motion = load({}, tmp_path / "learned.toml").crunch.filter.motion
    assert motion.model_dump() == MOTION.model_dump() | learned
    assert crunch("replay", room, "--out", "m", "--config", "learned.toml", *FEW).code == 0
    printed = crunch("calibrate", "odometry", room, *FEW)
    assert printed.out.endswith(text), "without --output the settings are printed"
    assert crunch("calibrate", "odometry", room, *FEW, "--quiet").out == ""


def test_mistakes_are_one_line(crunch, room, tmp_path):  # noqa: F811
    write_room_log(tmp_path / "once.log", laps=1)
    write_room_log(tmp_path / "short.log", laps=4)
    lines = (tmp_path / "short.log").read_text().splitlines(keepends=True)
    (tmp_path / "short.log").write_text("".join(lines[:40]))
    calibrate = ("calibrate", "odometry")
    told = "nothing is learned, the present values stay"
    assert_mendable(crunch(*calibrate, "once.log", *FEW, "--output", "o.toml"), told)
    assert not (tmp_path / "o.toml").exists()
    assert_mendable(crunch(*calibrate, "short.log", *FEW), "short.log: is too short")
    assert_mendable(crunch(*calibrate, room, room), "is named twice")
    assert_mendable(crunch(*calibrate, "missing.log"), "missing.log: no such file")
    assert_mendable(crunch(*calibrate), "Missing argument")
    assert_mendable(crunch(*calibrate, room, "--max-range", "4"), "add --beams N")
    assert_mendable(crunch(*calibrate, room, "--robot", "krunch"), "robot `krunch` is unknown")
    assert crunch("simulate", "--out", "drive.rlog", "--duration", "6").code == 0
    assert_mendable(crunch(*calibrate, room, "drive.rlog"), "drive.rlog: is not of the robot of", "kind of log")
    (tmp_path / "wide.toml").write_text("[crunch]\ntrack = 0.25\n")
    assert crunch("simulate", "--out", "wide.rlog", "--duration", "6", "--config", "wide.toml").code == 0
    assert_mendable(crunch(*calibrate, "drive.rlog", "wide.rlog"), "wide.rlog: is not of", "`crunch.track`")
    whole = (tmp_path / "drive.rlog").read_bytes()
    (tmp_path / "cut.rlog").write_bytes(whole[:40])
    assert_mendable(crunch(*calibrate, "cut.rlog"), "cut.rlog", "header")


def test_recordings_say_whose_odometry_is_learned(crunch):  # noqa: F811
    maze = ("simulate", "--robot", "maze_runner", "--world", "maze:small:1", "--duration", "25", "--out", "maze.rlog")
    assert crunch(*maze).code == 0
    outcome = crunch("calibrate", "odometry", "maze.rlog")
    assert outcome.code == 0, outcome.err
    assert "[maze_runner.odometry.motion.odometry]" in outcome.out
    assert outcome == crunch("calibrate", "odometry", "maze.rlog", "--robot", "maze_runner")
    assert crunch("simulate", "--out", "drive.rlog", "--duration", "2").code == 0
    for logs in (("drive.rlog", "maze.rlog"), ("maze.rlog", "drive.rlog")):
        told = "of several robots: drive.rlog of crunch, maze.rlog of maze_runner"
        assert_mendable(crunch("calibrate", "odometry", *logs), told)


def test_a_cut_log_counts_up_to_the_cut(crunch, room, tmp_path):  # noqa: F811
    text = room.read_text()
    (tmp_path / "cut.log").write_text(text[: len(text) * 9 // 10])
    outcome = crunch("calibrate", "odometry", "cut.log", *FEW)
    assert outcome.code == 0
    assert "cut.log" in outcome.err
    assert "replayed up to it" in outcome.err


def row(estimate, low, high, present):
    return Row("turn_noise", estimate, low, high, present)


def test_what_is_learned_is_taken_and_what_is_not_stays_as_far_as_it_can():
    assert row(0.03, 0.02, 0.05, 0.4).recommended == 0.03
    assert row(0.03, 0.02, 0.05, 0.4).verdict == "learned"
    assert row(0.03, 0.0, 0.05, 0.04).recommended == 0.04
    assert row(0.03, 0.0, 0.05, 0.04).verdict == "open: stays as it is"
    assert row(0.0001, 0.0, 0.05, 0.4).recommended == 0.05
    assert "surely less" in row(0.0001, 0.0, 0.05, 0.4).verdict
    assert row(0.3, 0.05, 0.9, 0.01).recommended == 0.05
    assert "surely more" in row(0.3, 0.05, np.inf, 0.01).verdict
    assert row(0.3, 0.05, np.inf, 0.01).interval == "0.05 or more"


def test_the_settings_say_where_they_come_from():
    drives = [Drive("a.rlog", 100.4, 50, np.zeros(2)), Drive("b.rlog", 50.0, 20, np.zeros(2))]
    text = Calibration([row(0.0312345, 0.02, 0.05, 0.4)], drives, 0, 1.0, []).toml()
    assert "from 2 logs, 150 m." in text
    assert "turn_noise = 0.0312  # rad per root metre; learned (0.02 to 0.05)" in text
