"""Every robot that there is, one row each: its fold, its estimator, and the lines that it speaks on.

A row's name is also that of the robot's table in the settings. Uses its siblings `crunch`,
`maze_runner` and `bumper_cart`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from server import channels
from server.robots import bumper_cart, crunch, maze_runner

LASER = "laser"  # name of the line on which a laser speaks for itself
MOUSE = "mouse"  # and, with its number behind it, of that of an optical mouse


class Kind(NamedTuple):
    """A robot: `fold` is made of its parameters, `make_estimator` of them, a seed and a number of threads."""

    fold: Callable[[Any], Any]
    make_estimator: Callable[[Any, int, int], Any]
    boards: tuple[int, ...]  # their source numbers
    has_laser: bool = False  # with a line of its own
    mice: int = 0  # optical ones that it may have, each with a line of its own
    explores: bool = False  # whether `server.explorer` can drive it
    bumps: bool = False  # whether it runs by itself, from bump to bump, and knows nothing but that


ROBOTS: dict[str, Kind] = {
    "crunch": Kind(crunch.Crunch, crunch.make_estimator, (channels.DRIVE, channels.SENSOR)),
    "maze_runner": Kind(
        maze_runner.MazeRunner, maze_runner.make_estimator, (channels.MOTOR,), has_laser=True, mice=8, explores=True
    ),
    "bumper_cart": Kind(bumper_cart.BumperCart, bumper_cart.make_estimator, (channels.CART,), bumps=True),
}


def mouse_lines(count: int) -> tuple[str, ...]:
    """The names of the lines of so many mice."""
    return tuple(f"{MOUSE}{number}" for number in range(count))
