"""`crunch board` and `crunch firmware` as a person meets them: virtual, served and real boards, and what goes wrong."""

import asyncio
import io
import json
import os
import re
import stat
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from firmware.virtual import Radio, VirtualCrunch, VirtualMazeRunner
from firmware.virtual.avr import AvrCrunch
from firmware.virtual.host import HostCrunch
from firmware.virtual.mazes import maze
from firmware.virtual.serve import serve_pty, serve_tcp
from server import __main__ as command
from server import flash
from server.board import settings_table
from server.boards import Errands, Heard, both, setting
from server.channels import Calibration
from server.commands import AdjustCommand
from server.session import Session
from tests.firmware.avr_tools import need_simavr
from tests.firmware.virtual_wire import room

ROOM = room(4.0, 4.0)
STORED_TILT = 4 + 1 + 4 * 4  # where its first byte lies in the EEPROM


def crunch(capsys, *arguments):
    """(exit code, standard output, standard error)."""
    with pytest.raises(SystemExit) as leaving:
        command.main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return int(leaving.value.code or 0), captured.out, captured.err


def board_json(capsys, *arguments):
    code, out, err = crunch(capsys, "board", *arguments, "--json")
    assert (code, err) == (0, "")
    return json.loads(out)


def assert_mendable(outcome, *told):
    code, out, err = outcome
    assert (code, out, err.count("\n")) == (2, "", 1)
    for part in told:
        assert part in err


@contextmanager
def served(robot, serve=serve_tcp, *where):
    """The link to a robot that is served by another thread."""
    ready, address, tasks = threading.Event(), [], []

    async def live():
        tasks.append((asyncio.get_running_loop(), asyncio.current_task()))
        await serve(robot, *(where or ("127.0.0.1", 0)), 1.0, lambda text: (address.append(text), ready.set()))

    def work():
        with pytest.raises(asyncio.CancelledError):
            asyncio.run(live())

    thread = threading.Thread(target=work)
    thread.start()
    try:
        assert ready.wait(60.0)
        yield address[0]
    finally:
        loop, task = tasks[0]
        loop.call_soon_threadsafe(task.cancel)
        thread.join()


def errands_done(robot, commands, seconds=60.0):
    """The errands after simulated time, with the host's own session."""
    heard = Heard()
    session, errands = Session(heard, Calibration()), Errands(commands)
    for i in range(round(seconds / 0.05)):
        t = i * 0.05
        session.receive("air", robot.advance(0.05), t)
        robot.write(errands.due(t, session, heard))
        if errands.is_over:
            break
    return errands


def test_errands_are_done_in_order_and_the_first_refusal_ends_them():
    robot = VirtualCrunch(ROOM, seed=1)
    done = errands_done(robot, [*setting("tilt", 6.25), *both("store"), AdjustCommand("drive", "ask", "tilt")])
    assert done.failure == ""
    assert [(a.board, a.verb) for a in done.done] == [
        ("drive", "set"), ("drive", "store"), ("sensor", "store"), ("drive", "ask"),
    ]  # fmt: skip
    assert (done.done[-1].value, done.done[-1].is_stored) == (6.25, True)
    refused = errands_done(robot, [*setting("tilt", 99.0), *both("store")])
    assert refused.failure.startswith("the drive board refused to set tilt: the value is out of its bounds")
    assert len(refused.done) == 1


def test_a_stream_is_set_on_both_boards():
    done = errands_done(VirtualCrunch(ROOM, seed=1), setting("infrared_ms", 400.0))
    assert [(a.board, a.outcome) for a in done.done] == [("drive", "done"), ("sensor", "done")]


def test_over_a_bad_radio_everything_is_done_in_the_end():
    radio = Radio(latency=0.1, chunk_loss=0.3, bit_error_rate=1e-4)
    done = errands_done(VirtualCrunch(ROOM, seed=1, radio=radio), [*setting("tilt", 6.25), *both("store")])
    assert (done.failure, len(done.done)) == ("", 3)


def test_a_board_that_is_not_there_is_told():
    class Silence:
        def advance(self, _):
            return b""

        def write(self, _):
            pass

    assert "does not answer" in errands_done(Silence(), both("store")).failure


def test_the_board_of_another_robot_is_told_as_such(capsys, monkeypatch):
    monkeypatch.setattr("server.workbench.SILENCE", 1.0)
    with served(VirtualMazeRunner(maze("small", 0))) as address:
        assert_mendable(crunch(capsys, "board", address, "--seconds", "1"), "--robot maze_runner")


def test_a_virtual_robot_is_looked_at_and_adjusted(capsys):
    told = board_json(capsys, "virtual:", "--set", "tilt=6.25", "--store", "--seconds", "4")
    assert told["settings"]["drive"]["tilt"] == {"value": 6.25, "stored": True}
    assert told["settings"]["sensor"]["sonar_ms"] == {"value": 80.0, "stored": True}
    assert told["link"]["frames_per_s"]["odometry"] == pytest.approx(50.0, rel=0.2)
    assert 20.0 < told["link"]["share_percent"] < 60.0
    assert (told["link"]["lost"], told["link"]["rejected"]) == (0, 0)
    assert told["boards"]["drive"]["settings"] == "stored settings"
    assert told["telemetry"]["battery_v"] > 24.0
    assert len(told["telemetry"]["sonar_m"]) == 8


@pytest.mark.parametrize("build", ["host", "avr"])
def test_over_tcp_a_stored_gain_outlives_a_reset_and_a_spoiled_one_is_told(capsys, build):
    if build == "avr":
        need_simavr()
    robot = AvrCrunch(ROOM, seed=1) if build == "avr" else HostCrunch(ROOM, np.zeros(3), seed=1)
    with served(robot) as link:
        told = board_json(capsys, link, "--set", "tilt=6.25", "--zero-gyro", "--level", "--store")
        assert [(a["verb"], a["outcome"]) for a in told["answers"]] == [
            ("set", "done"), ("zero gyro", "done"), ("level", "done"), ("store", "done"), ("store", "done"),
        ]  # fmt: skip
    robot.reset_boards()
    with served(robot) as link:
        told = board_json(capsys, link, "--get")
        assert told["settings"]["drive"]["tilt"] == {"value": 6.25, "stored": True}
        assert told["boards"]["drive"]["settings"] == "stored settings"
    if isinstance(robot, AvrCrunch):
        robot.lib.microcontroller_spoil(robot.robot.drive, STORED_TILT, 0x55)
    else:
        robot.robot.drive.memory.bytes[STORED_TILT - 4] ^= 0x55
    robot.reset_boards()
    with served(robot) as link:
        told = board_json(capsys, link, "--get")
        assert told["settings"]["drive"]["tilt"] == {"value": 5.0, "stored": False}
        assert "BUILT-IN settings: the stored ones are spoiled" in told["boards"]["drive"]["settings"]
        assert told["boards"]["sensor"]["settings"] == "stored settings"


def test_on_a_pseudo_terminal_it_prints_tables(capsys, tmp_path):
    with served(VirtualCrunch(ROOM, seed=1), serve_pty, tmp_path / "crunch.tty") as link:
        sets = ["--set", "infrared_ms=400", "--set", "sonar_ms=200", "--set", "odometry_ms=10"]
        code, out, err = crunch(capsys, "board", link, *sets)
    assert (code, err) == (0, "")
    for text in ("% of the line", "worst_loop_ms", "odometry_ms", "10 *", "sensor: set infrared_ms = 400 done"):
        assert text in out


def test_what_a_board_refuses_and_what_nobody_can_mean_is_one_line(capsys):
    assert_mendable(
        crunch(capsys, "board", "virtual:", "--set", "tilt=nan"), "drive board refused to set tilt", "bounds"
    )
    assert_mendable(crunch(capsys, "board", "virtual:", "--zero-gyro"), "refused to zero gyro", "at rest")
    assert_mendable(crunch(capsys, "board", "virtual:", "--set", "odometry_ms=10"), "half of the line")
    assert_mendable(crunch(capsys, "board", "virtual:", "--set", "tlit=4"), "`tlit` is no setting", "mean `tilt`?")
    assert_mendable(crunch(capsys, "board", "virtual:", "--set", "tilt=much"), "needs a number")
    assert_mendable(crunch(capsys, "board", "telepathy:"), "is no link")
    assert_mendable(crunch(capsys, "board", "tcp://127.0.0.1:9", "--json"), "tcp://127.0.0.1:9: ")


def test_help_teaches_by_example(capsys):
    for name in ("board", "firmware flash", "firmware build", "firmware size"):
        code, out, _ = crunch(capsys, *name.split(), "--help")
        assert code == 0
        assert f"\n      crunch {name}" in out


def program(folder: Path, name: str, text: str) -> None:
    """A program of a test's own in a folder of the path."""
    path = folder / name
    path.write_text(f"#!{sys.executable}\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


def test_flashing_hands_the_right_file_to_the_programmer(capsys, tmp_path, monkeypatch):
    need_simavr()
    program(tmp_path, "avrdude", "import sys; open(sys.argv[0] + '.said', 'w').write(' '.join(sys.argv[1:]))")
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    flags = ["--board", "sensor", "--port", "usb", "--programmer", "usbasp", "--fuses", "--bit-clock", "10"]
    code, out, err = crunch(capsys, "firmware", "flash", *flags)
    assert (code, out, err) == (0, "sensor: written and verified\n", "")
    said = (tmp_path / "avrdude.said").read_text()
    assert said == (
        f"-p m32 -c usbasp -P usb -B 10 -U lfuse:w:0x3f:m -U hfuse:w:0x81:m -U flash:w:{flash.BUILT / 'sensor.hex'}:i"
    )


def test_the_fuses_are_those_of_the_documents():
    page = (flash.ROOT / "docs" / "firmware.md").read_text()
    told = dict(re.findall(r"`([lh]fuse)` (0x\w\w)", page))
    assert {name: int(value, 16) for name, value in told.items()} == flash.FUSES


def test_sizes_are_told_for_each_board(capsys):
    need_simavr()
    code, out, err = crunch(capsys, "firmware", "size")
    assert (code, err) == (0, "")
    boards = ("drive", "sensor", "motor", "cart")
    assert [line.split(":")[0] for line in out.splitlines()] == [board for board in boards for _ in range(2)]
    assert "flash" in out
    assert "% Full" in out


@pytest.mark.parametrize(
    ("missing", "remedy"), [("avrdude", "apt-get install avrdude"), ("avr-gcc", "apt-get install gcc-avr avr-libc")]
)
def test_a_missing_tool_is_named_with_its_remedy(capsys, monkeypatch, missing, remedy):
    monkeypatch.setattr(flash.shutil, "which", lambda tool: None if tool == missing else tool)
    outcome = crunch(capsys, "firmware", "flash", "--board", "drive", "--port", "/dev/ttyUSB0")
    assert_mendable(outcome, f"{missing} is not installed", remedy)


def test_the_other_imu_has_a_program_of_its_own(capsys):
    need_simavr()
    code, out, _ = crunch(capsys, "firmware", "build", "--board", "drive", "--imu", "mpu6050")
    assert code == 0
    assert out.startswith("drive: flash ")
    assert (flash.BUILT.parent / "avr-mpu6050" / "drive.hex").exists()


def test_what_the_programmer_complains_of_is_told(capsys, tmp_path, monkeypatch):
    need_simavr()
    program(tmp_path, "avrdude", "import sys; sys.exit('avrdude: ser_open(): can\\'t open device \"/dev/ttyUSB9\"')")
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    outcome = crunch(capsys, "firmware", "flash", "--board", "drive", "--port", "/dev/ttyUSB9")
    assert_mendable(outcome, "could not write the drive board", "can't open device")


def test_outside_a_checkout_there_is_nothing_to_build(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(flash, "FIRMWARE", tmp_path)
    assert_mendable(crunch(capsys, "firmware", "build"), "not installed with crunch", "checkout")


@pytest.mark.parametrize(("theirs", "is_told"), [(80.0, False), (160.0, True)])
def test_boards_that_differ_in_a_stream_are_told_of(theirs, is_told):
    settings = {
        "drive": {"sonar_ms": {"value": 80.0, "stored": True}, "tilt": {"value": 5.2, "stored": True}},
        "sensor": {"sonar_ms": {"value": theirs, "stored": True}},
    }
    screen = io.StringIO()
    Console(file=screen, width=100).print(settings_table(settings))
    said = " ".join(screen.getvalue().split())
    assert ("the boards differ in sonar_ms: set it again" in said) == is_told
