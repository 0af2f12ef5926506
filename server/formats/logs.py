"""Any log as one thing: what kind of file it is, the typed messages in it, and the senses it was made with."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from server.channels import Calibration
from server.formats import bags, carmen, crazyflie, laser, lego, mines, neato, rcx, roomba, sonar8, sparse, wean
from server.formats.cart_log import CartLog, cart_messages
from server.formats.errors import FormatError, read_bytes
from server.formats.laser import LaserLog
from server.messages import Message
from slam.cart_odometry import CartParams
from slam.laser_scan import LaserParams
from slam.rangefinder import RingParams

SNIFFED = 1 << 20  # bytes of a text file looked at for rows that tell its kind; comments and PARAM rows come first
MAZE_RUNNER, BUMPER_CART = "maze_runner", "bumper_cart"
CARTS = (("roomba", roomba.is_roomba, roomba.read_roomba), ("rcx", rcx.is_rcx, rcx.read_rcx))
ALONE: Mapping[str, Any] = {MAZE_RUNNER: {"odometry": {"is_alone": True}}}  # settings of a laser without odometry
UNEVEN = 0.01  # of a step between beams that another may differ
KNOWN = (
    "crunch reads its own recordings (.rlog), CARMEN logs, ROS 1 bags of a laser or a Crazyflie, logs of the mines, "
    "of Wean Hall and of the LEGO robot, sonar8 (measurement.txt beside poses.txt), and for bumper_cart logs "
    "of a Roomba, a Neato's bags and an RCX's data log"
)


@dataclass(frozen=True)
class Log:
    """A log that can be read again and again; each call of `messages` begins at its start."""

    path: Path
    kind: str  # "rlog", "carmen", "bag", "crazyflie", "lego", "mines", "neato", "rcx", "roomba", "sonar8" or "wean"
    description: str
    source: Callable[[Calibration], Iterator[Message]]
    sensors: dict[str, RingParams] | None  # the rings that its Ranges speak of; None: the robot's own, or a laser
    n_odometry: int  # exact in foreign logs, about so many in our own
    robot: str | None = None  # who recorded it, if it says so
    configuration: Mapping[str, Any] = field(default_factory=dict)  # that it was recorded with, or its robot's preset
    mount: np.ndarray = field(default_factory=lambda: np.zeros(3))  # pose on the robot of the frame that Odometry moves
    truncated_at: int | None = None  # where the file was cut: a line, or an offset in a recording
    warnings: tuple[str, ...] = ()
    cart: CartParams | None = None  # the build of the robot with a bumper
    laser: LaserParams | None = None  # whose whole scans its Ranges are; its place on the robot is the mount

    def messages(self, calibration: Calibration | None = None) -> Iterator[Message]:
        """The messages in file order; raw counts of our own recordings become metres by the calibration."""
        return self.source(calibration or Calibration())


def read_log(
    path: Path | str, beams: int | None = None, max_range: float | None = None, robot: str | None = None
) -> Log:
    """A foreign log; FormatError says what is wrong with it and what to do.

    A laser's whole scans are for Maze Runner; for Crunch it stands for that robot's senses, or is thinned to so many
    `beams` that reach `max_range`. Unless a `robot` is named, CARMEN logs are Crunch's, and others as they are.
    """
    path = Path(path)
    if beams is not None and robot == MAZE_RUNNER:
        raise FormatError(path, None, "is to be thinned by --beams", "leave it out; maze_runner takes whole scans")
    reduction = sparse.Reduction(beams, max_range)
    is_whole = robot == MAZE_RUNNER or (robot is None and beams is None)
    folder = sonar8.folder_of(path)
    if folder is not None:
        check_laser(folder, beams)
        check_few(folder, robot)
        return sonar8_log(folder)
    stem = lego.stem_of(path)
    if stem is not None:
        return laser_log("lego", lego.read_lego(stem), None if is_whole else reduction)
    content = read_bytes(path, "name a log file")
    if not content.strip():
        raise FormatError(path, None, "is empty", "name a log that holds something")
    if bags.is_bag(content):
        if any(topic.endswith(crazyflie.ENDS) for topic in bags.topics_in(path)):
            check_laser(path, beams)
            check_few(path, robot)
            return crazyflie_log(path)
        if robot == BUMPER_CART:
            return cart_log("neato", neato.read_neato(path).cart)
        return laser_log("bag", bags.read_laser_bag(path), None if is_whole else reduction)
    if carmen.is_carmen(content[:SNIFFED]):
        return laser_log("carmen", carmen.read_carmen(path), None if robot == MAZE_RUNNER else reduction)
    for kind, is_like, read in (("mines", mines.is_mines, mines.read_mines), ("wean", wean.is_wean, wean.read_wean)):
        if is_like(content[:SNIFFED]):
            return laser_log(kind, read(path), None if is_whole else reduction)
    if robot in (None, BUMPER_CART):
        for kind, is_like, read in CARTS:
            if is_like(content[:SNIFFED]):
                return cart_log(kind, read(path))
    raise FormatError(path, None, "is no log that crunch knows", KNOWN)


def cart_log(kind: str, read: CartLog) -> Log:
    """A robot with a bumper; stages whose times are not known are a second apart."""
    times = np.where(np.isnan(read.times), np.arange(len(read.times), dtype=float), read.times)
    bumps = sum(stage.bumper != 0 for stage in read.stages)
    cut = () if read.truncated_at is None else (f"{read.path}:{read.truncated_at}: the log is cut; replayed up to it",)
    return Log(
        path=read.path,
        kind=kind,
        description=f"{len(read.stages)} stages with {bumps} bumps",
        source=lambda _: cart_messages(read.stages, times),
        sensors=None,
        n_odometry=len(read.stages) + 1,
        robot=BUMPER_CART,
        truncated_at=read.truncated_at,
        warnings=cut,
        cart=read.params,
    )


def check_laser(path: Path, beams: int | None) -> None:
    """FormatError where a laser is to be thinned in a log that has none."""
    if beams is not None:
        raise FormatError(path, None, "has no laser that --beams could thin", "leave out --beams and --max-range")


def check_few(path: Path, robot: str | None) -> None:
    """FormatError where a log of a few rangefinders is to be mapped by a robot that needs a laser's whole scans."""
    if robot == MAZE_RUNNER:
        raise FormatError(path, None, f"has no laser's scans, which {MAZE_RUNNER} maps with", "leave out --robot")


def sonar8_log(folder: Path) -> Log:
    """Eight real sonars."""
    recording = sonar8.read_sonar8(folder)
    return Log(
        path=folder,
        kind="sonar8",
        description=f"{len(recording.times)} sweeps of eight sonars",
        source=lambda _: sonar8.messages(recording),
        sensors={"sonar": sonar8.RING},
        n_odometry=len(recording.times),
    )


def crazyflie_log(path: Path) -> Log:
    """Four time-of-flight beams of a nano-quadrotor."""
    recording = crazyflie.read_crazyflie(path)
    return Log(
        path=path,
        kind="crazyflie",
        description=f"{len(recording.times)} sweeps of four time-of-flight beams",
        source=lambda _: crazyflie.messages(recording),
        sensors={"laser": crazyflie.RING},
        n_odometry=len(recording.times),
        configuration={"preset": "crazyflie"},
    )


def laser_log(kind: str, recording: LaserLog, reduction: sparse.Reduction | None) -> Log:
    """A laser: whole, or reduced so that it stands for few beams."""
    path, n_scans = recording.path, len(recording.scans)
    warnings = []
    if recording.truncated_at is not None:
        warnings.append(f"{path}:{recording.truncated_at}: the last row is cut; replayed up to it")
    if reduction is None:
        return Log(
            path=path,
            kind=kind,
            description=f"{n_scans} laser scans of {len(recording.bearings)} beams",
            source=lambda _: laser.messages(recording),
            sensors=None,
            n_odometry=len(recording.odometry),
            robot=MAZE_RUNNER,
            configuration={} if recording.has_odometry else ALONE,
            mount=recording.mount,
            truncated_at=recording.truncated_at,
            warnings=tuple(warnings),
            laser=laser_of(recording),
        )
    if not recording.has_odometry:
        raise FormatError(
            path, None, "holds no odometry", "only maze_runner maps with a laser alone; leave out --robot"
        )
    sensors = sparse.sensors_of(recording.bearings, reduction)
    names = " and ".join(f"{len(sensor.windows)} {sensor.name} bearings" for sensor in sensors)
    density = sparse.scans_per_half_metre(recording)
    if reduction.beams is None and density < sparse.DENSE:
        warnings.append(
            f"{path}: {density:.1f} scans per half metre driven are few for Crunch's senses, "
            f"which need {sparse.DENSE:g}; use a denser log, or --beams"
        )
    return Log(
        path=path,
        kind=kind,
        description=f"{n_scans} laser scans as {names}",
        source=lambda _: sparse.messages(recording, sensors),
        sensors={sensor.name: sensor.ring for sensor in sensors},
        n_odometry=len(recording.odometry),
        configuration={} if reduction.beams is None else {"preset": "beams"},
        mount=recording.mount,
        truncated_at=recording.truncated_at,
        warnings=tuple(warnings),
    )


def laser_of(recording: LaserLog) -> LaserParams:
    """The laser of a log, whose place on the robot is told apart; FormatError where its beams are not even."""
    degrees = np.degrees(recording.bearings)
    steps = np.diff(degrees)
    if len(steps) < 1 or float(np.ptp(steps)) > UNEVEN * float(np.mean(steps)):
        raise FormatError(recording.path, None, "has a laser of uneven beams", "only lasers with even steps are mapped")
    finite = recording.scans[np.isfinite(recording.scans)]
    reach = float(finite.max()) if finite.size else 1.0
    return LaserParams(
        beams=len(degrees),
        first_deg=float(degrees[0]),
        step_deg=float(np.mean(steps)),
        max_range=min(reach + 1e-6, 200.0),
    )
