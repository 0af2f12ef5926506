"""Any log as one thing: what kind of file it is, the typed messages in it, and the senses it was made with."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from server.channels import Calibration
from server.formats import carmen, crazyflie, sonar8, sparse
from server.formats.errors import FormatError, read_bytes
from server.messages import Message
from slam.rangefinder import RingParams

SNIFFED = 1 << 20  # bytes of a text file looked at for rows that tell its kind; comments and PARAM rows come first
KNOWN = (
    "crunch reads its own recordings (.rlog), CARMEN logs, a Crazyflie's bags, "
    "and sonar8 (measurement.txt beside poses.txt)"
)


@dataclass(frozen=True)
class Log:
    """A log that can be read again and again; each call of `messages` begins at its start."""

    path: Path
    kind: str  # "rlog", "carmen", "crazyflie" or "sonar8"
    description: str
    source: Callable[[Calibration], Iterator[Message]]
    sensors: dict[str, RingParams] | None  # the rings that its Ranges speak of; None: the robot's own
    n_odometry: int  # exact in foreign logs, about so many in our own
    robot: str | None = None  # who recorded it, if it says so
    configuration: Mapping[str, Any] = field(default_factory=dict)  # that it was recorded with, or its robot's preset
    mount: np.ndarray = field(default_factory=lambda: np.zeros(3))  # pose on the robot of the frame that Odometry moves
    truncated_at: int | None = None  # where the file was cut: a line, or an offset in a recording
    warnings: tuple[str, ...] = ()

    def messages(self, calibration: Calibration | None = None) -> Iterator[Message]:
        """The messages in file order; raw counts of our own recordings become metres by the calibration."""
        return self.source(calibration or Calibration())


def read_log(path: Path | str, beams: int | None = None, max_range: float | None = None) -> Log:
    """A foreign log; FormatError says what is wrong with it and what to do.

    `beams` and `max_range` thin a laser to so many beams of that reach; without them it stands for Crunch's senses.
    """
    path = Path(path)
    reduction = sparse.Reduction(beams, max_range)
    folder = sonar8.folder_of(path)
    if folder is not None:
        check_laser(folder, beams)
        return sonar8_log(folder)
    content = read_bytes(path, "name a log file")
    if not content.strip():
        raise FormatError(path, None, "is empty", "name a log that holds something")
    if crazyflie.is_bag(content):
        check_laser(path, beams)
        return crazyflie_log(path)
    if carmen.is_carmen(content[:SNIFFED]):
        return carmen_log(path, reduction)
    raise FormatError(path, None, "is no log that crunch knows", KNOWN)


def check_laser(path: Path, beams: int | None) -> None:
    """FormatError where a laser is to be thinned in a log that has none."""
    if beams is not None:
        raise FormatError(path, None, "has no laser that --beams could thin", "leave out --beams and --max-range")


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


def carmen_log(path: Path, reduction: sparse.Reduction) -> Log:
    """A laser that stands for few beams."""
    recording = carmen.read_carmen(path)
    sensors = sparse.sensors_of(recording.bearings, reduction)
    names = " and ".join(f"{len(sensor.windows)} {sensor.name} bearings" for sensor in sensors)
    warnings = []
    if recording.truncated_at is not None:
        warnings.append(f"{path}:{recording.truncated_at}: the last row is cut; replayed up to it")
    density = sparse.scans_per_half_metre(recording)
    if reduction.beams is None and density < sparse.DENSE:
        warnings.append(
            f"{path}: {density:.1f} scans per half metre driven are few for Crunch's senses, "
            f"which need {sparse.DENSE:g}; use a denser log, or --beams"
        )
    return Log(
        path=path,
        kind="carmen",
        description=f"{len(recording.scans)} laser scans as {names}",
        source=lambda _: sparse.messages(recording, sensors),
        sensors={sensor.name: sensor.ring for sensor in sensors},
        n_odometry=len(recording.odometry),
        configuration={} if reduction.beams is None else {"preset": "beams"},
        mount=recording.mount,
        truncated_at=recording.truncated_at,
        warnings=tuple(warnings),
    )
