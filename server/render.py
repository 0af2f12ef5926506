"""A recording turned into the frames that a viewer of its session would have got, faster than it was driven.

The bytes go through the same bridge, session and robot as live, with a path filter that computes at once; what the
bridge publishes is kept in a cache instead of being sent. Without a clock and without chance: the same recording gives
the same frames. `run` is the main function of a process of its own. Uses its siblings `bridge` and `recorded`.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import time
from collections.abc import Callable
from dataclasses import astuple
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from server.bridge import Bridge
from server.config import Config, check_robot, load
from server.control import Control
from server.errors import UserError
from server.estimator import InlineEstimator
from server.recorded import check_senses
from server.recording import Header, Kind, Reader, Record
from server.replay_cache import CacheWriter, Progress, remove
from server.rest.present import present_survey
from server.robots.kinds import ROBOTS
from server.session import command_of, session_of
from server.shelf import named
from server.stream import Viewer
from server.survey import pack
from server.views import SessionStatus

FRAME_PERIOD = 0.05  # s of the session between two looks
COMMIT_PERIOD = 0.25  # s of the renderer between two words to those who wait
LONGEST_SILENCE = 5.0  # s of the session that are rendered while nothing comes; a longer pause is jumped over
NICENESS = 5  # the session that runs beside it comes first

Tell = Callable[[Progress], None]


class DeafLink:
    """A link of the session that was: what is written goes nowhere, and its time is the recording's."""

    is_connected = True
    reconnects = 0
    speed = 1.0
    error = ""

    def __init__(self, spec: str):
        self.spec = spec
        self.time = 0.0

    def now(self) -> float:
        """The recording's time."""
        return self.time

    def write(self, data: bytes) -> bool:
        """To nobody."""
        return True

    async def run(self, receive: Any) -> None:
        """Never comes to anything."""

    def summary(self) -> dict:
        """Nothing to tell."""
        return {}


class Keeper(Viewer):
    """A viewer that keeps every frame with the time at which it came."""

    def __init__(self, keep: Callable[[str, bytes], None]):
        super().__init__("recording", self.refuse)
        self.keep = keep

    def put(self, topic: str, body: bytes) -> None:
        """Keep it; notices were for those who were there."""
        if topic != "notice":
            self.keep(topic, body)

    async def refuse(self, data: bytes) -> None:
        """Nothing is ever sent."""


class Rendering:
    """One recording on its way through the bridge; `keep(t, topic, body)` gets the frames."""

    def __init__(self, reader: Reader, config: Config, keep: Callable[[float, str, bytes], None]):
        self.reader = reader
        header = reader.header
        kind, params = ROBOTS[header.robot], getattr(config, header.robot)
        robot = kind.fold(params)
        session = session_of(header.robot, robot, params)
        self.links = {name.id: DeafLink(name.spec) for name in header.links} or {"": DeafLink("")}
        control = Control(config.control, runs_itself=kind.bumps)
        self.bridge = Bridge(robot, session, self.links, control, config.model_dump(mode="json"))  # type: ignore[arg-type]
        self.bridge.start = 0.0
        self.bridge.about = about(header, reader.path)
        self.bridge.estimator = InlineEstimator(
            lambda: kind.make_estimator(params, header.seed, 1), self.bridge.believe, config.estimator.shown
        )
        self.bridge.hub.join(Keeper(lambda topic, body: keep(self.t, topic, body)))
        self.t = 0.0
        self.shown = 0.0  # when the viewers looked last

    def take(self, record: Record) -> None:
        """Take up one record, and show what there was to see until then."""
        if record.t - self.shown > LONGEST_SILENCE:
            self.show_until(self.shown + LONGEST_SILENCE)
            self.shown = record.t - FRAME_PERIOD
        self.show_until(record.t)
        self.pass_to(record.t)
        if record.kind == Kind.RX:
            self.bridge.receive(record.link_id, record.data, record.t)
            reason = self.bridge.robot.stop_reason
            self.bridge.control.stops.watch(self.t, reason, is_connected=True)
        elif record.kind == Kind.MARK:
            self.remember(record.data)

    def remember(self, mark: bytes) -> None:
        """What was said and done beside the link."""
        with contextlib.suppress(ValueError, TypeError, KeyError):  # a mark of another version
            command = command_of(mark)
            if command is not None:
                self.bridge.tell([command], command.t)
            fields = json.loads(mark)
            self.bridge.labels.recall(fields.get("label", {}))
            if "stopped" in fields:
                self.bridge.control.stops.recall(fields["stopped"])
        name = named(mark, self.bridge.about.name)
        self.bridge.about = self.bridge.about.model_copy(update={"name": name})

    def finish(self) -> None:
        """The recording ends here: the last vertices are mapped, and shown."""
        self.bridge.end()
        self.bridge.publish(is_last=True)
        self.bridge.publish_status()

    def result(self) -> tuple[bytes, str]:
        """The map that came of it: a packed survey, and its labels as JSON."""
        snapshot = self.bridge.look()
        return pack(present_survey(self.bridge, snapshot)), json.dumps([astuple(label) for label in snapshot.labels])

    def show_until(self, t: float) -> None:
        """Look as often as viewers do."""
        while self.shown + FRAME_PERIOD <= t:
            self.shown += FRAME_PERIOD
            self.pass_to(self.shown)
            self.bridge.publish()

    def pass_to(self, t: float) -> None:
        """The clocks of all links go together."""
        self.t = max(self.t, t)
        for link in self.links.values():
            link.time = self.t


def about(header: Header, path: Path) -> SessionStatus:
    """The session that was recorded."""
    began = datetime.fromtimestamp(header.unix_ns * 1e-9, UTC)
    return SessionStatus(number=1, began=began, recording=path.stem)


def configuration(header: Header) -> Config:
    """The settings that a recording's session ran with; UserError if it is of a robot that nobody knows."""
    check_robot(header.robot)
    config = load(header=header.configuration)
    check_senses(header.robot, config)
    return config


def render(path: Path, writer: CacheWriter, tell: Tell = lambda progress: None) -> Progress:
    """Render a whole recording into a cache; UserError where it cannot be. The last progress says how it ended."""
    reader = Reader(path)
    records = list(reader)
    duration = max((record.t for record in records), default=0.0)
    rendering = Rendering(reader, configuration(reader.header), writer.add)
    note = note_of(reader)
    writer.commit(Progress(0.0, duration, note=note))
    told = time.monotonic()
    for record in records:
        rendering.take(record)
        if time.monotonic() - told > COMMIT_PERIOD:
            told = time.monotonic()
            writer.commit(Progress(rendering.t, duration, note=note))
            tell(Progress(rendering.t, duration, note=note))
    rendering.finish()
    writer.conclude(*rendering.result())
    last = Progress(rendering.t, duration, complete=True, note=note)
    writer.commit(last)
    tell(last)
    return last


def note_of(reader: Reader) -> str:
    """What a viewer should know about a recording that was read."""
    if reader.truncated_at is not None:
        return "This recording is cut; it replays up to the cut."
    gaps = len(reader.skipped)
    if gaps:
        return f"This recording is damaged in {gaps} {'place' if gaps == 1 else 'places'}, which are passed over."
    return ""


def run(recording: Path, cache: Path, parent: int) -> None:
    """Render in this process, which is nice to others and ends with its parent. A mistake is told in the cache."""
    for number in (signal.SIGINT, signal.SIGTERM):  # a whole process group may be told; the parent decides
        signal.signal(number, signal.SIG_IGN)
    os.nice(NICENESS)
    remove(cache)
    writer = CacheWriter(cache)

    def stay(progress: Progress) -> None:
        if os.getppid() != parent:
            raise SystemExit(1)

    try:
        writer.commit(Progress())
        render(recording, writer, stay)
    except UserError as error:
        writer.commit(Progress(error=str(error).removeprefix(f"{recording}: ")))
    finally:
        writer.close()
