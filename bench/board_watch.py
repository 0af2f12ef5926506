"""What the drive board obeys, read from the real program's memory, against what the host sent.

The memory is looked at every millisecond. A command that was obeyed is judged one later, when the board has surely
worked out what it wishes; on the line no two fit into that.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from firmware.virtual.avr import AvrCrunch
from firmware.virtual.avr.memory import Memory
from firmware.virtual.avr.programs import programs
from server.channels import milli
from server.commands import Command, DriveCommand, StopCommand

ARMED, LINK_LOST = 1, 3  # of enum drive_state
OLDEST = 1.0  # s: a command that was longer under way is stale
FIELDS = {
    "supervisor.state": "B",
    "supervisor.acknowledged": "B",
    "supervisor.silent_ms": "H",
    "supervisor.wish.speed": "f",
    "supervisor.wish.turn": "f",
    "supervisor.refused": "H",
    "decoder.rejected": "H",
    "tilt.angle": "f",
}
STILL = (np.float32(0), np.float32(0))


@functools.cache
def drive_memory() -> Memory:
    """Where the drive board's real program keeps FIELDS."""
    return Memory(programs().drive, "loop", "drive/loop.h", "struct drive_loop", FIELDS)


class Sent(NamedTuple):
    """What the board should wish after a command, when the host gave it (s), and whether it is a stop."""

    wish: tuple[np.float32, np.float32]
    time: float
    is_stop: bool


class BoardWatch:
    """Counts the commands that the board obeys, and those of them that the host did not send, or to drive long ago.

    A stop is obeyed however old it is, and is counted by itself when it is.
    """

    def __init__(self, robot: AvrCrunch):
        self.robot = robot
        self.memory = drive_memory()
        self.sent: dict[int, Sent] = {}  # the newest of each sequence number
        self.heard = (0, 0)  # acknowledged, ms of silence
        self.is_new = False  # a command was obeyed in the last millisecond
        self.obeyed = self.wrong = self.old_stops = 0
        self.oldest = 0.0  # s, of the commands to drive that were obeyed
        self.has_fallen = False

    def read(self, name: str) -> Any:
        """A variable of the drive board's loop."""
        return self.memory.read(self.robot.robot.drive, name)

    @property
    def is_balancing(self) -> bool:
        """Whether the board does so, in its own opinion."""
        return self.read("supervisor.state") in (ARMED, LINK_LOST)

    def note(self, command: Command, sequence: int) -> None:
        """The host sends this; nothing but stops and what it wants to drive."""
        wish = STILL
        if isinstance(command, DriveCommand):
            speed, turn = (np.float32(milli(value)) for value in (command.speed, command.turn))
            wish = (speed / np.float32(1000), turn / np.float32(1000))  # as the board works it out
        self.sent[sequence] = Sent(wish, self.robot.time, isinstance(command, StopCommand))

    def begin(self) -> None:
        """What the board has heard so far is known."""
        self.heard = (self.read("supervisor.acknowledged"), self.read("supervisor.silent_ms"))

    def look(self) -> None:
        """A millisecond has passed: was a command obeyed in it, and which was in the one before?"""
        if self.is_new:
            self.judge(self.sent.get(self.heard[0]))
        before = self.heard
        self.begin()
        self.has_fallen |= not self.is_balancing
        self.is_new = self.heard[0] != before[0] or self.heard[1] < before[1]
        self.obeyed += self.is_new

    def judge(self, sent: Sent | None) -> None:
        """The board wishes what the newest command of that number says, and that is a stop or not old."""
        wish = (np.float32(self.read("supervisor.wish.speed")), np.float32(self.read("supervisor.wish.turn")))
        if sent is None or wish != sent.wish:
            self.wrong += 1
            return
        age = self.robot.time - sent.time
        if sent.is_stop:
            self.old_stops += age > OLDEST
            return
        self.oldest = max(self.oldest, age)
        self.wrong += age > OLDEST
