"""`crunch calibrate`: commands that learn a robot's parameters from its logs. Uses its sibling `terminal`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from server.errors import UserError
from server.terminal import (
    Assignments,
    Beams,
    ConfigFile,
    MaxRange,
    Particles,
    Preset,
    Robot,
    Seed,
    Threads,
    check_beams,
    progress_bar,
    settings_flags,
)

if TYPE_CHECKING:
    from server.odometry_calibration import Calibration

SHARES = 1000  # steps of the bar

app = typer.Typer(name="calibrate", help="Learn a robot's parameters from its logs.", rich_markup_mode=None)


@app.command()
def odometry(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs of one robot, as `crunch replay` reads.")],
    output: Annotated[Path | None, typer.Option(help="TOML file for what was learned; `--config` reads it.")] = None,
    robot: Robot = None,
    particles: Particles = None,
    seed: Seed = 0,
    threads: Threads = None,
    beams: Beams = None,
    max_range: MaxRange = None,
    preset: Preset = None,
    config: ConfigFile = None,
    assignments: Assignments = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but errors.")] = False,
) -> None:
    """Learn how badly a robot's odometry errs, from logs that come back to places they have seen.

    Prints each parameter's estimate, the interval that holds it with 95 %, the present value and what the logs say
    about it; then the settings for a file behind --config. Several logs of the same robot give one answer.

    \b
        crunch calibrate odometry drive.rlog
        crunch calibrate odometry monday.rlog tuesday.rlog --output robot.toml
        crunch replay wednesday.rlog --out map --config robot.toml
        crunch calibrate odometry maze.rlog
        crunch calibrate odometry intel.log --robot maze_runner

    Maze Runner's laser tells how it truly moved, so that its logs need not come back to anything. Recordings say whose
    they are; other logs are Crunch's unless --robot says otherwise.
    """
    import os

    from server import laser_calibration, odometry_calibration
    from server.config import check_robot
    from server.formats.atomic import write_atomically
    from server.replay import Options

    check_beams(beams, max_range)
    robot = robot or recorded_robot(logs)
    if robot:
        check_robot(robot)
    flags = settings_flags(preset, particles, robot)
    threads = threads or os.cpu_count() or 1
    options = Options(robot or "", seed, threads, beams, max_range, config, flags, assignments or ())
    with progress_bar("calibrating", SHARES, quiet) as bar:
        calibrate = (laser_calibration if robot == laser_calibration.NAME else odometry_calibration).calibrate
        found = calibrate(logs, options, (lambda share: bar(round(SHARES * share))) if bar else None)
    for warning in found.warnings:
        typer.echo(f"crunch: warning: {warning}", err=True)
    if output is not None:
        write_atomically(output, found.toml())
    if not quiet:
        typer.echo(table(found))
        typer.echo(f"\n{output}: written" if output else f"\n{found.toml()}", nl=output is not None)


def recorded_robot(logs: list[Path]) -> str | None:
    """The robot that all recordings among the logs are of; None if there are none."""
    from server.recorded import robot_of

    robots = {robot: path for path in logs if (robot := robot_of(path))}
    if len(robots) > 1:
        told = ", ".join(f"{path} of {robot}" for robot, path in sorted(robots.items()))
        raise UserError(f"the recordings are of several robots: {told}; calibrate each by its own")
    return next(iter(robots), None)


@app.command()
def sonar(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Logs of repeated readings of one sonar.")],
    band: Annotated[float, typer.Option(help="Width of the bands of range, in metres.")] = 0.25,
    config: ConfigFile = None,
) -> None:
    """Learn how much a sonar's readings vary, from repeats of each while it stood.

    Prints, by bands of range, the standard deviation of the readings, the share of outliers and the share of readings
    without echo, each with the interval that holds it with 95 %; then what that says about the present settings.

    \b
        crunch calibrate sonar ev3.log
        crunch calibrate sonar monday.log tuesday.log --band 0.5
    """
    from server.config import load
    from server.sonar_calibration import calibrate

    found = calibrate(files, band)
    lines = found.notes(load(file=config).crunch.local_map)
    typer.echo("\n".join([aligned(found.rows()), "", *lines]))


@app.command()
def motors(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="CSV files of trials: power,distance,time.")],
    plot: Annotated[Path | None, typer.Option(help="Picture of trials and curves: .png, .jpg, .svg or .pdf.")] = None,
    output: Annotated[Path | None, typer.Option(help="TOML file for what was learned; `--config` reads it.")] = None,
) -> None:
    """Learn how fast a power drives motors that have no encoders: power = A exp(B speed).

    A trial is a share of full power, the metres that the robot went with it, and the seconds that it took; a column
    `wheel` with left or right gives each motor a curve of its own. Prints the curves, how far each trial is off, and
    the settings for a file behind --config.

    \b
        crunch calibrate motors trials.csv --plot trials.png
        crunch calibrate motors trials.csv --output robot.toml
    """
    from server.formats.atomic import write_atomically
    from server.motor_calibration import calibrate, picture_kind

    kind = picture_kind(plot) if plot else ""
    found = calibrate(files)
    if plot is not None:
        write_atomically(plot, found.plot(kind))
    if output is not None:
        write_atomically(output, found.toml())
    typer.echo(f"{aligned(found.rows())}\n\n{aligned(found.residual_rows())}")
    if plot is not None:
        typer.echo(f"\n{plot}: written")
    typer.echo(f"\n{output}: written" if output else f"\n{found.toml()}", nl=output is not None)


@app.command()
def cart(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Recordings of one bumper cart.")],
    world: Annotated[
        str | None, typer.Option("--map", help="Where it drove: a world as of simulate's --world.")
    ] = None,
    path: Annotated[
        list[Path] | None, typer.Option(metavar="FILE", help="What a camera above saw (TUM), one for each log.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Raw path before and after: .png, .jpg, .svg or .pdf.")] = None,
    output: Annotated[Path | None, typer.Option(help="TOML file for what was learned; `--config` reads it.")] = None,
    seed: Seed = 0,
    config: ConfigFile = None,
    assignments: Assignments = None,
) -> None:
    """Learn a bumper cart's wheelbase, tick, bumper and noise, from runs on a known map, under a camera, or alone.

    Prints each parameter's estimate with the interval that holds it with 90 %, and the settings for a file behind
    --config. Without a map and a camera the cart's own map of its bumps tells all but the tick, which stays as it is
    set. The camera's frame and clock may be its own.

    \b
        crunch calibrate cart run.rlog
        crunch calibrate cart run.rlog --map room.toml
        crunch calibrate cart monday.rlog tuesday.rlog --map room.toml --output cart.toml
        crunch calibrate cart run.rlog --path run.rlog.truth.tum --plot paths.png
    """
    from server.cart_calibration import calibrate
    from server.formats.atomic import write_atomically
    from server.motor_calibration import picture_kind
    from server.replay import Options

    kind = picture_kind(plot) if plot else ""
    options = Options("bumper_cart", seed, 1, None, None, config, {}, assignments or ())
    found = calibrate(logs, world, options, path or ())
    for warning in found.warnings:
        typer.echo(f"crunch: warning: {warning}", err=True)
    if plot is not None:
        write_atomically(plot, found.plot(kind))
    if output is not None:
        write_atomically(output, found.toml())
    typer.echo(aligned(found.rows()))
    if plot is not None:
        typer.echo(f"\n{plot}: written")
    typer.echo(f"\n{output}: written" if output else f"\n{found.toml()}", nl=output is not None)


def table(found: Calibration) -> str:
    """What was learned, by parameter and by log, as text of two tables."""
    rows = [("parameter", "estimate", "95 % interval", "present", "what the logs say")]
    rows += [(row.name, f"{row.estimate:.3g}", row.interval, f"{row.present:.3g}", row.verdict) for row in found.rows]
    drives = [("log", "metres", "measured", "turn bias (deg/m)")]
    drives += [(drive.name, f"{drive.metres:.0f}", f"{drive.measurements}", drive.turn_bias) for drive in found.drives]
    likelier = f"the logs are e^{found.gain:.1f} times likelier than with the present values"
    return f"{aligned(rows)}\n\n{aligned(drives)}\n\n{found.left_out} measurements left out as outliers; {likelier}"


def aligned(rows: list[tuple[str, ...]]) -> str:
    """Columns as wide as their widest text."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
