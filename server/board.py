"""`crunch board`: the two boards on a link, live in the terminal, and what is to be adjusted on them."""

from __future__ import annotations

import contextlib
import json
import logging
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from server.errors import UserError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from server.commands import AdjustCommand
    from server.workbench import Workbench

LISTENING = 5.0  # s, where somebody only wants to know
WORKING = 1.0  # s at least, where something is to be done
REFRESHES = 5  # of the picture, per second

LINK = "serial:DEVICE[?baud=38400], tcp://HOST:PORT, pty:PATH, or virtual:[WORLD] for one that is not there."
SET = "One setting, such as tilt=4.2 or odometry_ms=40 (docs/wire.md lists them); repeatable, in this order."


def board(
    link: Annotated[str, typer.Argument(metavar="LINK", help=LINK)],
    built_in: Annotated[bool, typer.Option("--built-in", help="First go back to the built-in settings.")] = False,
    sets: Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help=SET)] = None,
    zero_gyro: Annotated[
        bool, typer.Option("--zero-gyro", help="Learn the gyro's zero now: at rest, not while balancing.")
    ] = False,
    level: Annotated[
        bool, typer.Option("--level", help="The robot is held upright: learn what its accelerometer shows there.")
    ] = False,
    store: Annotated[bool, typer.Option("--store", help="Then keep all settings in the boards' EEPROMs.")] = False,
    get: Annotated[bool, typer.Option("--get", help="Then ask for all settings.")] = False,
    seconds: Annotated[
        float | None,
        typer.Option(min=0.1, help="Listen so long.", show_default="until Ctrl-C; 5 where no one looks on"),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object at the end, and nothing else.")
    ] = False,
) -> None:
    """Look at a robot's two boards and adjust them: telemetry, link, gains, rates of streams, the gyro's zero.

    It opens no port and drives nothing. Settings are refused by the board if they are out of bounds, or if the streams
    would take half of the line; what is not stored is gone after a reset.

    \b
        crunch board serial:/dev/ttyUSB0
        crunch board serial:/dev/ttyUSB0 --set tilt=5.6 --set tilt_rate=0.6 --store
        crunch board tcp://127.0.0.1:9000 --set infrared_ms=400 --set sonar_ms=200 --set odometry_ms=10
        crunch board pty:./crunch.tty --zero-gyro
        crunch board virtual: --get --json --seconds 10
    """
    from server.workbench import Work, run

    commands = commands_of(built_in, sets or [], zero_gyro, level, store)
    is_live = sys.stdout.isatty() and not as_json
    if seconds is None and not is_live:
        seconds = WORKING if commands or get else LISTENING
    work = Work(link, seconds, commands, get or bool(commands) or is_live)
    with quiet_links():
        done = run(work, live if is_live else unwatched)
    if as_json:
        typer.echo(json.dumps(done.report(), indent=2))
    elif not is_live:
        show(done)


@contextlib.contextmanager
def quiet_links() -> Iterator[None]:
    """No warnings of links meanwhile: what is wrong with one is told at the end."""
    logger = logging.getLogger("server.transport")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


@contextlib.contextmanager
def unwatched(bench: Workbench) -> Iterator[Callable[[], None]]:
    """No one looks on."""
    yield lambda: None


def commands_of(built_in: bool, sets: list[str], zero_gyro: bool, level: bool, store: bool) -> list[AdjustCommand]:
    """The adjustments that the flags ask for, in their order; UserError for a setting that there is not."""
    from server.boards import both, setting
    from server.commands import AdjustCommand

    commands = both("built in") if built_in else []
    for text in sets:
        commands += setting(*assignment(text))
    if zero_gyro:
        commands.append(AdjustCommand("drive", "zero gyro", "odometry_ms"))
    if level:
        commands.append(AdjustCommand("drive", "level", "level"))
    return commands + (both("store") if store else [])


def assignment(text: str) -> tuple[str, float]:
    """Name and value of `tilt=4.2`."""
    import difflib

    from server.channels import SETTINGS

    name, sign, value = text.partition("=")
    if name not in SETTINGS:
        near = difflib.get_close_matches(name, SETTINGS, 1)
        hint = f"did you mean `{near[0]}`?" if near else f"known are {', '.join(SETTINGS)}"
        raise UserError(f"--set {text}: `{name}` is no setting; {hint}")
    try:
        number = float(value)
    except ValueError:
        raise UserError(f"--set {text}: needs a number, such as {name}=1.5") from None
    if not sign or abs(number) > 1e30:
        raise UserError(f"--set {text}: needs a number that a board can hold")
    return name, number


@contextlib.contextmanager
def live(bench: Workbench) -> Iterator[Callable[[], None]]:
    """A picture that is kept up to date; Ctrl-C is its usual end."""
    from rich.live import Live

    with Live(picture(bench), refresh_per_second=REFRESHES) as screen, contextlib.suppress(KeyboardInterrupt):
        yield lambda: screen.update(picture(bench))


def show(bench: Workbench) -> None:
    """The last picture, as text."""
    from rich.console import Console

    Console(highlight=False).print(picture(bench))


def picture(bench: Workbench) -> RenderableType:
    """All that is known, as tables."""
    from rich.console import Group

    report = bench.report()
    link = report["link"]
    head = f"{link['spec']}  {link['seconds']:.0f} s"
    if not link["frames"]:
        return Group(f"{head}  {bench.complaint() if bench.t > 2.0 else 'listening'}")
    line = (
        f"{head}  {link['received_bytes_per_s']:.0f} B/s in, {link['sent_bytes_per_s']:.0f} out: "
        f"{link['share_percent']:.1f} % of the line  lost {link['lost']}  rejected {link['rejected']}"
    )
    tables = [boards_table(report["boards"]), streams_table(link), telemetry_table(report["telemetry"])]
    if any(report["settings"].values()):
        tables.append(settings_table(report["settings"]))
    doing = bench.errands.asked
    foot = [f"{doing.command.verb} {doing.command.setting} ..."] if doing and doing.command.verb != "ask" else []
    return Group(line, *tables, *[answer_line(answer) for answer in report["answers"]], *foot)


def answer_line(answer: dict[str, Any]) -> str:
    """What came of an adjustment."""
    name = f"{answer['setting']} = {answer['value']:g}" if answer["verb"] == "set" else ""
    zero = f"{answer['value']:.4f} rad/s" if answer["verb"] == "zero gyro" else ""
    zero += f"{answer['value']:.4f} g" if answer["verb"] == "level" else ""
    return f"{answer['board']}: {answer['verb']} {name}{zero} {answer['outcome']}"


def table_of(*headings: str) -> Any:
    """A table without frills."""
    from rich import box
    from rich.table import Table

    return Table(*headings, box=box.SIMPLE_HEAD, pad_edge=False)


def boards_table(boards: dict[str, dict[str, Any]]) -> RenderableType:
    """One row for each fact, one column for each board."""
    table = table_of("board", *boards)
    rows = ("state", "reason", "settings", "uptime_s", "boots", "reset_cause", "worst_loop_ms", "rx_errors", "build")
    for name in (*rows, "age_s", "lost", "lost_percent", "clock_ppm", "reboots"):
        table.add_row(name, *(text_of(report.get(name)) for report in boards.values()))
    return table


def streams_table(link: dict[str, Any]) -> RenderableType:
    """Frames by channel: in all and per second."""
    table = table_of("stream", *link["frames"])
    table.add_row("per s", *(text_of(link["frames_per_s"].get(name)) for name in link["frames"]))
    table.add_row("frames", *map(str, link["frames"].values()))
    return table


def telemetry_table(telemetry: dict[str, Any]) -> RenderableType:
    """The newest measurements."""
    table = table_of("measured", "")
    for name, value in telemetry.items():
        if name not in ("state", "reason"):
            table.add_row(name, text_of(value))
    return table


def settings_table(settings: dict[str, dict[str, dict[str, Any]]]) -> RenderableType:
    """Values in force; a star marks what a reset would undo. Both boards know the streams' periods, or should."""
    table, apart = table_of("setting", *settings), []
    for name in next(iter(settings.values())):
        cells = [known.get(name) for known in settings.values()]
        table.add_row(name, *("" if c is None else f"{c['value']:g}{'' if c['stored'] else ' *'}" for c in cells))
        if len({cell["value"] for cell in cells if cell is not None}) > 1:
            apart.append(name)
    table.caption = "* not stored" + (f"; the boards differ in {', '.join(apart)}: set it again" if apart else "")
    return table


def text_of(value: Any) -> str:
    """A value for a cell."""
    if isinstance(value, list):
        return " ".join("-" if item is None else f"{item:.2f}" for item in value)
    return "-" if value is None else str(value)
