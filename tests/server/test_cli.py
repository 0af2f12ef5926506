"""The `crunch` command as a person meets it: exit codes, one line for every mistake, and help that comes at once."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from server import __main__ as command
from server.formats.carmen import format_flaser, format_odom, write_carmen
from tests.server.logs import write_room_log

POSE = np.zeros(3)


class Outcome(NamedTuple):
    """What a command left behind."""

    code: int
    out: str
    err: str


@pytest.fixture
def crunch(capsys, tmp_path, monkeypatch):
    """Runs the command in this process, in an empty directory."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str | Path) -> Outcome:
        with pytest.raises(SystemExit) as leaving:
            command.main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Outcome(int(leaving.value.code or 0), captured.out, captured.err)

    return run


def in_a_process(*arguments: str | Path) -> Outcome:
    """The command in a process of its own."""
    result = subprocess.run(
        [sys.executable, "-m", "server", *map(str, arguments)], capture_output=True, text=True, check=False
    )
    return Outcome(result.returncode, result.stdout, result.stderr)


def room_log(folder: Path) -> Path:
    write_room_log(folder / "room.log")
    return folder / "room.log"


def assert_mendable(outcome: Outcome, *told: str) -> None:
    """One line on standard error, exit code 2, nothing on standard output."""
    assert outcome.code == 2, outcome
    assert outcome.out == ""
    assert outcome.err.count("\n") == 1
    assert outcome.err.startswith("crunch: error: ")
    for part in told:
        assert part in outcome.err


def test_help_names_every_command_and_needs_nothing_heavy():
    code = "import sys, server.__main__ as m\ntry: m.main(['--help'])\nexcept SystemExit as e: print(e.code)\n"
    code += "print([name for name in ('numpy', 'numba', 'matplotlib', 'fastapi', 'pydantic') if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.endswith("0\n[]\n")
    for name in ("demo", "serve", "replay", "simulate", "score", "calibrate", "version"):
        assert f"\n  {name} " in result.stdout


@pytest.mark.parametrize("name", ["demo", "serve", "replay", "simulate", "score", "calibrate odometry"])
def test_help_of_each_command_teaches_by_example(crunch, name):
    outcome = crunch(*name.split(), "--help")
    assert outcome.code == 0
    assert f"\n      crunch {name} " in outcome.out


def test_without_a_command_comes_the_help(crunch):
    assert crunch() == crunch("--help")


def test_version_is_told(crunch):
    outcome = crunch("version")
    assert outcome.code == 0
    assert outcome.out.startswith("crunch 0.")


def test_replay_tells_what_it_made_and_score_prints_json(crunch, tmp_path):
    log = room_log(tmp_path)
    outcome = crunch("replay", log, "--out", "map", "--particles", "200", "--seed", "3")
    assert outcome.code == 0
    assert outcome.err == ""
    assert outcome.out.startswith("map: 2")
    assert " vertices, 200 particles" in outcome.out
    report = json.loads((tmp_path / "map" / "report.json").read_text())
    assert (report["robot"], report["particles"], report["seed"]) == ("crunch", 200, 3)
    scores = json.loads(crunch("score", "map", "--truth", "map/trajectory.tum").out)
    assert scores["ate"]["translation_m"]["max"] == pytest.approx(0.0, abs=1e-5)


def test_several_logs_get_a_folder_each(crunch, tmp_path):
    log = room_log(tmp_path)
    (tmp_path / "b").mkdir()
    other = room_log(tmp_path / "b")
    outcome = crunch("replay", log, other, "--out", "maps", "--particles", "50", "--quiet")
    assert (outcome.code, outcome.out) == (0, "")
    assert (tmp_path / "maps" / "room" / "report.json").is_file()
    assert (tmp_path / "maps" / "room-2" / "report.json").is_file()


def test_beams_and_their_reach_are_taken(crunch, tmp_path):
    outcome = crunch(
        "replay", room_log(tmp_path), "--out", "m", "--beams", "11", "--max-range", "4", "--particles", "50"
    )
    assert outcome.code == 0
    assert "11 laser bearings" in json.loads((tmp_path / "m" / "report.json").read_text())["description"]
    assert_mendable(crunch("replay", tmp_path / "room.log", "--out", "m", "--max-range", "4"), "add --beams N")


def test_a_misspelt_key_is_one_line_with_file_line_and_remedy(crunch, tmp_path):
    (tmp_path / "my.toml").write_text("[crunch.filter]\npartcles = 5\n")
    outcome = crunch("replay", room_log(tmp_path), "--out", "m", "--config", "my.toml")
    assert_mendable(outcome, "my.toml:2: `crunch.filter.partcles`", "did you mean `crunch.filter.particles`?")
    (tmp_path / "config.toml").write_text("[crunch.filter]\npartcles = 5\n")
    for name in ("demo", "serve"):
        assert_mendable(crunch(name, "--no-browser"), "config.toml:2: `crunch.filter.partcles`")
    assert crunch("replay", "room.log", "--out", "m", "--particles", "50").code == 0, "it counts for live sessions only"


def test_poor_logs_are_one_line(crunch, tmp_path):
    (tmp_path / "empty.log").write_text("")
    (tmp_path / "empty.rlog").write_text("")
    noise = np.random.default_rng(5).integers(0, 256, 1_000_000, np.uint8).tobytes()
    (tmp_path / "noise.log").write_bytes(noise)
    (tmp_path / "noise.rlog").write_bytes(noise)
    write_carmen(tmp_path / "blind.log", [format_odom(1.0, POSE)])
    write_carmen(tmp_path / "lame.log", [format_flaser(1.0, np.ones(180), POSE)])
    (tmp_path / "folder").mkdir()
    for name, told in {
        "empty.log": "empty.log: is empty",
        "empty.rlog": "empty.rlog: is empty",
        "noise.log": "noise.log: is no log that crunch knows",
        "noise.rlog": "noise.rlog: offset 0 is not the beginning",
        "blind.log": "blind.log: holds no ranges",
        "lame.log": "lame.log: holds no odometry",
        "folder": "folder: is a directory",
        "missing.log": "missing.log: no such file",
    }.items():
        assert_mendable(crunch("replay", name, "--out", "m"), told)
    assert not (tmp_path / "m").exists()


def test_other_mistakes_are_one_line(crunch, tmp_path):
    log = room_log(tmp_path)
    (tmp_path / "file").write_text("")
    assert_mendable(
        crunch("replay", log, "--out", "m", "--robot", "krunch"), "robot `krunch` is unknown; known: crunch"
    )
    assert_mendable(crunch("replay", log, "--out", "file"), "file: cannot be written")
    assert_mendable(crunch("replay", log, "--out", "file/below"), "file/below: cannot be written")
    assert_mendable(crunch("replay", log), "Missing option '--out'", "crunch replay --help")
    assert_mendable(crunch("replay", log, "--out", "m", "--seed", "x"), "'--seed'")
    assert_mendable(crunch("replay", log, "--out", "m", "--seed", str(2**63)), "'--seed'", "less than or equal")
    assert_mendable(crunch("replay", log, "--out", "m", "--set", "crunch.local_map.reach=200"), "less than or equal")
    gain = "crunch.filter.comparison.affinity.gain"
    assert_mendable(crunch("replay", log, "--out", "m", "--set", f"{gain}=inf"), gain, "finite")
    bearings = "crunch.sensors.sonar.bearings_deg"
    assert_mendable(crunch("demo", "--no-browser", "--set", f"{bearings}=[0.0]"), bearings, "1 bearings")
    assert_mendable(crunch("replay", log, "--out", "m", "--particles", "0"), "crunch.filter.particles = 0")
    assert_mendable(crunch("replay", log, "--out", "m", "--preset", "tesis"), "preset `tesis` is unknown")
    maze_runner = ("replay", log, "--out", "m", "--robot", "maze_runner")
    assert_mendable(crunch(*maze_runner, "--preset", "thesis"), "preset `thesis` is for crunch, not for maze_runner")
    told = "preset `paper` is for maze_runner, not for crunch"
    assert_mendable(crunch("replay", log, "--out", "m", "--preset", "paper"), told)
    assert_mendable(crunch("demo", "--no-browser", "--preset", "paper"), told)
    assert_mendable(crunch("rplay"), "No such command 'rplay'")
    assert_mendable(crunch("score", "m"), "give --truth")
    assert_mendable(crunch("simulate", "--out", "a.rlog", "--world", "mars"), "mars")
    assert_mendable(crunch("simulate", "--out", "a.rlog", "--drift", "wild"), "drift `wild` is unknown")
    assert_mendable(crunch("simulate", "--out", "a.rlog", "--robot", "krunch"), "known: crunch, maze_runner")
    assert_mendable(crunch("simulate", "--out", "a.rlog", "--from-log", log), "--reference belong together")
    semireal = ("simulate", "--out", "a.rlog", "--from-log", log, "--reference", log)
    assert_mendable(crunch(*semireal, "--mice", "2"), "leave out --mice")
    assert_mendable(crunch("serve", "--no-browser", "--no-record"), "--link")
    assert_mendable(crunch("serve", "--no-browser", "--no-record", "--link", "smoke:signals"), "smoke:signals")
    assert_mendable(crunch("demo", "--no-browser", "--drift", "wild"), "drift `wild` is unknown")


def test_a_truncated_recording_replays_up_to_the_cut(crunch, tmp_path):
    assert crunch("simulate", "--out", "drive.rlog", "--duration", "6", "--seed", "2").code == 0
    whole = (tmp_path / "drive.rlog").read_bytes()
    (tmp_path / "cut.rlog").write_bytes(whole[: len(whole) * 2 // 3 + 1])
    outcome = crunch("replay", "cut.rlog", "--out", "m", "--particles", "50")
    assert outcome.code == 0
    assert outcome.err.startswith("crunch: warning: cut.rlog:")
    assert "replayed up to it" in outcome.err
    assert json.loads((tmp_path / "m" / "report.json").read_text())["truncated_at"] > 0
    (tmp_path / "head.rlog").write_bytes(whole[:40])
    assert_mendable(crunch("replay", "head.rlog", "--out", "m2"), "head.rlog", "header")


def test_our_own_mistake_is_code_1_and_debug_shows_it(crunch, monkeypatch):
    def broken() -> dict:
        raise RuntimeError("two\nlines")

    monkeypatch.setattr("server.report.describe_machine", broken)
    outcome = crunch("version")
    assert outcome.code == 1
    assert outcome.err.count("\n") == 1
    assert "RuntimeError: two lines" in outcome.err
    outcome = crunch("version", "--debug")
    assert outcome.code == 1
    assert "Traceback" in outcome.err


def test_a_real_process_says_the_same(tmp_path):
    assert_mendable(in_a_process("replay", tmp_path, "--out", tmp_path / "m"), "is a directory")
    assert_mendable(in_a_process("replay", os.devnull, "--out", tmp_path / "m"), "is empty")
    outcome = in_a_process("replay", room_log(tmp_path), "--out", tmp_path / "m", "--particles", "50")
    assert (outcome.code, outcome.err) == (0, "")
    outcome = in_a_process("--debug", "replay", tmp_path, "--out", tmp_path / "m")
    assert outcome.code == 2
    assert "Traceback" in outcome.err
