"""Our own recordings as logs: the bytes go through the same session as when they came in, and come out as messages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from server.channels import Calibration
from server.config import Config, ConfigError, check_robot, load
from server.formats.errors import FormatError, read_bytes
from server.formats.logs import Log, read_log
from server.messages import Effect, Message
from server.recording import Header, Kind, Reader, Record, is_recording
from server.session import session_of
from slam.rangefinder import RingParams

ODOMETRY_RATE = 50.0  # Hz
RING_SIZES = {"sonar": 8, "infrared": 8}  # ranges in a frame of each kind


def check_senses(robot: str, settings: Config) -> None:
    """ConfigError where a robot's senses are set to others than its boards report."""
    if robot == "crunch":
        check_rings(settings.crunch.sensors)


def check_rings(sensors: Mapping[str, RingParams]) -> None:
    """ConfigError where a ring has another number of bearings than the boards report ranges."""
    for name, size in RING_SIZES.items():
        found = len(sensors[name].bearings_deg) if name in sensors else size
        if found != size:
            key = f"crunch.sensors.{name}.bearings_deg"
            raise ConfigError(f"settings: `{key}` has {found} bearings, but the boards report {size}; give {size}")


class Listener:
    """A robot that does nothing but remember what it was told."""

    def __init__(self) -> None:
        self.messages: list[Message] = []

    def step(self, message: Message) -> list[Effect]:
        """Keep the message; nothing follows from it."""
        self.messages.append(message)
        return []

    def take(self) -> list[Message]:
        """What was told since the last call."""
        taken, self.messages = self.messages, []
        return taken


def open_log(
    path: Path | str, beams: int | None = None, max_range: float | None = None, robot: str | None = None
) -> Log:
    """Any log, ours or foreign, as a robot takes it; UserError says what is wrong with it and what to do."""
    path = Path(path)
    if path.is_file():
        read_bytes(path)  # tells what hinders reading before anything guesses at the content
        if path.suffix == ".rlog" or is_recording(path):
            if beams is not None:
                told = "is a recording of a robot, which is replayed whole"
                raise FormatError(path, None, told, "leave out --beams and --max-range")
            return recorded_log(path)
    return read_log(path, beams, max_range, robot)


def robot_of(path: Path) -> str | None:
    """The robot that a recording says it is of; None for other logs, and where there is none."""
    is_ours = path.is_file() and (path.suffix == ".rlog" or is_recording(path))
    return Reader(path).header.robot if is_ours else None


def recorded_log(path: Path) -> Log:
    """A recording; a cut one ends at the cut and says so. FormatError where not a single frame can be read."""
    reader = Reader(path)
    check_robot(reader.header.robot)
    records = [record for record in reader if record.kind == Kind.RX]
    if next(decode(reader.header, records, Calibration()), None) is None:
        raise FormatError(
            path, None, "holds no frame that can be read", "record again; the link may run at another speed"
        )
    warnings = [f"{path}:{at}: {size} damaged bytes were passed over" for at, size in reader.skipped]
    if reader.truncated_at is not None:
        warnings.append(f"{path}:{reader.truncated_at}: the recording is cut here; replayed up to it")
    return Log(
        path=path,
        kind="rlog",
        description=f"{len(records)} records of a session with {reader.header.robot}",
        source=lambda calibration: decode(reader.header, records, calibration),
        sensors=None,
        n_odometry=max(1, round((records[-1].t - records[0].t) * ODOMETRY_RATE)),
        robot=reader.header.robot,
        configuration=reader.header.configuration,
        truncated_at=reader.truncated_at,
        warnings=tuple(warnings),
    )


def decode(header: Header, records: list[Record], calibration: Calibration) -> Iterator[Message]:
    """The messages in the bytes of a session, in the order in which they came."""
    listener = Listener()
    params = getattr(load(header=header.configuration), header.robot)
    session = session_of(header.robot, listener, params)
    session.calibration = calibration
    for record in records:
        session.receive(record.link_id, record.data, record.t)
        yield from listener.take()
