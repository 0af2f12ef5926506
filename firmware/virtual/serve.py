"""Serves a virtual robot's bytes on TCP or on a pseudo-terminal, paced by the wall clock."""

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
    """What is served: `VirtualCrunch` and `ScriptedCrunch` alike."""

    def advance(self, seconds: float) -> bytes: ...

    def write(self, data: bytes) -> None: ...


async def pace(robot: Robot, speed: float, send: Callable[[bytes], None]) -> None:
    """Advances the robot at `speed` times real time, for ever, handing its bytes to `send`.

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
        data = robot.advance(BEAT * speed)
        if data:
            send(data)


async def serve_tcp(robot: Robot, host: str, port: int, speed: float, ready: Callable[[str], None]) -> None:
    """Any number of listeners hear the robot; what any of them writes reaches it. `ready` gets the address."""
    writers: set[asyncio.StreamWriter] = set()

    async def listen(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writers.add(writer)
        try:
            while data := await reader.read(4096):
                robot.write(data)
        except ConnectionError:
            pass
        finally:
            writers.discard(writer)
            writer.close()

    def send(data: bytes) -> None:
        for writer in writers:
            if not writer.is_closing() and writer.transport.get_write_buffer_size() < MAX_UNSENT:
                writer.write(data)

    server = await asyncio.start_server(listen, host, port)
    async with server:
        name, number = server.sockets[0].getsockname()[:2]
        ready(f"tcp://{name}:{number}")
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
