"""What the commands share: settings out of flags, folders for results, a bar on the terminal, one line for an error."""

from __future__ import annotations

import contextlib
import importlib
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, cast

import typer

from server.errors import UserError

if TYPE_CHECKING:
    from server.config import Config
    from server.live import LiveOptions
    from server.replay import Progress

Drift = Literal["none", "low", "medium", "high"]
DRIFTS = ("none", "low", "medium", "high")


def settings_flags(preset: str | None, particles: int | None, robot: str | None) -> dict[str, Any]:
    """The flags that are settings, nested as in config.toml."""
    flags: dict[str, Any] = {"preset": preset} if preset is not None else {}
    if particles is not None:
        flags[robot or "crunch"] = {"filter": {"particles": particles}}
    return flags


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


def live_settings(
    file: Path | None, preset: str | None, particles: int | None, assignments: Sequence[str] | None
) -> Config:
    """The settings of a live session, for which the working directory's config.toml counts."""
    from server.config import load, working_file
    from server.recorded import check_rings

    settings = load(settings_flags(preset, particles, None), file or working_file(), None, assignments or ())
    check_rings(settings.crunch.sensors)
    return settings


def live_options(config: Config, host: str | None, port: int | None, opens_browser: bool) -> LiveOptions:
    """How to serve: flags first, then the settings."""
    from server.live import LiveOptions

    return LiveOptions(
        config=config,
        host=config.web.host if host is None else host,
        port=config.web.port if port is None else port,
        opens_browser=opens_browser,
    )


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
