"""What the commands share: options, settings from flags, folders for results, a bar, one line for an error."""

from __future__ import annotations

import contextlib
import importlib
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer

from server.errors import UserError

if TYPE_CHECKING:
    from server.config import Config
    from server.live import LiveOptions
    from server.replay import Progress

Drift = Literal["none", "low", "medium", "high"]
DRIFTS = ("none", "low", "medium", "high")
Build = Literal["host", "avr"]  # of the virtual robot's boards

Robot = Annotated[
    str | None, typer.Option(help="Which robot: crunch, maze_runner or bumper_cart.", show_default="the log's own")
]
OneRobot = Annotated[str, typer.Option(help="Which robot: crunch, maze_runner or bumper_cart.")]
Seed = Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Same seed, same log: the same bytes come out.")]
Threads = Annotated[int | None, typer.Option(min=1, help="Threads of the filter.", show_default="all cores")]
ConfigFile = Annotated[Path | None, typer.Option("--config", help="Settings (TOML), as in config.toml.")]
Assignments = Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="One setting; repeatable.")]
Preset = Annotated[
    str | None, typer.Option(help="`default`; `thesis`: literally as Crunch's thesis has it; or another robot's.")
]
Avr = Annotated[bool, typer.Option("--avr", help="The boards' real ATmega32 programs, under simavr.")]
Beams = Annotated[int | None, typer.Option(min=2, help="Thin a laser to so many evenly spread beams.")]
MaxRange = Annotated[float | None, typer.Option(min=0.1, help="Reach (m) of those beams.", show_default="5.0")]
Particles = Annotated[int | None, typer.Option(help="Particles of the path filter.", show_default="40000")]
CartMap = Annotated[
    str | None,
    typer.Option("--map", metavar="WORLD", help="Where Bumper Cart is, to be found there: a world, as of --world."),
]


def settings_flags(
    preset: str | None, particles: int | None, robot: str | None, where: str | None = None
) -> dict[str, Any]:
    """The flags that are settings, nested as in config.toml; UserError where a preset or map is not for the robot."""
    from server.config import check_robot

    check_preset(preset, robot or "crunch")
    flags: dict[str, Any] = {"preset": preset} if preset is not None else {}
    if particles is not None:
        filters = {"localizer": {"particles": particles}, "mapper": {"n_particles": particles}}
        flags[robot or "crunch"] = filters if robot == "bumper_cart" else {"filter": {"particles": particles}}
    if where is not None:
        check_robot(robot or "crunch", ("bumper_cart",), "robots that are found on a map")
        flags["bumper_cart"] = {**flags.get("bumper_cart", {}), "map": where}
    return flags


def check_preset(preset: str | None, robot: str) -> None:
    """UserError for a preset that says nothing about a robot."""
    from server.presets import NAMED

    robots = NAMED.get(preset or "", {robot: {}})
    if robot not in robots:
        raise UserError(f"preset `{preset}` is for {' and '.join(robots)}, not for {robot}; leave out --preset")


def folders_for(logs: list[Path], out: Path) -> list[Path]:
    """Where each log's results go: `out` itself for one, else a folder in it by the log's name; no two alike."""
    if len(logs) == 1:
        return [out]
    folders: list[Path] = []
    for path in logs:
        name, number = path.stem, 2
        while out / name in folders:
            name, number = f"{path.stem}-{number}", number + 1
        folders.append(out / name)
    return folders


@contextlib.contextmanager
def progress_bar(title: str, total: int | None, quiet: bool) -> Iterator[Progress | None]:
    """A bar on standard error while something long runs; nothing where no one is looking. Gives what moves it."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)


def live_settings(robot: str, flags: dict[str, Any], file: Path | None, assignments: Sequence[str] | None) -> Config:
    """The settings of a live session, for which the working directory's config.toml counts."""
    from server.config import check_robot, load, working_file
    from server.recorded import check_senses

    check_robot(robot)
    settings = load(flags, file or working_file(), None, assignments or ())
    check_senses(robot, settings)
    return settings


def live_options(robot: str, config: Config, host: str | None, port: int | None, opens_browser: bool) -> LiveOptions:
    """How to serve: flags first, then the settings."""
    from server.live import LiveOptions

    return LiveOptions(
        config=config,
        robot=robot,
        host=config.web.host if host is None else host,
        port=config.web.port if port is None else port,
        opens_browser=opens_browser,
    )


def check_beams(beams: int | None, max_range: float | None) -> None:
    """UserError for a reach of beams that nothing is thinned to."""
    if max_range is not None and beams is None:
        raise UserError("--max-range only counts with --beams; add --beams N")


def build_of(avr: bool) -> Build:
    """What the flag --avr asks for."""
    return "avr" if avr else "host"


def known_drift(name: str) -> Drift:
    """The level of drift; UserError where there is none of that name."""
    if name not in DRIFTS:
        raise UserError(f"drift `{name}` is unknown; choose {', '.join(DRIFTS)}")
    return cast(Drift, name)


def benchmarks() -> ModuleType:
    """The checkout's `bench.command`, which is not installed with the package; UserError where there is no checkout."""
    root = Path(__file__).resolve().parents[1]
    if not (root / "bench" / "command.py").is_file():
        raise UserError(
            f"the benchmarks are not in {root}, for they are not installed with crunch; "
            "run `make setup` in a checkout of its sources and then .venv/bin/crunch there"
        )
    if str(root) not in sys.path:
        sys.path.insert(0, str(root))
    return importlib.import_module("bench.command")


def complain(message: str, code: int) -> int:
    """Say on one line of standard error what went wrong."""
    typer.echo(f"crunch: error: {' '.join(message.split())}", err=True)
    return code
