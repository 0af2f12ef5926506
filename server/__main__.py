"""The `crunch` command. Each command imports what it needs when it runs, so that help comes at once.

Exit codes: 0 done, 1 a mistake of ours or a benchmark's finding, 2 something that the caller can mend, told in one
line. Uses its siblings `terminal`, `calibrate`, `board`, `swarm` and `flash`, which import as late.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from server import calibrate, flash
from server.board import board
from server.errors import UserError
from server.swarm import merge
from server.terminal import (
    Assignments,
    Avr,
    Beams,
    CartMap,
    ConfigFile,
    MaxRange,
    OneRobot,
    Particles,
    Preset,
    Robot,
    Seed,
    Threads,
    benchmarks,
    build_of,
    check_beams,
    complain,
    folders_for,
    known_drift,
    live_options,
    live_settings,
    progress_bar,
    settings_flags,
)

ABOUT = """Maps buildings with robots that sense almost nothing.

No robot at hand? `crunch demo` drives a virtual one that speaks the same bytes.

\b
    crunch demo --autopilot                       watch a map grow in the browser
    crunch serve --link serial:/dev/ttyUSB0       drive a real robot
    crunch replay drive.rlog --out map            make a map from a recording
    crunch score map --truth drive.rlog.truth.tum compare it with the truth

`crunch COMMAND --help` tells more. Settings: docs/cli.md.
"""

app = typer.Typer(
    name="crunch",
    help=ABOUT,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)

UsageError: Any = typer.BadParameter.__base__  # typer carries its own copy of click and shows only leaves of its errors
CommandError: Any = UsageError.__base__

app.add_typer(calibrate.app)
app.add_typer(flash.app)

Port = Annotated[int | None, typer.Option(min=0, max=65535, help="Port of the page; 0 takes any.", show_default="8000")]
Host = Annotated[str | None, typer.Option(help="Address to listen on.", show_default="127.0.0.1")]
LiveThreads = Annotated[int, typer.Option(min=1, help="Threads of the filter.")]
Browser = Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")]
Recordings = Annotated[Path, typer.Option(help="Folder for the session's recording.")]
Record = Annotated[bool, typer.Option("--record/--no-record", help="Keep the bytes that came and went.")]
Name = Annotated[str, typer.Option(help="What to call the session.", show_default="none")]
WORLD = "A built-in world (demo, cut-rectangle, maze:medium:3, polygon:3) or a file: TOML, CARMEN .map, ROS .yaml."
LASER = "The line of a laser that speaks SCIP 2.0, in the same forms."
PLAN = "A built-in drive plan (demo, corridor50) or a TOML file."
DRIFT = "How badly odometry errs: none, low, medium or high."
MOUSE = "The line of an optical mouse on the floor, mouse:/dev/input/mouse0; repeatable."
MICE = "Optical mice that Maze Runner has under it, 8 at most."
LINK = "serial:DEVICE[?baud=38400], tcp://HOST:PORT or pty:PATH; repeatable."


@app.callback()
def common(debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False) -> None:
    """Only holds what is common to all commands; `main` looks for --debug itself."""


@app.command()
def demo(
    robot: OneRobot = "crunch",
    port: Port = None,
    host: Host = None,
    browser: Browser = True,
    autopilot: Annotated[bool, typer.Option("--autopilot", help="The robot drives by itself.")] = False,
    world: Annotated[str | None, typer.Option(help=WORLD, show_default="the plan's")] = None,
    plan: Annotated[
        str | None, typer.Option(help=PLAN + " `tour:M`: M metres at random.", show_default="world's")
    ] = None,
    drift: Annotated[str, typer.Option(help=DRIFT)] = "medium",
    speed: Annotated[float, typer.Option(min=0.1, max=100.0, help="Times real time.")] = 1.0,
    avr: Avr = False,
    mice: Annotated[int, typer.Option(min=0, help=MICE)] = 0,
    seed: Seed = 0,
    threads: LiveThreads = 1,
    recordings: Recordings = Path("recordings"),
    record: Record = True,
    name: Name = "",
    particles: Particles = None,
    preset: Preset = None,
    config: ConfigFile = None,
    assignments: Assignments = None,
    where: CartMap = None,
) -> None:
    """Drive a virtual robot in the browser and watch its map grow.

    It speaks the same bytes as the real one. W A S D or the arrow keys drive, space stops; with --autopilot Crunch
    drives a plan, and Maze Runner explores its maze. Bumper Cart runs by itself once it is told to on the page.

    \b
        crunch demo --autopilot
        crunch demo --robot maze_runner --autopilot --world maze:large:4
        crunch demo --robot bumper_cart --map cut-rectangle
        crunch demo --port 8080 --no-browser --world corridor50
        crunch demo --avr
    """
    from server.demo import run_demo

    settings = live_settings(robot, settings_flags(preset, particles, robot, where), config, assignments)
    options = live_options(robot, settings, host, port, browser)
    options = replace(options, seed=seed, threads=threads, recordings=recordings if record else None, name=name)
    raise typer.Exit(run_demo(options, autopilot, world, plan, known_drift(drift), speed, build_of(avr), mice))


@app.command()
def serve(
    links: Annotated[list[str] | None, typer.Option("--link", metavar="LINK", help=LINK)] = None,
    robot: OneRobot = "crunch",
    laser: Annotated[str | None, typer.Option("--laser", metavar="LINK", help=LASER)] = None,
    mice: Annotated[list[str] | None, typer.Option("--mouse", metavar="LINK", help=MOUSE)] = None,
    autopilot: Annotated[
        bool, typer.Option("--autopilot", help="Maze Runner explores by itself, from the first scan on.")
    ] = False,
    port: Port = None,
    host: Host = None,
    browser: Browser = True,
    seed: Seed = 0,
    threads: LiveThreads = 1,
    recordings: Recordings = Path("recordings"),
    record: Record = True,
    name: Name = "",
    particles: Particles = None,
    preset: Preset = None,
    config: ConfigFile = None,
    assignments: Assignments = None,
    where: CartMap = None,
) -> None:
    """Drive a real robot in the browser, map with it, and record everything it says.

    \b
        crunch serve --link serial:/dev/ttyUSB0
        crunch serve --link "serial:/dev/ttyUSB0?baud=57600" --host 0.0.0.0
        crunch serve --link tcp://127.0.0.1:9000 --no-browser
        crunch serve --link pty:./crunch.tty
        crunch serve --robot maze_runner --link serial:/dev/ttyUSB0 --laser serial:/dev/ttyACM0

    A robot with a line per board gets a --link for each; Maze Runner's laser has --laser, and each of its optical mice,
    whose places stand in the settings, a --mouse.
    """
    from server.live import run_serve

    settings = live_settings(robot, settings_flags(preset, particles, robot, where), config, assignments)
    options = live_options(robot, settings, host, port, browser)
    options = replace(options, seed=seed, threads=threads, recordings=recordings if record else None, name=name)
    raise typer.Exit(run_serve(links or [], options, laser, autopilot, mice or []))


@app.command()
def replay(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG", help="Recordings (.rlog) or foreign logs.")],
    out: Annotated[Path, typer.Option(help="Folder for the results; several logs get a folder each in it.")],
    robot: Robot = None,
    particles: Particles = None,
    seed: Seed = 0,
    threads: Threads = None,
    beams: Beams = None,
    max_range: MaxRange = None,
    preset: Preset = None,
    config: ConfigFile = None,
    assignments: Assignments = None,
    where: CartMap = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but errors.")] = False,
) -> None:
    """Make a map from a log: recordings of crunch, logs of a laser, bags of a Crazyflie, or eight sonars (sonar8).

    Crunch gets of a laser what it would sense: one infra-red beam and one sonar cone every 45 degrees, or, with
    --beams, so many single beams. Maze Runner gets whole scans. CARMEN logs are Crunch's unless --robot says
    otherwise; ROS bags and logs of the mines, of Wean Hall and of the LEGO robot are Maze Runner's.

    \b
        crunch replay drive.rlog --out map
        crunch replay intel-dense.log --out intel --particles 5000 --seed 3
        crunch replay intel.log --out intel11 --beams 11 --max-range 5
        crunch replay intel.log --out intel-laser --robot maze_runner
        crunch replay drive.rlog --out map --set crunch.filter.comparison.gap=12
        crunch replay bumps.rlog --out where --map cut-rectangle

    Bumper Cart is found on the --map, its poses then lie in the map's frame; without one it makes a map of its bumps.
    OUT then holds trajectory.tum, map.png, map.pgm with map.yaml, map.json, path.g2o, profile.csv and report.json
    (docs/outputs.md), and clusters.csv of who was found on a map.
    """
    from server.replay import Options, open_log
    from server.replay import replay as run

    check_beams(beams, max_range)
    for path, folder in zip(logs, folders_for(logs, out), strict=True):
        log = open_log(path, beams, max_range, robot)
        name = robot or log.robot or "crunch"
        flags = settings_flags(preset, particles, name, where)
        options = Options(name, seed, threads, beams, max_range, config, flags, assignments or ())
        with progress_bar(path.name, log.n_odometry, quiet) as progress:
            report = run(path, folder, options, progress, log)
        for warning in report.warnings:
            typer.echo(f"crunch: warning: {warning}", err=True)
        if not quiet:
            typer.echo(f"{folder}: {report.summary()}")


@app.command()
def simulate(
    out: Annotated[Path, typer.Option(metavar="LOG", help="Recording to write; the truth goes to LOG.truth.tum.")],
    robot: OneRobot = "crunch",
    world: Annotated[str | None, typer.Option(help=WORLD, show_default="the plan's")] = None,
    plan: Annotated[
        str | None, typer.Option(help=PLAN + " `tour:M`: M metres at random.", show_default="world's")
    ] = None,
    seed: Seed = 0,
    drift: Annotated[str, typer.Option(help=DRIFT)] = "medium",
    duration: Annotated[float | None, typer.Option(min=0.1, help="Seconds.", show_default="the plan's end")] = None,
    avr: Avr = False,
    mice: Annotated[int, typer.Option(min=0, help=MICE)] = 0,
    from_log: Annotated[Path | None, typer.Option(help="Semi-real: odometry and walls from this CARMEN log.")] = None,
    reference: Annotated[Path | None, typer.Option(help="Semi-real: where the log's scans were taken (TUM).")] = None,
    config: ConfigFile = None,
    assignments: Assignments = None,
) -> None:
    """Record a virtual robot, faster than real time, with the truth beside it.

    \b
        crunch simulate --world demo --plan demo --seed 1 --out drive.rlog
        crunch simulate --world corridor50 --drift high --out loop.rlog
        crunch simulate --world floor.map --plan tour:250 --seed 7 --out tour.rlog
        crunch simulate --from-log intel.log --reference reference.tum --out semi.rlog
        crunch simulate --robot maze_runner --world maze:large:4 --plan explore --out maze.rlog
        crunch simulate --robot bumper_cart --world cut-rectangle --plan bump --out cart.rlog

    With --from-log the recording is semi-real: the world is drawn from the log's laser scans, the reference path is
    driven in it, odometry is the log's own, and the sensors are the virtual robot's. Maze Runner is driven by our
    explorer: its plans are `explore`, to where its map ends, and `wall`, along a wall until it has come around. Bumper
    Cart runs by itself, from bump to bump: `bump`.
    """
    from server.config import check_robot, load
    from server.simulate import Semireal, Simulation, simulate_drive, simulate_semireal

    check_robot(robot)
    settings = load(None, config, None, assignments or ())
    if (from_log is None) != (reference is None):
        raise UserError("--from-log and --reference belong together; give both or neither")
    if from_log is not None and reference is not None:
        if world or plan:
            raise UserError("--from-log makes its own world and plan; leave out --world and --plan")
        check_robot(robot, ("crunch",), "robots that can repeat a log")
        if avr:
            raise UserError("--from-log gives the motion, and no board balances; leave out --avr")
        if mice:
            raise UserError("--from-log gives the odometry; leave out --mice")
        semireal = Semireal(robot, from_log, reference, seed, out, duration)
        with progress_bar(out.name, 100, False) as progress:
            summary = simulate_semireal(semireal, settings, progress)
    else:
        simulation = Simulation(robot, world, plan, seed, out, known_drift(drift), duration, build_of(avr), mice)
        with progress_bar(out.name, 100, False) as progress:
            summary = simulate_drive(simulation, settings, progress)
    typer.echo(f"{out}: {summary}")


@app.command()
def score(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="A replay's folder, or a trajectory (TUM).")],
    truth: Annotated[Path | None, typer.Option(help="True poses (TUM).")] = None,
    relations: Annotated[Path | None, typer.Option(help="Relative poses verified by hand.")] = None,
    time_offset: Annotated[float, typer.Option(help="Truth time minus estimate time, s.")] = 0.0,
    align: Annotated[bool, typer.Option("--align/--no-align", help="Lay the estimate over the truth first.")] = True,
) -> None:
    """Compare a replay with the truth; prints JSON: metres, degrees, and how many poses were used.

    \b
        crunch score map --truth drive.rlog.truth.tum
        crunch score intel --relations intel.relations --truth reference.tum
    """
    from server.score import score as measure

    typer.echo(json.dumps(measure(directory, truth, relations, time_offset, align), indent=2))


app.command()(board)
app.command()(merge)


@app.command()
def bench(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]...", help="Benchmarks, or `firmware` for all of those; a quick set if none."),
    ] = None,
    listed: Annotated[bool, typer.Option("--list", help="Tell what each measures and how long it takes.")] = False,
    seeds: Annotated[int | None, typer.Option(min=1, help="Runs of each row.", show_default="its own")] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes at a time; what is timed runs alone.")] = 1,
    only: Annotated[
        str, typer.Option(metavar="TEXT", help="Only rows with these words in their names.", show_default="all")
    ] = "",
    output: Annotated[
        Path | None, typer.Option(help="JSON file for all results.", show_default="build/bench/NAME.json")
    ] = None,
) -> int:
    """Measure accuracy and speed, in a checkout of the sources: tables with the machine, the commit and the tails.

    \b
        crunch bench --list
        crunch bench cycle --seeds 20 --jobs 2 --only medium
        crunch bench real cycle --output results.json
        crunch bench firmware --jobs 2

    The exit code is 1 where one finds what must not be, as a robot that fell.
    Other people's recordings are found through CRUNCH_DATA; what needs them is skipped where they are not.
    """
    command = benchmarks()
    if listed:
        command.show_list()
        return 0
    return 0 if command.run_all(names or [], seeds, jobs, only, output) else 1


@app.command()
def version() -> None:
    """Print the version of crunch and of what its figures depend on."""
    from server.report import describe_machine

    versions = describe_machine()
    typer.echo(f"crunch {versions.pop('crunch')}")
    typer.echo(", ".join(f"{name} {text}" for name, text in versions.items()))


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and leave with its exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    is_debug = "--debug" in arguments
    sys.exit(run([argument for argument in arguments if argument != "--debug"], is_debug))


def run(arguments: list[str], is_debug: bool) -> int:
    """The exit code of one command; an error is one line, after its traceback if that is wanted."""
    try:
        code = app(arguments or ["--help"], prog_name="crunch", standalone_mode=False)
        return code if isinstance(code, int) else 0
    except (KeyboardInterrupt, typer.Abort):
        return complain("stopped", 130)
    except BrokenPipeError:  # whoever read the output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        if is_debug:
            traceback.print_exc()
        return tell(error)


def tell(error: Any) -> int:
    """Complain about an error in the words that fit its kind; exit code."""
    if isinstance(error, UsageError):
        command = error.ctx.command_path if error.ctx else "crunch"
        return complain(f"{error.format_message()} (see `{command} --help`)", 2)
    if isinstance(error, (UserError, CommandError)):
        return complain(str(error), 2)
    return complain(f"internal error, {type(error).__name__}: {error} (run again with --debug and report it)", 1)


if __name__ == "__main__":
    main()
