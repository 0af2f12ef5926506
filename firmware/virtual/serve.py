"""Serves a virtual robot's bytes, and its laser's, on TCP or on a pseudo-terminal, paced by the wall clock."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from firmware.virtual.pace import Pace

log = logging.getLogger(__name__)

BEAT = 0.02  # s
MAX_LAG = 0.5  # s; after a longer stall (a laptop's sleep) the robot goes on from now
MAX_UNSENT = 65536  # bytes that a slow listener may leave; more are dropped, as on the air


class Robot(Protocol):
    """What is served: all virtual robots alike."""

    def advance(self, seconds: float) -> bytes: ...

    def write(self, data: bytes) -> None: ...


class RobotWithLaser(Robot, Protocol):
    """One whose laser has a line of its own: `VirtualMazeRunner`."""

    def write_laser(self, data: bytes) -> None: ...

    def take_laser(self) -> bytes: ...


class TcpLine:
    """A robot's line on TCP: any number of listeners hear it; what any of them writes goes to `write`."""

    def __init__(self, write: Callable[[bytes], None]) -> None:
        self.write = write
        self.writers: set[asyncio.StreamWriter] = set()

    async def open(self, host: str, port: int) -> tuple[asyncio.Server, str]:
        """The server of the line, and its address."""
        server = await asyncio.start_server(self.listen, host, port)
        name, number = server.sockets[0].getsockname()[:2]
        return server, f"tcp://{name}:{number}"

    async def listen(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one listener until it leaves."""
        self.writers.add(writer)
        try:
            while data := await reader.read(4096):
                self.write(data)
        except ConnectionError:
            pass
        finally:
            self.writers.discard(writer)
            writer.close()

    def send(self, data: bytes) -> None:
        """Bytes for all who listen, as far as they are not too slow."""
        for writer in self.writers if data else ():
            if not writer.is_closing() and writer.transport.get_write_buffer_size() < MAX_UNSENT:
                writer.write(data)


async def pace(robot: Robot, speed: float, send: Callable[[bytes], None]) -> None:
    """Advances the robot at `speed` times real time, for ever, handing its bytes to `send`, even if they are none.

    Where the machine cannot, time is left out, and the log tells it.
    """
    clock = asyncio.get_running_loop().time
    due, kept = clock(), Pace()
    while True:
        lost = max(0.0, clock() - MAX_LAG - due - BEAT)
        due += BEAT + lost
        if kept.note(BEAT + lost, lost):
            log.warning(kept.complaint)
        await asyncio.sleep(max(0.0, due - clock()))
        send(robot.advance(BEAT * speed))


async def serve_tcp(robot: Robot, host: str, port: int, speed: float, ready: Callable[[str], None]) -> None:
    """Any number of listeners hear the robot; what any of them writes reaches it. `ready` gets the address."""
    line = TcpLine(robot.write)
    server, address = await line.open(host, port)
    async with server:
        ready(address)
        await pace(robot, speed, line.send)


async def serve_with_laser(
    robot: RobotWithLaser, board: tuple[str, int], laser: tuple[str, int], speed: float, ready: Callable[[str], None]
) -> None:
    """The same with a port for the board and one for the laser; `ready` gets both addresses in words."""
    lines = TcpLine(robot.write), TcpLine(robot.write_laser)

    def send(data: bytes) -> None:
        lines[0].send(data)
        lines[1].send(robot.take_laser())

    async with contextlib.AsyncExitStack() as stack:
        addresses = []
        for line, where in zip(lines, (board, laser), strict=True):
            server, address = await line.open(*where)
            await stack.enter_async_context(server)
            addresses.append(address)
        ready(", its laser at ".join(addresses))
        await pace(robot, speed, send)


def link_to(path: Path, target: str) -> None:
    """Makes `path` a symbolic link to a terminal; replaces an old link, never a file."""
    if path.is_symlink():
        path.unlink()
    path.symlink_to(target)


async def serve_pty(robot: Robot, path: Path, speed: float, ready: Callable[[str], None]) -> None:
    """A pseudo-terminal under the name `path`: for programs that expect a serial port. `ready` gets the path."""
    master, slave = os.openpty()  # the slave stays open here, so that a listener may come and go
    tty.setraw(slave)
    os.set_blocking(master, False)
    loop = asyncio.get_running_loop()

    def receive() -> None:
        with contextlib.suppress(BlockingIOError):
            robot.write(os.read(master, 4096))

    def send(data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):  # nobody reads: the bytes are gone, as on the air
            if data:
                os.write(master, data)

    try:
        link_to(path, os.ttyname(slave))
        loop.add_reader(master, receive)
        ready(f"pty:{path}")
        await pace(robot, speed, send)
    finally:
        loop.remove_reader(master)
        if path.is_symlink():
            path.unlink()
        os.close(slave)
        os.close(master)
