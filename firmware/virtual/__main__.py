"""`python -m firmware.virtual`: a Crunch to connect to when no Crunch is at hand."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import signal
import sys
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

from firmware.virtual.host import DRIFTS
from firmware.virtual.native import CompilerError
from firmware.virtual.plans import PlanError, load_plan
from firmware.virtual.radio import Radio
from firmware.virtual.robot import VirtualCrunch
from firmware.virtual.routes import tour
from firmware.virtual.serve import serve_pty, serve_tcp
from firmware.virtual.worlds import WorldError, load_world

EXAMPLES = """\
examples:
  python -m firmware.virtual --tcp 127.0.0.1:9000
      A robot that stands in the demo office and waits for somebody to drive it.
      Connect with: crunch serve --link tcp://127.0.0.1:9000
  python -m firmware.virtual --world demo --plan demo --tcp 127.0.0.1:9000
      The same robot tours the office twice by itself. A drive command takes over for 3 seconds.
  python -m firmware.virtual --world floor.map --tour 250 --seed 7 --pty ./crunch.tty
      A random tour of 250 m through a CARMEN map, on a pseudo-terminal, as on a serial port.
  python -m firmware.virtual --avr --tcp 127.0.0.1:9000
      The same with both boards' real ATmega32 programs; needs gcc-avr, avr-libc, make and libsimavr-dev.
  python -m firmware.virtual --loss 0.05 --latency 0.06 --bit-errors 1e-5 --tcp 127.0.0.1:9000
      The same over a bad radio.

A world is a built-in name (demo, corridor50), a .toml of walls, a CARMEN .map, or a ROS map_server .yaml.
The robot's firmware is compiled with the system's C compiler on first use.
"""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = argparse.ArgumentParser(
        prog="python -m firmware.virtual",
        description="A virtual Crunch: a balancing robot in a world of walls that speaks the real robot's bytes.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("--world", default="demo", metavar="W", help="world to live in (default: demo)")
    drives = made.add_mutually_exclusive_group()
    drives.add_argument("--plan", metavar="P", help="drive plan to follow: a built-in name or a .toml of waypoints")
    drives.add_argument("--tour", type=float, metavar="M", help="follow a random tour of about M metres")
    made.add_argument("--seed", type=int, default=0, metavar="S", help="same seed, same robot, same noise (default: 0)")
    made.add_argument(
        "--drift", choices=list(DRIFTS), default="medium", help="how badly the wheels slip (default: medium)"
    )
    made.add_argument("--disarmed", action="store_true", help="hold the robot upright until a command arms it")
    made.add_argument(
        "--avr",
        dest="build",
        action="store_const",
        const="avr",
        default="host",
        help="run the boards' real ATmega32 programs under simavr",
    )
    made.add_argument("--speed", type=float, default=1.0, metavar="X", help="times real time (default: 1)")
    where = made.add_mutually_exclusive_group(required=True)
    where.add_argument("--tcp", metavar="HOST:PORT", help="listen here; port 0 takes a free one")
    where.add_argument("--pty", type=Path, metavar="PATH", help="make a pseudo-terminal of this name")
    radio = made.add_argument_group("radio", "without any of these the bytes arrive at once and whole")
    radio.add_argument("--latency", type=float, metavar="SECONDS", help="delay of each chunk")
    radio.add_argument("--loss", type=float, metavar="SHARE", help="share of chunks lost")
    radio.add_argument("--bit-errors", type=float, metavar="RATE", help="share of bits flipped")
    return made


def radio_of(options: argparse.Namespace) -> Radio | None:
    """The radio asked for, if any."""
    asked = {"latency": options.latency, "chunk_loss": options.loss, "bit_error_rate": options.bit_errors}
    given = {name: value for name, value in asked.items() if value is not None}
    return Radio(**given) if given else None


def robot_of(options: argparse.Namespace) -> VirtualCrunch:
    """The robot asked for."""
    world = load_world(options.world)
    plan = load_plan(options.plan) if options.plan else None
    if options.tour is not None:
        plan = tour(world, options.tour, options.seed)
    return VirtualCrunch(
        world,
        seed=options.seed,
        drift=options.drift,
        radio=radio_of(options),
        plan=plan,
        armed=not options.disarmed,
        build=options.build,
    )


def tcp_address(text: str) -> tuple[str, int]:
    """Host and port of HOST:PORT."""
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdigit() or int(port) > 65535:
        raise ValueError(f"--tcp {text}: needs HOST:PORT, such as 127.0.0.1:9000")
    return host.strip("[]"), int(port)


async def until_told(served: Coroutine[Any, Any, None]) -> None:
    """Serves until SIGTERM, which cancels as Ctrl-C does, so that nothing is left behind."""
    task = asyncio.ensure_future(served)
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    await task


def main(arguments: list[str] | None = None) -> int:
    """Runs until interrupted; exit code 2 and one line for what cannot be done."""
    options = parser().parse_args(arguments)

    def ready(address: str) -> None:
        print(f"virtual Crunch in {options.world} at {address}; Ctrl-C ends it", flush=True)

    try:
        if not options.speed > 0.0:
            raise ValueError(f"--speed {options.speed}: needs a number above 0")
        robot = robot_of(options)
        if options.tcp:
            served = serve_tcp(robot, *tcp_address(options.tcp), options.speed, ready)
        else:
            served = serve_pty(robot, options.pty, options.speed, ready)
        with contextlib.suppress(KeyboardInterrupt, asyncio.CancelledError):
            asyncio.run(until_told(served))
    except (WorldError, PlanError, CompilerError, ValueError, OSError) as problem:
        print(f"error: {problem}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
