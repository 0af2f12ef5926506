"""What the boards may be told, as typed values. Nothing here knows a byte format."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DriveCommand:
    """Effect: set the robot's speed (m/s) and turn rate (rad/s)."""

    speed: float
    turn: float


@dataclass(frozen=True, slots=True)
class StopCommand:
    """Effect: stand still at once."""


@dataclass(frozen=True, slots=True)
class ArmCommand:
    """Effect: arm or disarm the drive board."""

    armed: bool


@dataclass(frozen=True, slots=True)
class PowersCommand:
    """Give the motors these powers (-1..1, shares of full) until the deadline (s, at most 1), unless told again."""

    left: float
    right: float
    deadline: float


@dataclass(frozen=True, slots=True)
class RunCommand:
    """Let the bumper cart begin a run of so many bumps (0: until it is stopped), its turns drawn from `seed` (16 bits).

    `is_matched` keeps both wheels at the same count, `is_coarse` by eight powers only. It stops by itself when it has
    heard no command for `leash` (whole seconds to 255; 0: it needs no host).
    """

    bumps: int = 0
    seed: int = 1
    is_matched: bool = False
    leash: int = 0
    is_coarse: bool = False


@dataclass(frozen=True, slots=True)
class UploadCommand:
    """Ask the bumper cart for so many stages of its run's log, from a number on; a command that a leash hears."""

    first: int
    count: int


@dataclass(frozen=True, slots=True)
class AdjustCommand:
    """Ask a board for a setting or set it, store all of them, take the built-in ones, zero the gyro: see `channels`."""

    board: str
    verb: str
    setting: str
    value: float = 0.0


Command = DriveCommand | StopCommand | ArmCommand | PowersCommand | RunCommand | UploadCommand | AdjustCommand
