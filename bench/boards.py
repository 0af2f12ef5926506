"""A robot on the bench, and whoever stands beside it: arms it, drives it, hears what it tells.

Its boards are the real programs under simavr, or the same C on this machine, which is a hundred times as fast.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from firmware.virtual import World
from firmware.virtual.avr import AvrCrunch
from firmware.virtual.avr.programs import Imu
from firmware.virtual.host import HostCrunch
from firmware.virtual.variation import Variation
from server.channels import (
    BALANCE,
    DRIVE,
    LAST_WORDS,
    REASONS,
    SENSOR,
    SETTING,
    STATES,
    STATUS,
    Refused,
    encode_command,
    read,
)
from server.commands import ArmCommand, Command, DriveCommand
from server.link import Decoder, Frame, encode

REFRESH_MS = 100  # between drive commands
MAX_PORTION_MS = 20
ARMING_MS = 5000  # more than it ever needs
OFF = (0.0, 0.0)


def hall(length: float, width: float = 6.0) -> World:
    """An empty hall around the origin, lengthwise along x."""
    x, y = length / 2, width / 2
    walls = [[-x, -y, x, -y], [x, -y, x, y], [x, y, -x, y], [-x, y, -x, -y]]
    return World(np.array(walls), (0.0, 0.0, 0.0), "hall")


class Rider:
    """Holds the robot, lets go, and sends its wish (speed in m/s, turn in rad/s) ten times a second unless silent."""

    def __init__(
        self,
        world: World,
        start: tuple[float, float, float],
        seed: int,
        variation: Variation | None = None,
        is_real: bool = True,
        imu: Imu = "analogue",
    ):
        if is_real:
            self.robot: Any = AvrCrunch(world, start, seed, "none", imu=imu)
        else:
            self.robot = HostCrunch(world, np.array(start), seed, drift="none")
        self.body = self.robot.robot.body
        if variation is not None:
            variation.apply(self.robot.robot)
        self.decoder = Decoder()
        self.balance: tuple = ()  # newest raw payloads,
        self.statuses: dict[int, tuple] = {}  # these by board
        self.last_words: tuple = ()
        self.setting: tuple = ()
        self.wish = (0.0, 0.0)
        self.is_silent = True
        self.echo_ms = 0
        self.sequence = 0

    def send(self, command: Command) -> None:
        """A command with the newest time heard from the drive board."""
        self.sequence = (self.sequence + 1) & 0xFF
        self.robot.write(encode(encode_command(command, self.sequence, self.echo_ms)))

    def hear(self, frame: Frame) -> None:
        """One good frame of a board."""
        try:
            values = read(frame)
        except Refused:
            return
        if frame.source == DRIVE:
            self.echo_ms = frame.time_ms
        if frame.channel == BALANCE:
            self.balance = values
        elif frame.channel == LAST_WORDS:
            self.last_words = values
        elif frame.channel == SETTING:
            self.setting = values
        elif frame.channel == STATUS:
            self.statuses[frame.source] = values

    def live(self, ms: int) -> None:
        """Lets time pass and the wish be told."""
        while ms > 0:
            late = self.robot.robot.now_ms % REFRESH_MS
            if not self.is_silent and late == 0:
                self.send(DriveCommand(*self.wish))
            portion = min(ms, REFRESH_MS - late, MAX_PORTION_MS)
            for frame in self.decoder.feed(self.robot.run(portion)):
                self.hear(frame)
            ms -= portion

    def wait(self, seconds: float) -> None:
        """The same in seconds."""
        self.live(round(1000 * seconds))

    def arm(self) -> bool:
        """Whether it arms in the hand, which lets go when it does; from then on the wish is to stand."""
        self.wait(0.2)
        self.send(ArmCommand(True))
        self.is_silent = False
        for _ in range(ARMING_MS):
            self.live(1)
            if not self.body.is_held:
                return True
        return False

    def tell(self, speed: float, turn: float = 0.0) -> None:
        """The wish from now on."""
        self.wish = (speed, turn)

    @property
    def is_balancing(self) -> bool:
        """Whether it has told so last."""
        return bool(self.balance) and self.told[0] in ("armed", "link lost")

    @property
    def is_off(self) -> bool:
        """Whether the drive board holds the bridges' brake, so that no motor gets current."""
        return self.robot.is_off

    @property
    def has_no_current(self) -> bool:
        """The same, or that the board drives nothing at all, as in a reset."""
        return self.robot.duties == OFF

    @property
    def told(self) -> tuple[str, str]:
        """State and reason in the newest balance frame."""
        return STATES[self.balance[4]], REASONS[self.balance[5]]

    @property
    def reset_causes(self) -> tuple[int, ...]:
        """MCUCSR at the boards' last starts as they tell it."""
        return tuple(self.statuses[board][3] for board in (DRIVE, SENSOR) if board in self.statuses)

    def push(self, newton_seconds: float, seconds: float = 0.05) -> None:
        """A blow at the centre of mass, forward if positive."""
        self.body.push_height = self.body.physique.centre
        self.body.push = newton_seconds / seconds
        self.wait(seconds)
        self.body.push = 0.0

    @property
    def position(self) -> tuple[float, float]:
        """True place (m)."""
        return self.body.x, self.body.y

    def distance(self, place: tuple[float, float]) -> float:
        """m from a place."""
        return math.dist(self.position, place)
