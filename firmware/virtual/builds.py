"""Which build of the boards moves a virtual robot: the one place that chooses.

Both run the same C and move the same body. `host` is compiled for this machine and a thousand times as fast as the
clock; `avr` is the real ATmega32 programs under simavr, with their interrupts, timers and the line that they share.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, Protocol

import numpy as np

from firmware.virtual.cart_board import HostCart
from firmware.virtual.host import DRIFTS, Drift, HostCrunch
from firmware.virtual.motor_board import MotorBoard
from firmware.virtual.worlds import World

Build = Literal["host", "avr"]
BUILDS: tuple[Build, ...] = ("host", "avr")


class Motors(Protocol):
    """Maze Runner's motor board: the powers (-1..1) that its motors have, and its battery (V), which may be set."""

    battery: float

    @property
    def powers(self) -> tuple[float, float]: ...

    def run(self, ms: int) -> bytes: ...

    def receive(self, data: bytes) -> None: ...


class Cart(Protocol):
    """The bumper cart's board with the body that it moves; `run` and `receive` are its end of the line."""

    @property
    def body(self) -> Any: ...

    def run(self, ms: int) -> bytes: ...

    def receive(self, data: bytes) -> None: ...


class Boards(Protocol):
    """Two boards, the body they move, and the truth about it; `run` and `receive` are their ends of the line."""

    @property
    def time(self) -> float: ...

    @property
    def body(self) -> Any: ...

    @property
    def pose(self) -> np.ndarray: ...

    @property
    def tilt(self) -> float: ...

    @property
    def state(self) -> str: ...

    @property
    def accepted(self) -> tuple[int, int, int]: ...

    def truth(self) -> tuple[np.ndarray, np.ndarray]: ...

    def stand(self) -> bool: ...

    def steer(self, speed: float, turn: float) -> None: ...

    def run(self, ms: int) -> bytes: ...

    def receive(self, data: bytes) -> None: ...


def boards_of(build: Build, world: World, start: np.ndarray, seed: int, drift: Drift) -> Boards:
    """Boards with their body in a hand. ValueError for what is not known, CompilerError for what cannot be built."""
    if drift not in DRIFTS:
        raise ValueError(f"no drift {drift!r}; known are {', '.join(DRIFTS)}")
    match build:
        case "host":
            return HostCrunch(world, start, seed, drift)
        case "avr":
            from firmware.virtual.avr import AvrCrunch  # needs simavr: only who asks for it

            return AvrCrunch(world, start, seed, drift)
    raise ValueError(f"no build {build!r} of the boards; known are {', '.join(BUILDS)}")


def cart_of(build: Build, world: World, pose: Sequence[float], parts: Sequence[float], seed: int) -> Cart:
    """A cart's board and body that were just switched on; `parts` are what struct cart_build holds, in its order.

    ValueError for an unknown build, CompilerError where it is not built.
    """
    match build:
        case "host":
            return HostCart(world, pose, parts, seed)
        case "avr":
            from firmware.virtual.avr.cart import AvrCart  # needs simavr: only who asks for it

            return AvrCart(world, pose, parts, seed)
    raise ValueError(f"no build {build!r} of the boards; known are {', '.join(BUILDS)}")


def motor_board_of(build: Build) -> Motors:
    """A motor board that was just switched on. ValueError for an unknown build, CompilerError where it is not built."""
    match build:
        case "host":
            return MotorBoard()
        case "avr":
            from firmware.virtual.avr.motor_board import AvrMotorBoard  # needs simavr: only who asks for it

            return AvrMotorBoard()
    raise ValueError(f"no build {build!r} of the boards; known are {', '.join(BUILDS)}")
