"""A robot's wire that can be watched: a station on one side, a virtual robot on the other, and when a command passed.

Times are seconds since 1970, as a browser on the same machine has them.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from server import channels, link

ROOT = Path(__file__).resolve().parents[1]


class Relay:
    """Passes bytes both ways in a thread of its own and notes when the wheels were told to turn."""

    def __init__(self, robot_port: int):
        self.robot_port = robot_port
        self.commands: list[tuple[float, bool]] = []  # when each drive command passed, and whether it moves
        self.port = 0
        self.ready = threading.Event()
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()
        self.ready.wait(10.0)

    def run(self) -> None:
        """The thread."""
        asyncio.set_event_loop(self.loop)
        server = self.loop.run_until_complete(asyncio.start_server(self.join, "127.0.0.1", 0))
        self.port = server.sockets[0].getsockname()[1]
        self.ready.set()
        self.loop.run_forever()

    def close(self) -> None:
        """End the thread."""
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join(5.0)

    async def join(self, host_reader: asyncio.StreamReader, host_writer: asyncio.StreamWriter) -> None:
        """One station: a line to the robot for it."""
        robot_reader, robot_writer = await asyncio.open_connection("127.0.0.1", self.robot_port)
        with contextlib.suppress(ConnectionError):
            await asyncio.gather(
                self.copy(robot_reader, host_writer, link.Decoder()),
                self.copy(host_reader, robot_writer, link.Decoder()),
            )

    async def copy(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, decoder: link.Decoder) -> None:
        """Bytes one way; a drive command is noted at the time at which its last byte passed."""
        while data := await reader.read(4096):
            now = time.time()
            writer.write(data)
            for frame in decoder.feed(data):
                if frame.channel == channels.DRIVE_COMMAND:
                    self.commands.append((now, any(frame.payload[:4])))
        writer.close()


@contextlib.contextmanager
def started(command: list[str], pattern: str, folder: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A process, and what the pattern's group found in its output; it is interrupted when the block ends."""
    with subprocess.Popen(
        [sys.executable, "-m", *command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=folder,
        env=environment(),
    ) as process:  # fmt: skip
        try:
            assert process.stdout is not None
            said = []
            for said_line in process.stdout:
                said.append(said_line)
                if found := re.search(pattern, said_line):
                    threading.Thread(target=process.stdout.read, daemon=True).start()  # or its pipe fills up
                    yield process, found[1]
                    return
            raise RuntimeError(f"{' '.join(command)} ended early:\n{''.join(said)}")
        finally:
            process.terminate()


def environment() -> dict[str, str]:
    """This one, with the checkout importable from any folder."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
