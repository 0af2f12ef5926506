"""Recordings of the virtual robot, made as fast as the machine can, each with the truth beside it.

The virtual robot is met through its bytes alone: what it sends goes into an ordinary recording, to be replayed like any
other. Its own true poses become `LOG.truth.tum`. Crunch drives a plan by itself; Maze Runner knows of no plan, so that
our own explorer drives it, from the host's side (`headless`, a sibling). Bumper Cart is told to run, and does the rest.
"""

from __future__ import annotations

import contextlib
import functools
import math
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from firmware.virtual import (
    Build,
    CompilerError,
    Drift,
    Plan,
    VirtualCrunch,
    VirtualMazeRunner,
    World,
    load_plan,
    load_world,
    tour,
)
from firmware.virtual.bumper_cart import CartBuild, VirtualCart
from firmware.virtual.mice import PLACES
from firmware.virtual.plans import BUILT_IN as PLANS
from firmware.virtual.scripted import ScriptedCrunch
from server.config import Config, merge
from server.errors import UserError
from server.formats.atomic import make_directory
from server.formats.carmen import read_carmen
from server.formats.errors import FormatError
from server.formats.laser import LaserLog
from server.formats.tum import read_tum, write_tum
from server.headless import BOARD, Headless
from server.maps import path_length
from server.messages import Arm, Effect, Keyframe, Stop
from server.recording import Header, Kind, LinkName, Recorder
from server.report import version
from server.robots.bumper_cart import BumperCart
from server.robots.kinds import LASER, ROBOTS, mouse_lines
from server.session import Session, session_of
from slam.cart_odometry import DRIVE
from slam.pose import compose
from slam.timeline import associate

CHUNK = 0.02  # s of simulated time between two reads of the link
REST = 1.0  # s recorded after the plan's end
PATIENCE = 3.0  # times as long as the plan's length and pauses ask for, before a stuck robot is given up
SCAN_TOLERANCE = 1e-3  # s between a scan and its reference pose
SCAN_REACH = 8.0  # m of a laser that draw the world; farther hits are smeared by small errors of heading
LINK = "virtual"
RULES = {"explore": "frontiers", "frontiers": "frontiers", "wall": "wall"}  # plans of one that explores
EXPLORING = 900.0  # s after which it is given up
BUMPING = "bump"  # the plan of one that bumps
ROOM = "cut-rectangle"
RUNNING = 600.0  # s, of one whose run has no end
FIRST_WORD = 0.5  # s in which a board has spoken, so that it may be told something
TOUR = "tour"
TOUR_LENGTH = 100.0  # m

Progress = Callable[[int], None]
Robot = VirtualCrunch | ScriptedCrunch | VirtualMazeRunner | VirtualCart


class Simulation(NamedTuple):
    """A drive in a world by a plan, both by built-in name or file; `tour:M` plans a random tour of M metres.

    The world follows from the plan where it is not given, the plan from the world: its own, or else a tour.
    """

    robot: str
    world: str | None
    plan: str | None
    seed: int
    out: Path
    drift: Drift = "medium"
    duration: float | None = None
    build: Build = "host"
    mice: int = 0


class Semireal(NamedTuple):
    """A reference path driven through the walls that a log's laser saw, with the log's own odometry."""

    robot: str
    log: Path
    reference: Path
    seed: int
    out: Path
    duration: float | None = None


def simulate_drive(simulation: Simulation, settings: Config, progress: Progress | None = None) -> str:
    """Record a drive; one line about it. UserError where world, plan or place cannot be used."""
    check_mice(simulation.robot, simulation.mice)
    if ROBOTS[simulation.robot].bumps:
        return simulate_bumping(simulation, settings, progress)
    if ROBOTS[simulation.robot].explores:
        return simulate_exploring(simulation, settings, progress)
    with mendable():
        world, plan = world_and_plan(simulation.world, simulation.plan, simulation.seed)
        robot = VirtualCrunch(world, seed=simulation.seed, drift=simulation.drift, plan=plan, build=simulation.build)
    longest = simulation.duration or allowance(plan)
    end = record(robot, simulation.robot, simulation.out, settings, longest, progress)
    warning = ""
    if not robot.finished and simulation.duration is None:
        warning = f"; the plan was not finished, the robot is {robot.state}"
    return describe(robot, end) + warning


def simulate_exploring(simulation: Simulation, settings: Config, progress: Progress | None = None) -> str:
    """Record how a robot explores a maze; one line about it."""
    settings = with_mice(with_rule(settings, simulation.robot, simulation.plan), simulation.mice)
    with mendable():
        world = load_world(simulation.world or f"maze:medium:{simulation.seed}")
        mice = PLACES[: simulation.mice]
        robot = VirtualMazeRunner(
            world, seed=simulation.seed, drift=simulation.drift, mice=mice, build=simulation.build
        )
    lines = (BOARD, LASER, *mouse_lines(simulation.mice))
    longest = simulation.duration or EXPLORING
    with recording(simulation.robot, simulation.out, settings, lines, simulation.seed) as recorder:
        loop = Headless(robot, simulation.seed, settings, recorder)
        loop.explore(longest, lambda: progress and progress(round(100.0 * robot.time / longest)))
        loop.run(REST)
    write_tum(simulation.out.with_name(simulation.out.name + ".truth.tum"), *robot.truth())
    state = "" if loop.explorer.finished else f"; the map was not closed in {longest:.0f} s"
    abandoned = loop.explorer.progress.abandoned
    given_up = f", {abandoned} frontiers given up" if abandoned else ""
    return describe(robot, robot.time) + f", {robot.body.bumps} walls touched{given_up}" + state


def simulate_bumping(simulation: Simulation, settings: Config, progress: Progress | None = None) -> str:
    """Record a cart's run from bump to bump; one line about it. Where the world is not named it is `ROOM`.

    It begins anywhere, by its seed, which is added to that of the settings for its turns.
    """
    if simulation.plan not in (None, BUMPING):
        raise UserError(f"--plan {simulation.plan}: {simulation.robot} drives by none but {BUMPING}")
    params = settings.bumper_cart
    with mendable():
        cart = virtual_cart(simulation.world, settings, simulation.seed, simulation.drift, simulation.build)
    longest = simulation.duration or RUNNING
    seed = (params.run.seed + simulation.seed) % 65_536
    robot = BumperCart(params.model_copy(update={"run": params.run.model_copy(update={"seed": seed})}))
    with recording(simulation.robot, simulation.out, settings, (LINK,), simulation.seed) as recorder:
        session = session_of(simulation.robot, robot, params, recorder)
        heard = functools.partial(hear_cart, session, cart)
        heard(FIRST_WORD)
        answer(session, cart, session.command(Arm(0.0, True), cart.time))
        while cart.time < longest - 1e-9 and (robot.now is None or robot.now.reason == "boot" or is_running(robot)):
            heard(CHUNK)
            if progress:
                progress(round(100.0 * cart.time / longest))
        answer(session, cart, session.command(Stop(0.0), cart.time))
        heard(REST)
    write_tum(simulation.out.with_name(simulation.out.name + ".truth.tum"), *cart.truth())
    bumps = sum(stage.kind == DRIVE and stage.bumper != 0 for stage in robot.stages)
    return f"{describe(cart, cart.time)}, {len(robot.stages)} stages, {bumps} bumps"


def virtual_cart(world: str | None, settings: Config, seed: int, drift: Drift, build: Build) -> VirtualCart:
    """A cart somewhere in a world, with as many switches as the settings tell. ValueError where it cannot be used."""
    made = CartBuild(switches=settings.bumper_cart.build.switches, drift=drift)
    return VirtualCart(load_world(world or ROOM), None, seed, made, board=build)


def is_running(robot: BumperCart) -> bool:
    """Whether the cart's own program drives it."""
    return robot.now is not None and robot.now.state == "armed"


def hear_cart(session: Session, cart: VirtualCart, seconds: float) -> None:
    """Let time pass; what follows from what the cart says is told to it."""
    until = cart.time + seconds
    while cart.time < until - 1e-9:
        data = cart.advance(min(CHUNK, until - cart.time))
        if data:
            answer(session, cart, session.receive(LINK, data, cart.time))


def answer(session: Session, cart: VirtualCart, effects: list[Effect]) -> None:
    """Send what the host's side of a robot decided; of its vertices nothing is made here."""
    for effect in effects:
        if not isinstance(effect, Keyframe):
            cart.write(session.encode(effect))


def with_rule(settings: Config, robot: str, plan: str | None) -> Config:
    """Settings by whose rule a robot explores that a plan names; UserError for a plan that is none of them."""
    if plan is None:
        return settings
    if plan not in RULES:
        raise UserError(f"--plan {plan}: {robot} drives by none but {', '.join(RULES)}")
    return Config(**merge(settings.model_dump(), {"explorer": {"rule": RULES[plan]}}))


def check_mice(robot: str, mice: int) -> None:
    """UserError for more mice than a robot may have."""
    if mice > ROBOTS[robot].mice:
        remedy = f"{ROBOTS[robot].mice} at most" if ROBOTS[robot].mice else "leave out --mice"
        raise UserError(f"--mice {mice}: {robot} has not so many; {remedy}")


def with_mice(settings: Config, mice: int) -> Config:
    """Settings that know where the virtual mice sit, as they say or as those do; UserError for another number."""
    told = settings.maze_runner.mice
    if mice and told is not None:
        if len(told.mice) != mice:
            raise UserError(f"--mice {mice}: maze_runner.mice tells where {len(told.mice)} sit; leave it out, or agree")
        return settings
    seats = {"mice": [place._asdict() for place in PLACES[:mice]]} if mice else None
    return Config(**merge(settings.model_dump(), {"maze_runner": {"mice": seats}}))


def world_and_plan(world: str | None, plan: str | None, seed: int) -> tuple[World, Plan]:
    """Where to drive, and how. ValueError of the virtual robot where one of them cannot be used."""
    name = plan or plan_in(world)
    if name == TOUR or name.startswith(f"{TOUR}:"):
        place = load_world(world or "demo")
        return place, tour(place, tour_length(name), seed)
    route = load_plan(name)
    return load_world(world or route.world or name), route


def plan_in(world: str | None) -> str:
    """The plan for a world when none is given."""
    if world is None:
        return "demo"
    return world if (PLANS / f"{world}.toml").is_file() else TOUR


def tour_length(name: str) -> float:
    """Metres of `tour:M`."""
    text = name.partition(":")[2] or str(TOUR_LENGTH)
    try:
        length = float(text)
    except ValueError:
        length = math.nan
    if not 1.0 <= length <= 1e5:
        raise UserError(f"--plan {name}: `{text}` is no length; write metres from 1 to 100000, as in tour:250")
    return length


def simulate_semireal(semireal: Semireal, settings: Config, progress: Progress | None = None) -> str:
    """Record a reference drive; one line about it. UserError where the log and the reference do not fit."""
    log = read_carmen(semireal.log)
    reference_times, reference = read_tum(semireal.reference)
    with mendable():
        robot = scripted(log, reference_times, reference, semireal.seed, semireal.reference)
    longest = min(robot.duration, semireal.duration or robot.duration)
    end = record(robot, semireal.robot, semireal.out, settings, longest, progress)
    return describe(robot, end)


def scripted(
    log: LaserLog, reference_times: np.ndarray, reference: np.ndarray, seed: int, path: Path
) -> ScriptedCrunch:
    """The virtual robot that repeats a log's drive, clipped to the span of the reference."""
    matches = associate(reference_times, log.scan_times, 0.0, SCAN_TOLERANCE)
    if len(matches.rows) < 2:
        raise FormatError(
            path, None, f"has {len(matches.rows)} poses at times of the log's scans", "both must share a clock"
        )
    poses = compose(reference[matches.rows], log.mount)
    world = World.from_scans(poses, log.scans[matches.reference_rows], log.bearings, SCAN_REACH)
    return ScriptedCrunch(world, reference_times, reference, log.odometry_times, log.odometry, seed)


def allowance(plan: Plan) -> float:
    """Seconds in which the plan must be driven."""
    lengths = np.hypot(*np.diff(plan.points, axis=0).T)
    return PATIENCE * float(np.sum(lengths / plan.speeds[1:]) + np.sum(plan.pauses)) + 10.0


def record(robot: Robot, name: str, out: Path, settings: Config, longest: float, progress: Progress | None) -> float:
    """Let the robot run and write what it sends and where it was; returns the simulated seconds."""
    with recording(name, out, settings, (LINK,)) as recorder:
        end = run(robot, recorder, longest, progress)
    write_tum(out.with_name(out.name + ".truth.tum"), *robot.truth())
    return end


@contextlib.contextmanager
def recording(name: str, out: Path, settings: Config, links: tuple[str, ...], seed: int = 0) -> Iterator[Recorder]:
    """A recording that is at its place once it is whole; UserError where it cannot be written."""
    header = Header(
        robot=name,
        links=tuple(LinkName(id=link_id, spec="virtual:") for link_id in links),
        unix_ns=0,  # simulated time begins at zero, so that the same seed makes the same file
        monotonic_ns=0,
        configuration=settings.model_dump(exclude_defaults=True),
        seed=seed,
        software={"crunch": version()},
    )
    make_directory(out.parent)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as folder:
        recorder = Recorder(Path(folder) / out.name, header)
        yield recorder
        recorder.close()
        if recorder.failed:
            raise UserError(
                f"{out}: {recorder.failed} records were not written ({recorder.error}); make room on the disk"
            )
        place(Path(folder) / out.name, out)


def run(robot: Robot, recorder: Recorder, longest: float, progress: Progress | None) -> float:
    """Advance until the plan's end and a rest, or for the longest time allowed."""
    last = longest
    while robot.time < last - 1e-9:
        data = robot.advance(CHUNK)
        if data:
            recorder.append(Kind.RX, LINK, data, robot.time)
        if isinstance(robot, VirtualCrunch) and robot.finished:
            last = min(last, robot.time + REST) if last == longest else last
        if progress:
            progress(round(100.0 * robot.time / longest))
    return robot.time


def place(written: Path, out: Path) -> None:
    """Rename a finished recording to where it belongs."""
    try:
        os.replace(written, out)
    except OSError as error:
        raise UserError(f"{out}: cannot be written ({error.strerror}); choose another place") from None


def describe(robot: Robot, end: float) -> str:
    """What was recorded."""
    _, poses = robot.truth()
    return f"{end:.1f} s, {path_length(poses):.1f} m, {len(poses)} true poses beside it"


@contextlib.contextmanager
def mendable() -> Iterator[None]:
    """What the virtual robot cannot use is the caller's to mend."""
    try:
        yield
    except (ValueError, CompilerError) as error:  # WorldError and PlanError are ValueErrors
        raise UserError(str(error)) from None
