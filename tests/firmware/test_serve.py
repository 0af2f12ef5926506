"""The served robot: bytes on TCP and a pseudo-terminal, commands back, and a command line that says what is wrong."""

import asyncio
import os
import re
import signal
import subprocess
import sys
import time

import pytest

from firmware.virtual import VirtualCrunch
from firmware.virtual.__main__ import main
from firmware.virtual.serve import serve_pty, serve_tcp
from server.commands import PowersCommand
from server.link import Decoder
from server.messages import Drive
from server.robots.kinds import LASER
from server.robots.maze_runner import MazeRunner, MazeRunnerParams
from server.session import session_of
from server.transport import open_link
from tests.firmware.virtual_wire import DRIVE, drive_command, room

MAZE_RUNNER = ("--robot", "maze_runner", "--tcp", "127.0.0.1:0")


async def drive_by(read, write, robot, seconds=120.0):
    """Commands the robot forward over a link until it has gone half a metre."""
    decoder, echo = Decoder(), None
    async with asyncio.timeout(seconds):
        while robot.pose[0] < 0.5:
            for frame in decoder.feed(await read()):
                echo = frame.time_ms if frame.source == DRIVE else echo
            if echo is not None:
                write(drive_command(0.4, 0.0, echo))
    assert decoder.rejected == 0


async def serving(serve, *arguments):
    """A task that serves, and its address."""
    address = asyncio.get_running_loop().create_future()
    task = asyncio.create_task(serve(*arguments, address.set_result))
    done, _ = await asyncio.wait({task, address}, return_when=asyncio.FIRST_COMPLETED)
    if task in done:
        task.result()
    return task, await address


async def end(task):
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task


def test_a_host_drives_it_over_tcp():
    async def scene():
        robot = VirtualCrunch(room(8, 4), seed=1, drift="none")
        task, address = await serving(serve_tcp, robot, "127.0.0.1", 0, 4.0)
        host, port = address.removeprefix("tcp://").split(":")
        for _ in range(2):  # a listener may leave and come again
            reader, writer = await asyncio.open_connection(host, int(port))
            assert await reader.read(100)
            writer.close()
            await writer.wait_closed()
        reader, writer = await asyncio.open_connection(host, int(port))
        await drive_by(lambda: reader.read(4096), writer.write, robot)
        writer.close()
        await writer.wait_closed()
        await end(task)

    asyncio.run(scene())


def test_a_host_drives_it_over_a_pseudo_terminal(tmp_path):
    async def scene():
        """In real time: a terminal keeps a second's bytes for who reads late, and drops the rest."""
        robot = VirtualCrunch(room(8, 4), seed=1, drift="none")
        path = tmp_path / "crunch"
        task, address = await serving(serve_pty, robot, path, 1.0)
        assert address == f"pty:{path}"
        line = os.open(path, os.O_RDWR | os.O_NOCTTY)
        await drive_by(lambda: asyncio.to_thread(os.read, line, 4096), lambda data: os.write(line, data), robot)
        os.close(line)
        await end(task)
        assert not path.exists()

    asyncio.run(scene())


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_takes_its_terminal_along_when_told_to_leave(tmp_path, number):
    path = tmp_path / "crunch"
    command = [sys.executable, "-m", "firmware.virtual", "--pty", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as served:
        assert served.stdout is not None
        assert f"pty:{path}" in served.stdout.readline()
        assert path.is_symlink()
        served.send_signal(number)
        _, errors = served.communicate(timeout=120)
    assert (served.returncode, errors) == (0, "")
    assert not path.is_symlink()


def test_a_maze_runner_is_driven_and_sees_over_two_lines_of_tcp():
    command = [sys.executable, "-m", "firmware.virtual", "--robot", "maze_runner", "--world", "maze:small:1"]
    where = ["--tcp", "127.0.0.1:0", "--laser-tcp", "127.0.0.1:0"]
    with subprocess.Popen([*command, *where], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as served:
        assert served.stdout is not None
        told = served.stdout.readline()
        board, laser = re.findall(r"tcp://[\w.:]+", told)
        assert told.startswith(f"virtual Maze Runner in maze:small:1 at {board}, its laser at {laser};")
        try:
            asyncio.run(turn_about({"link0": open_link(board), LASER: open_link(laser)}))
        finally:
            served.send_signal(signal.SIGTERM)
            _, errors = served.communicate(timeout=120)
    assert (served.returncode, errors) == (0, "")


async def turn_about(links):
    """Turns the robot at the other end by half a radian, as its laser sees it."""
    params = MazeRunnerParams()
    robot = MazeRunner(params)
    session = session_of("maze_runner", robot, params)
    begun = time.monotonic()

    def receive(link_id):
        return lambda data, t: session.receive(link_id, data, t - begun)

    async with asyncio.timeout(120.0), asyncio.TaskGroup() as group:
        tasks = [group.create_task(link.run(receive(link_id))) for link_id, link in links.items()]
        while abs(robot.pose()[2]) < 0.5:
            await asyncio.sleep(0.1)
            now = time.monotonic() - begun
            for link_id, request in session.requests(now).items():
                links[link_id].write(request)
            if session.drive_link and robot.vertices:
                for effect in session.command(Drive(now, 0.0, 0.6), now):
                    assert isinstance(effect, PowersCommand)
                    links[session.drive_link].write(session.encode(effect))
        for task in tasks:
            task.cancel()
    health = session.health(time.monotonic() - begun)
    assert (health["rejected"], health["refused"], health["faults"][LASER]) == (0, {}, "")


def test_the_command_line_teaches():
    command = [sys.executable, "-m", "firmware.virtual", "--help"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    for word in (
        "--world",
        "--plan",
        "--tcp",
        "--pty",
        "--drift",
        "--laser-tcp",
        "examples:",
        "crunch serve --link tcp://",
    ):
        assert word in result.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--world", "nowhere", "--tcp", "127.0.0.1:0"], "nowhere: no such file"),
        (["--plan", "nowhere", "--tcp", "127.0.0.1:0"], "built-in: corridor50, demo"),
        (["--tcp", "9000"], "needs HOST:PORT"),
        (["--laser-tcp", "127.0.0.1:0", "--tcp", "127.0.0.1:0"], "--laser-tcp: a Crunch has no laser"),
        (["--robot", "maze_runner", "--tcp", "127.0.0.1:0"], "needs --tcp for its board and --laser-tcp for its laser"),
        ([*MAZE_RUNNER, "--laser-tcp", "9001"], "--laser-tcp 9001: needs HOST:PORT"),
        ([*MAZE_RUNNER, "--laser-tcp", "127.0.0.1:0", "--plan", "demo"], "--plan: is for a Crunch"),
        ([*MAZE_RUNNER, "--laser-tcp", "127.0.0.1:0", "--world", "maze:vast:1"], "maze:vast:1: names no maze"),
        (["--speed", "0", "--tcp", "127.0.0.1:0"], "--speed 0.0: needs a number above 0"),
        (["--loss", "2", "--tcp", "127.0.0.1:0"], "chunk_loss must be between 0 and 1"),
        (["--pty", "/nonexistent/folder/crunch"], "No such file or directory"),
    ],
)
def test_mistakes_end_with_one_line_and_code_2(capsys, arguments, message):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
