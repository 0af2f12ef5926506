"""A log to a map, without a clock: messages through the robot's fold, its keyframes through the path filter, files out.

`run_log` is the whole of it for benchmarks, without any file; `replay` is what `crunch replay` does with one log. Uses
siblings `mapping` for what each robot does with its keyframes, and `recorded` for our own recordings.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from server import config, map_files, map_picture, maps
from server.formats.atomic import make_directory, write_atomically
from server.formats.cart_log import cart_messages
from server.formats.errors import FormatError
from server.formats.g2o import format_g2o
from server.formats.logs import Log
from server.formats.ros_map import write_ros_map
from server.formats.sparse import BEAM_MAX_RANGE
from server.formats.tum import format_tum
from server.mapping import (
    Drive,
    Mapper,
    RobotParams,
    mapper_of,
    odometry_noise,
    row_at,
    senses_of,
    with_sensors,
)
from server.messages import Cart, CartStage, Keyframe, Message, Motors, Odometry, Ranges, Wheels
from server.recorded import open_log
from server.report import Certainty, Choice, Localization, Report, describe_machine, peak_rss_mb
from server.robots.bumper_cart import BumperCartParams
from slam.cart_odometry import BACK, DRIVE, MIDDLE, TURN, Stage
from slam.hypotheses import Verdict
from slam.path_filter import PathEstimate
from slam.pose import compose, inverse
from slam.pose_clusters import Belief
from slam.uncertainty import Uncertainty

PROGRESS_STEP = 500  # odometry readings between two words of progress

Progress = Callable[[int], None]
Note = Callable[[int, Message], None]  # of the odometry's newest row, and a message


@dataclass(frozen=True)
class Options:
    """What `crunch replay` was asked for; `flags` and `assignments` go to the configuration."""

    robot: str = "crunch"
    seed: int = 0
    threads: int | None = None  # None takes all cores
    beams: int | None = None
    max_range: float | None = None
    file: Path | None = None
    flags: Mapping[str, Any] = field(default_factory=dict)
    assignments: Sequence[str] = ()


@dataclass(frozen=True)
class Result:
    """A mapped log: the drive, the filter's last estimate, a corrected pose (n, 3) per odometry reading, seconds.

    `uncertainty` is of the vertices, `verdict` on whether another path explains as much, `warnings` are for people;
    where there is a `floor`, it is the map. `beliefs` are of a robot that is looked for on a map, at each vertex.
    """

    drive: Drive
    estimate: PathEstimate
    trajectory: np.ndarray
    seconds: dict[str, float]
    uncertainty: Uncertainty
    verdict: Verdict
    warnings: tuple[str, ...] = ()
    floor: maps.FloorMap | None = None
    beliefs: Sequence[Belief] = ()

    @property
    def path(self) -> np.ndarray:
        """The best particle's vertices (v, 3)."""
        return self.estimate.path


def run_log(log: Log, params: RobotParams, seed: int = 0, threads: int = 1, progress: Progress | None = None) -> Result:
    """Map a log in memory; FormatError where it lacks odometry or ranges. The same arguments give the same bits.

    `seconds` tells the parts: `fold` (decoding, local map, walls), `filter` and `refinement`, which is also of echoes
    and has all of restarts; kernels are compiled before.
    """
    params = with_sensors(params, log)
    warm_up(params, threads)
    return run_mapper(log, mapper_of(params, seed, threads), progress)


def run_mapper(log: Log, mapper: Mapper, progress: Progress | None = None) -> Result:
    """Map a log in memory with a mapper that is made for it; its kernels are compiled on the way unless they are."""
    started = time.perf_counter()
    spent = 0.0

    def extend(keyframe: Keyframe) -> None:
        nonlocal spent
        before = time.perf_counter()
        mapper.extend(keyframe)
        spent += time.perf_counter() - before

    def told(share: float) -> None:
        if progress:
            progress(round(share * len(drive.times)))

    drive = fold(log, mapper.robot, extend, progress, mapper.note)
    before = time.perf_counter()
    estimate, trajectory, uncertainty, verdict, warnings, floor, beliefs = mapper.conclude(drive, told)
    if np.any(log.mount):
        trajectory = compose(trajectory, inverse(log.mount))
    ended = time.perf_counter()
    seconds = {
        "fold": before - started - spent,
        "filter": spent,
        "refinement": ended - before,
        "total": ended - started,
    }
    return Result(drive, estimate, trajectory, seconds, uncertainty, verdict, warnings, floor, beliefs)


def fold(
    log: Log, robot: Any, extend: Callable[[Keyframe], None], progress: Progress | None = None, note: Note | None = None
) -> Drive:
    """Step the robot through a log, in file order; each keyframe goes to `extend`.

    Each message is also shown to `note`, once the robot has taken it up, with the odometry's newest row.
    """
    times: list[float] = []
    poses: list[np.ndarray] = []
    keyframes: list[Keyframe] = []
    rows: list[int] = []
    has_ranges, sensors = False, senses_of(robot.params)
    for message in log.messages(robot.calibration):
        effects = robot.step(message)
        if isinstance(message, (Odometry, Wheels, Motors, Cart)):
            times.append(message.t)
            poses.append(robot.odometry)
            if progress and len(times) % PROGRESS_STEP == 0:
                progress(len(times))
        has_ranges = has_ranges or isinstance(message, CartStage)
        has_ranges = has_ranges or (isinstance(message, Ranges) and message.sensor in sensors)
        rows.extend(row_at(times, t) for t in robot.times[len(rows) :])  # their keyframes may come later
        if note:
            note(len(times) - 1, message)
        for effect in effects:
            if isinstance(effect, Keyframe):
                keyframes.append(effect)
                extend(effect)
    for effect in robot.finish():
        keyframes.append(effect)
        extend(effect)
    check_complete(log, bool(times), has_ranges, bool(keyframes))
    return Drive(np.array(times), np.array(poses), keyframes, np.array(rows))


def check_complete(log: Log, has_odometry: bool, has_ranges: bool, has_vertices: bool) -> None:
    """FormatError for a log from which no map can be made."""
    if not has_odometry:
        raise FormatError(log.path, None, "holds no odometry", "replay a log whose robot reported its wheels")
    if not has_ranges:
        raise FormatError(log.path, None, "holds no ranges", "replay a log whose robot reported its rangefinders")
    if not has_vertices:
        raise FormatError(log.path, None, "has no odometry after its first ranges", "replay a longer log")


def warm_up(params: RobotParams, threads: int) -> None:
    """Compile or load every kernel that a run needs, so that its time is the run's own."""
    mapper = mapper_of(params, 0, threads)
    mapper.prepare(fold(rehearsal(params), mapper.robot, lambda keyframe: None, None, mapper.note))


def rehearsal(params: RobotParams) -> Log:
    """A log of a few steps there and back, in which all sensors see walls; the last are nearer, as if it were lost."""
    if isinstance(params, BumperCartParams):
        return Log(Path("rehearsal"), "rehearsal", "", lambda _: iter(bumps_there_and_back()), None, n_odometry=8)
    sensors = senses_of(params)
    messages: list[Message] = []
    for step in range(8):
        near = 0.5 if step < 7 else 0.25
        messages.append(Odometry(float(step), params.vertex_spacing * (step % 3), 0.0, 0.0))
        for name, (n_ranges, max_range) in sensors.items():
            messages.append(Ranges(float(step), name, np.full(n_ranges, near * max_range)))
    return Log(Path("rehearsal"), "rehearsal", "", lambda _: iter(messages), None, n_odometry=8)


def bumps_there_and_back() -> list[Message]:
    """A run of a few bumps."""
    stages = [Stage(DRIVE, 300, 300, MIDDLE), Stage(BACK, -40, -40), Stage(TURN, 60, -60)] * 4
    return list(cart_messages(stages, np.arange(1.0, 1.0 + len(stages))))


def replay(path: Path, out: Path, options: Options, progress: Progress | None = None, log: Log | None = None) -> Report:
    """Map the log at `path` and write everything into the folder `out`; UserError where a person can mend it."""
    config.check_robot(options.robot)
    make_directory(out)
    log = log or open_log(path, options.beams, options.max_range, options.robot)
    settings = config.load(options.flags, options.file, log.configuration, options.assignments)
    params = with_sensors(getattr(settings, options.robot), log)
    threads = options.threads or os.cpu_count() or 1
    result = run_log(log, params, options.seed, threads, progress)
    before = time.perf_counter()
    floor = floor_of(result)
    report = report_of(result, log, replace(options, threads=threads), settings)
    report.warnings.extend([*coarseness(floor), *doubts(result.verdict), *result.warnings])
    write_outputs(out, result, floor, params, report)
    seconds = {**report.seconds, "write": round(time.perf_counter() - before, 3)}
    report = report.model_copy(update={"seconds": seconds, "peak_rss_mb": peak_rss_mb()})
    write_atomically(out / "report.json", report.model_dump_json(indent=2) + "\n")  # last: the folder is complete
    return report


def floor_of(result: Result) -> maps.FloorMap:
    """The map of a run, with the whole trajectory to be drawn."""
    if result.floor is not None:
        return result.floor
    drive, estimate = result.drive, result.estimate
    floor = maps.floor_map(estimate.path, drive.walls, int(estimate.fixed_depth))
    trail = maps.trail_of(result.trajectory, drive.rows, floor.settled)
    return floor._replace(trail=trail, spread=result.uncertainty.spread)


def coarseness(floor: maps.FloorMap) -> list[str]:
    """A warning where the map had to be drawn in larger cells than usual."""
    if floor.grid is None or floor.grid.resolution <= maps.RESOLUTION:
        return []
    across = floor.grid.resolution * max(floor.grid.cells.shape) / 1000.0
    return [
        f"the path spans {across:.1f} km, so map.pgm has cells of {floor.grid.resolution:g} m instead of "
        f"{maps.RESOLUTION:g} m; look for a jump in the log's odometry"
    ]


def doubts(verdict: Verdict) -> list[str]:
    """A word where another map would explain the walls about as well."""
    if not verdict.is_open:
        return []
    return [
        f"another map explains the walls nearly as well (less by {verdict.lead:.0f} nats, after {verdict.restarts} "
        "restarts), so that this one may be wrong: drive through places seen before, or raise --set crunch.restarts=N"
    ]


def report_of(result: Result, log: Log, options: Options, settings: config.Config) -> Report:
    """The figures of a run."""
    estimate, drive = result.estimate, result.drive
    duration = float(drive.times.max() - drive.times.min())
    return Report(
        robot=options.robot,
        log=str(log.path),
        kind=log.kind,
        description=log.description,
        seed=options.seed,
        threads=options.threads or 1,
        beams=options.beams,
        max_range=(options.max_range or BEAM_MAX_RANGE) if options.beams else None,
        preset=settings.preset,
        settings=settings.model_dump(mode="json", exclude_defaults=True, exclude={"preset"}),
        particles=estimate.n_particles,
        vertices=len(estimate.path),
        odometry_readings=len(drive.times),
        path_length_m=round(maps.path_length(result.trajectory, maps.TREMBLING), 3),
        duration_s=round(duration, 3),
        wall_s=round(result.seconds["total"], 3),
        real_time_factor=round(duration / result.seconds["total"], 1),
        seconds={name: round(spent, 3) for name, spent in result.seconds.items() if name != "total"},
        peak_rss_mb=peak_rss_mb(),
        resamplings=estimate.resamplings,
        effective_particles=round(float(estimate.effective_particles), 3),
        fixed_depth=int(estimate.fixed_depth),
        affinity=round(float(estimate.affinity), 6),
        plausibility=round(float(estimate.plausibility), 6),
        uncertainty=Certainty.of(result.uncertainty),
        hypotheses=Choice.of_verdict(result.verdict),
        localization=Localization.of(result.beliefs),
        truncated_at=log.truncated_at,
        warnings=list(log.warnings),
        versions=describe_machine(),
    )


def write_outputs(out: Path, result: Result, floor: maps.FloorMap, params: RobotParams, report: Report) -> None:
    """Every file but the report; each is there whole or not at all."""
    drive, estimate = result.drive, result.estimate
    odometry = np.array([keyframe.pose for keyframe in drive.keyframes])
    graph = map_files.pose_graph(estimate.path, odometry, *odometry_noise(params))
    times = drive.times[drive.rows]
    assert floor.grid is not None
    write_atomically(out / "trajectory.tum", format_tum(drive.times, result.trajectory))
    write_ros_map(out / "map", floor.grid)
    write_atomically(out / "map.json", map_files.map_json(floor, report.robot))
    write_atomically(out / "path.g2o", format_g2o(graph))
    profile = map_files.Profile(estimate.profile, floor.settled, result.uncertainty.deviations)
    write_atomically(out / "profile.csv", map_files.profile_csv(times, estimate.path, profile))
    if result.beliefs:
        write_atomically(out / "clusters.csv", map_files.clusters_csv(times, result.beliefs))
    write_atomically(out / "map.png", map_picture.draw_png(floor, *report.headline()))
