"""The served robot: bytes on TCP and a pseudo-terminal, commands back, and a command line that says what is wrong."""

import asyncio
import os
import signal
import subprocess
import sys

import pytest

from firmware.virtual import VirtualCrunch
from firmware.virtual.__main__ import main
from firmware.virtual.serve import serve_pty, serve_tcp
from server.link import Decoder
from tests.firmware.virtual_wire import DRIVE, drive_command, room


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


def test_the_command_line_teaches():
    command = [sys.executable, "-m", "firmware.virtual", "--help"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    for word in ("--world", "--plan", "--tcp", "--pty", "--drift", "examples:", "crunch serve --link tcp://"):
        assert word in result.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--world", "nowhere", "--tcp", "127.0.0.1:0"], "nowhere: no such file"),
        (["--plan", "nowhere", "--tcp", "127.0.0.1:0"], "built-in: corridor50, demo"),
        (["--tcp", "9000"], "needs HOST:PORT"),
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
