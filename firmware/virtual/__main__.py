"""`python -m firmware.virtual`: a Crunch or a Maze Runner to connect to when none is at hand."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import signal
import sys
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, Literal

from firmware.virtual.host import DRIFTS
from firmware.virtual.maze_runner import VirtualMazeRunner
from firmware.virtual.native import CompilerError
from firmware.virtual.plans import PlanError, load_plan
from firmware.virtual.radio import Radio
from firmware.virtual.robot import VirtualCrunch
from firmware.virtual.routes import tour
from firmware.virtual.serve import serve_pty, serve_tcp, serve_with_laser
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
  python -m firmware.virtual --robot maze_runner --tcp 127.0.0.1:9000 --laser-tcp 127.0.0.1:9001
      A Maze Runner in a random maze, whose laser has a line of its own.
      Connect with: crunch serve --robot maze_runner --link tcp://127.0.0.1:9000 --laser tcp://127.0.0.1:9001

A world is a built-in name (demo, corridor50, maze:medium:3), a .toml of walls, a CARMEN .map, or a ROS .yaml.
The robot's firmware is compiled with the system's C compiler on first use.
"""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = argparse.ArgumentParser(
        prog="python -m firmware.virtual",
        description="A virtual robot, Crunch or Maze Runner, in a world of walls that speaks the real one's bytes.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument(
        "--robot", choices=["crunch", "maze_runner"], default="crunch", help="which robot (default: crunch)"
    )
    made.add_argument("--world", metavar="W", help="world to live in (default: demo, or maze:medium:S by the seed)")
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
    made.add_argument("--laser-tcp", metavar="HOST:PORT", help="a Maze Runner's laser listens here")
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


def check_robot(options: argparse.Namespace) -> None:
    """ValueError for what the robot does not have."""
    if options.robot == "crunch":
        if options.laser_tcp:
            raise ValueError("--laser-tcp: a Crunch has no laser; leave it out, or add --robot maze_runner")
        return
    if not (options.tcp and options.laser_tcp):
        raise ValueError("--robot maze_runner: needs --tcp for its board and --laser-tcp for its laser")
    given = {"--plan": options.plan, "--tour": options.tour is not None, "--disarmed": options.disarmed}
    for flag in (flag for flag, is_given in given.items() if is_given):
        raise ValueError(f"{flag}: is for a Crunch; a Maze Runner is driven by its host")


def maze_runner_of(options: argparse.Namespace) -> VirtualMazeRunner:
    """The Maze Runner asked for."""
    return VirtualMazeRunner(
        load_world(options.world),
        seed=options.seed,
        drift=options.drift,
        radio=radio_of(options),
        build=options.build,
    )


def crunch_of(options: argparse.Namespace) -> VirtualCrunch:
    """The Crunch asked for."""
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


def serving(options: argparse.Namespace, ready: Callable[[str], None]) -> Coroutine[Any, Any, None]:
    """The robot asked for, served where it was asked for."""
    check_robot(options)
    if options.robot == "maze_runner":
        board, laser = tcp_address(options.tcp), tcp_address(options.laser_tcp, "--laser-tcp")
        return serve_with_laser(maze_runner_of(options), board, laser, options.speed, ready)
    if options.tcp:
        where = tcp_address(options.tcp)
        return serve_tcp(crunch_of(options), *where, options.speed, ready)
    return serve_pty(crunch_of(options), options.pty, options.speed, ready)


def tcp_address(text: str, flag: Literal["--tcp", "--laser-tcp"] = "--tcp") -> tuple[str, int]:
    """Host and port of HOST:PORT."""
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdigit() or int(port) > 65535:
        raise ValueError(f"{flag} {text}: needs HOST:PORT, such as 127.0.0.1:9000")
    return host.strip("[]"), int(port)


async def until_told(served: Coroutine[Any, Any, None]) -> None:
    """Serves until SIGTERM, which cancels as Ctrl-C does, so that nothing is left behind."""
    task = asyncio.ensure_future(served)
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    await task


def main(arguments: list[str] | None = None) -> int:
    """Runs until interrupted; exit code 2 and one line for what cannot be done."""
    options = parser().parse_args(arguments)

    name = "Crunch" if options.robot == "crunch" else "Maze Runner"
    options.world = options.world or ("demo" if options.robot == "crunch" else f"maze:medium:{options.seed}")

    def ready(address: str) -> None:
        print(f"virtual {name} in {options.world} at {address}; Ctrl-C ends it", flush=True)

    try:
        if not options.speed > 0.0:
            raise ValueError(f"--speed {options.speed}: needs a number above 0")
        served = serving(options, ready)
        with contextlib.suppress(KeyboardInterrupt, asyncio.CancelledError):
            asyncio.run(until_told(served))
    except (WorldError, PlanError, CompilerError, ValueError, OSError) as problem:
        print(f"error: {problem}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
