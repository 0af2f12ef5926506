"""What becomes of a robot's keyframes in a batch: from a log's drive to a path, robot by robot.

A mapper has a robot, feeds the estimator, and concludes. Crunch's refines, bundles single echoes or begins again with
other seeds; Maze Runner's closes the loops of its scans; Bumper Cart's finds it on a map, or makes one of bumps. Uses
its sibling `recorded` for checking sensors, and `restarts`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from server.formats.laser import SENSOR
from server.formats.logs import Log
from server.maps import FloorMap, swept_map
from server.messages import Keyframe, Message, Motors, Odometry, Ranges
from server.recorded import check_rings
from server.restarts import decided
from server.robots import bumper_cart, crunch, maze_runner
from server.robots.bumper_cart import BumperCart, BumperCartParams, CartBuild
from server.robots.crunch import Crunch, CrunchParams
from server.robots.maze_runner import MazeRunner, MazeRunnerParams
from slam.bump_estimator import LocalizedCart
from slam.bundle import bundle
from slam.bundled_islands import best_bundled
from slam.echoes import Echoes, EchoLog
from slam.evaluate import path_length
from slam.hypotheses import Verdict
from slam.odometry_chain import Chain
from slam.path_filter import PathEstimate
from slam.pose import compose, inverse
from slam.pose_clusters import Belief
from slam.refined_grid_filter import RefinedGridFilter
from slam.refinement import Refined
from slam.trajectory import correct
from slam.uncertainty import Uncertainty
from slam.walls import Walls

RobotParams = CrunchParams | MazeRunnerParams | BumperCartParams
Told = Callable[[float], None]  # hears which share of the log was gone through once more


@dataclass(frozen=True)
class Drive:
    """What a log holds once the robot has folded it: odometry (n, 3) at times (n,), and what its vertices saw."""

    times: np.ndarray
    odometry: np.ndarray
    keyframes: list[Keyframe]
    rows: np.ndarray  # (v,) odometry row of each keyframe

    @property
    def walls(self) -> list[Walls]:
        """What each vertex saw."""
        return [keyframe.walls for keyframe in self.keyframes]


class Conclusion(NamedTuple):
    """The last estimate, a corrected pose (n, 3) per odometry reading, the vertices' uncertainty, and the verdict.

    `warnings` are for people; where there is a `floor`, it is the map, else that is drawn from what the vertices saw.
    `beliefs` are of a robot that is looked for on a map, at each vertex.
    """

    estimate: PathEstimate
    trajectory: np.ndarray
    uncertainty: Uncertainty
    verdict: Verdict
    warnings: tuple[str, ...] = ()
    floor: FloorMap | None = None
    beliefs: Sequence[Belief] = ()


class Mapper(Protocol):
    """A robot and its estimator in a batch."""

    robot: Any

    def note(self, row: int, message: Message) -> None:
        """Look at a message that the robot has taken up, the odometry's newest row being `row`."""
        ...

    def extend(self, keyframe: Keyframe) -> None:
        """Add a vertex."""
        ...

    def conclude(self, drive: Drive, told: Told) -> Conclusion:
        """All of the log was taken up."""
        ...

    def prepare(self, drive: Drive) -> None:
        """Compile or load every kernel, given the drive of a rehearsal."""
        ...


class CrunchMapper:
    """Maps with Crunch's path filter."""

    def __init__(self, params: CrunchParams, seed: int, threads: int):
        self.params, self.seed, self.threads = params, seed, threads
        self.robot = Crunch(params)
        self.path_filter = crunch.make_estimator(params, seed, threads)
        self.echo_log = EchoLog(params.bundle.echoes)

    def note(self, row: int, message: Message) -> None:
        """Keep single echoes where they are to be bundled."""
        if isinstance(message, Ranges) and self.params.bundle.rounds > 0 and self.robot.sweep is not None:
            self.echo_log.look(row, self.robot.odometry, self.robot.sweep)

    def extend(self, keyframe: Keyframe) -> None:
        """Add a vertex."""
        self.path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled)

    def conclude(self, drive: Drive, told: Told) -> Conclusion:
        """Refine, or bundle echoes; while no path leads, begin again with other seeds.

        Bundled vertices have the particles' uncertainty, for what bundling leaves open is not known; of them the
        verdict says nothing, for it is bundles that are compared there.
        """
        echoes = self.echo_log.echoes()
        if len(echoes.points):
            best = best_bundled(self.path_filter, lambda path: bundled(drive, echoes, path, self.params))
            trajectory = correct(drive.odometry, echoes.rows, best.path)
            estimate = self.path_filter.estimate()._replace(path=trajectory[drive.rows])
            return Conclusion(estimate, trajectory, self.path_filter.path_filter.uncertainty(1), Verdict())
        self.path_filter.refine()
        found, verdict = decided(self.path_filter, drive.keyframes, self.params, self.seed, self.threads, told)
        estimate = found.estimate()
        return Conclusion(estimate, correct(drive.odometry, drive.rows, estimate.path), found.uncertainty(1), verdict)

    def prepare(self, drive: Drive) -> None:
        """Compile or load every kernel, given the drive of a rehearsal."""
        echoes = self.echo_log.echoes()
        if len(echoes.points):
            bundled(drive, echoes, drive.odometry[drive.rows], self.params)
        self.path_filter.prepare()


class MazeMapper:
    """Maps with Maze Runner's filter of grids."""

    def __init__(self, params: MazeRunnerParams, seed: int, threads: int):
        self.robot = MazeRunner(params)
        self.path_filter = maze_runner.make_estimator(params, seed, threads)
        self.times: list[float] = []  # of the odometry
        self.rows: list[int] = []  # of it, at which scans were taken
        self.followed: list[np.ndarray] = []  # where the laser's own odometry has them

    def note(self, row: int, message: Message) -> None:
        """Keep where each scan was taken: of those at one row the last."""
        if isinstance(message, (Odometry, Motors)):
            self.times.append(message.t)
        if isinstance(message, Ranges) and row >= 0 and self.robot.follower.last is not None:
            row = row_at(self.times, self.robot.taken)
            if self.rows and self.rows[-1] == row:
                self.followed[-1] = self.robot.follower.pose
            else:
                self.rows.append(row)
                self.followed.append(self.robot.follower.pose)

    def extend(self, keyframe: Keyframe) -> None:
        """Add a vertex."""
        self.path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled)

    def conclude(self, drive: Drive, told: Told) -> Conclusion:
        """Close the loops; between vertices the laser's own odometry leads, between scans that of the log."""
        if isinstance(self.path_filter, RefinedGridFilter):
            self.path_filter.refine()
        estimate = self.path_filter.estimate()
        laser = correct(compose(drive.odometry, self.robot.mount), np.array(self.rows), np.array(self.followed))
        trajectory = compose(correct(laser, drive.rows, estimate.path.astype(float)), inverse(self.robot.mount))
        return Conclusion(estimate, trajectory, self.path_filter.uncertainty(1), Verdict(), self.warnings())

    def warnings(self) -> tuple[str, ...]:
        """A word where loops were found that cannot all be true."""
        dropped = self.path_filter.dropped if isinstance(self.path_filter, RefinedGridFilter) else 0
        if not dropped:
            return ()
        return (
            f"{dropped} loops between scans were left out, for with them scans would see through walls: rooms here "
            "are alike, and the map's far ends may be off",
        )

    def prepare(self, drive: Drive) -> None:
        """Compile or load every kernel, given the drive of a rehearsal."""
        if isinstance(self.path_filter, RefinedGridFilter):
            self.path_filter.prepare()
            return
        for keyframe in drive.keyframes:
            self.extend(keyframe)


class CartMapper:
    """Feeds a cart's bumps to the estimator that its settings choose."""

    def __init__(self, params: BumperCartParams, seed: int, threads: int):
        self.robot = BumperCart(params)
        self.path_filter = bumper_cart.make_estimator(params, seed, threads)

    def note(self, row: int, message: Message) -> None:
        """Nothing more is needed than vertices."""

    def extend(self, keyframe: Keyframe) -> None:
        """Add a vertex."""
        self.path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled)

    def conclude(self, drive: Drive, told: Told) -> Conclusion:
        """Refine the map, if it is one of its own; between bumps the odometry leads."""
        self.path_filter.conclude()
        estimate = self.path_filter.estimate()
        trajectory = correct(drive.odometry, drive.rows, estimate.path.astype(float))
        walls = self.walls()
        beliefs = self.path_filter.beliefs if isinstance(self.path_filter, LocalizedCart) else ()
        grid = swept_map(trajectory, walls, self.robot.cart.bumper_width, self.robot.cart.bumper_ahead)
        floor = FloorMap(estimate.path, walls, len(estimate.path), grid, (trajectory, trajectory[-1:]))
        return Conclusion(
            estimate, trajectory, self.path_filter.uncertainty(1), Verdict(), tuple(self.warnings()), floor, beliefs
        )

    def walls(self) -> list[np.ndarray]:
        """Curves (k, 2) of the known map, or of the one that was made."""
        if isinstance(self.path_filter, LocalizedCart):
            walls = self.path_filter.localizer.area.walls
            return [np.array([[x0, y0], [x1, y1]]) for x0, y0, x1, y1 in walls]
        return self.path_filter.map().walls

    def warnings(self) -> list[str]:
        """What a person should know."""
        found = []
        truant = sum(run.truant for run in self.robot.runs)
        if truant:
            found.append(f"{truant} stages of the run were lost on the way and in the robot's own log")
        if isinstance(self.path_filter, LocalizedCart):
            known = self.path_filter.found
            if known is None:
                found.append("no place on the map explains the cart's bumps; is it the map of where it drove?")
            elif not known.is_localized:
                shares = ", ".join(f"{100.0 * cluster.share:.0f} %" for cluster in known.clusters[:4])
                found.append(
                    f"the cart is not localized: it may be in {len(known.clusters)} places of the map ({shares}); more "
                    "bumps may tell, unless the map looks alike from them"
                )
        elif not (made := self.path_filter.map()).is_sure:
            found.append(
                f"the map is doubtful: with a probability of {100.0 * made.doubt:.0f} % its walls are off by 5 cm or "
                "more; more bumps may tell"
            )
        return found

    def prepare(self, drive: Drive) -> None:
        """Compile or load every kernel, given the drive of a rehearsal."""
        for keyframe in drive.keyframes:
            self.extend(keyframe)
        self.path_filter.conclude()


def row_at(times: list[float], t: float) -> int:
    """The newest row of the odometry that is not younger than what was seen at time t; the first where all are."""
    row = len(times) - 1
    while row > 0 and times[row] > t:
        row -= 1
    return row


def mapper_of(params: RobotParams, seed: int = 0, threads: int = 1) -> Mapper:
    """The mapper of the robot whose parameters these are."""
    if isinstance(params, MazeRunnerParams):
        return MazeMapper(params, seed, threads)
    if isinstance(params, BumperCartParams):
        return CartMapper(params, seed, threads)
    return CrunchMapper(params, seed, threads)


def bundled(drive: Drive, echoes: Echoes, path: np.ndarray, params: CrunchParams) -> Refined:
    """What becomes of the places that echoes hang on when those along a path (v, 3) are bundled."""
    rows = echoes.rows
    way = path_length(drive.odometry)[rows]
    chain = Chain.along(drive.odometry[rows], np.diff(way, prepend=way[0]))
    poses = correct(drive.odometry, drive.rows, path)[rows]
    return bundle(poses, chain, echoes, params.filter.motion, params.bundle)


def with_sensors(params: Any, log: Log) -> Any:
    """The robot with the senses that the log was made with; ConfigError where the robot's own do not fit it."""
    if isinstance(params, BumperCartParams):
        return params.model_copy(update={"build": CartBuild.of(log.cart)}) if log.cart else params
    if isinstance(params, MazeRunnerParams):
        return params.model_copy(update={"laser": log.laser, "laser_delay": 0.0}) if log.laser else params
    if log.sensors:
        return params.model_copy(update={"sensors": log.sensors})
    check_rings(params.sensors)
    return params


def senses_of(params: RobotParams) -> dict[str, tuple[int, float]]:
    """How many ranges each of the robot's sensors gives, and how far it sees."""
    if isinstance(params, MazeRunnerParams):
        return {SENSOR: (params.laser.beams, params.laser.max_range)}
    if isinstance(params, BumperCartParams):
        return {}
    return {name: (len(ring.bearings_deg), ring.max_range) for name, ring in params.sensors.items()}


def odometry_noise(params: RobotParams) -> tuple[float, float]:
    """Of the odometry that keyframes come with: rad and m per root metre."""
    if isinstance(params, MazeRunnerParams):
        return params.filter.odometry.turn, params.filter.odometry.distance
    if isinstance(params, BumperCartParams):
        return params.build.params.turn_noise, params.build.params.distance_noise
    return params.filter.motion.turn_noise, params.filter.motion.distance_noise
