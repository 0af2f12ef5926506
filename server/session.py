"""One connection to one robot: bytes in, effects out, and the account of what the link lost on the way.

The same object serves live, replay and simulation. It asks no clock, awaits nothing and opens no file: times come in
with the bytes, in seconds since the session's start, and whoever wants a recording hands in a sink. Uses its siblings
`health`, `laser_line` and `mouse_line`.
"""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from server import channels, link
from server.clock import BoardClock
from server.commands import Command, StopCommand
from server.health import SourceHealth
from server.laser_line import LaserLine
from server.messages import Arm, Drive, Effect, Goal, Message, Stop
from server.mouse_line import MouseLine
from server.recording import Kind
from server.robots.kinds import LASER, ROBOTS, mouse_lines

STOP_REPEATS = 3
COMMANDS: dict[str, type[Drive | Goal | Stop | Arm]] = {"drive": Drive, "goal": Goal, "stop": Stop, "arm": Arm}


class Robot(Protocol):
    """What a session needs of a robot."""

    def step(self, message: Message) -> list[Effect]:
        """The effects of one message."""
        ...


class Sink(Protocol):
    """What a session needs of a recording."""

    def append(self, kind: Kind, link_id: str, data: bytes, t: float) -> None:
        """Keeps one record; `link_id` is empty for marks."""
        ...


class SideLine(Protocol):
    """A line on which something other than a board speaks for itself, in words of its own."""

    name: str  # of what it tells, among the frames
    fault: str  # that somebody must mend; empty if there is none
    refused: Counter[str]

    @property
    def rejected(self) -> int:
        """What came and could not be read."""
        ...

    def receive(self, data: bytes, t: float) -> Sequence[Message]:
        """What bytes tell that came at time t (s)."""
        ...

    def requests(self, t: float) -> bytes:
        """What is to be said to it now."""
        ...


class Session:
    """Routes bytes to messages to the robot, counts what was refused, and gives commands their numbers and echoes.

    `boards` are the source numbers of the robot's, of which exactly one drives; nobody else is believed. On the links
    of `lines` a laser or a mouse speaks for itself.
    """

    def __init__(
        self,
        robot: Robot,
        calibration: channels.Calibration,
        sink: Sink | None = None,
        boards: tuple[int, ...] = (channels.DRIVE, channels.SENSOR),
        lines: Mapping[str, SideLine] | None = None,
    ) -> None:
        self.robot = robot
        self.calibration = calibration
        self.sink = sink
        self.t = 0.0  # newest time that came in
        self.decoders: dict[str, link.Decoder] = {}
        self.lines = dict(lines or {})
        self.clocks = {source: BoardClock() for source in boards}
        [self.driver] = [source for source in boards if source in channels.DRIVERS]
        self.health_of = {source: SourceHealth() for source in self.clocks}
        self.frames: Counter[str] = Counter()  # good ones, by channel
        self.refused: Counter[str] = Counter()  # by reason
        self.versions: dict[int, int] = {}  # of boards that speak another protocol
        self.drive_link = ""  # where the board that drives was last heard: commands go there
        self.sequence = 0  # of the host's next frame

    def receive(self, link_id: str, data: bytes, t: float) -> list[Effect]:
        """Effects of the bytes that came over a link at time t."""
        self.t = t = whole_nanoseconds(t)
        if self.sink:
            self.sink.append(Kind.RX, link_id, data, t)
        if link_id in self.lines:
            line = self.lines[link_id]
            told = line.receive(data, t)
            self.frames[line.name] += len(told)
            return [effect for message in told for effect in self.robot.step(message)]
        decoder = self.decoders.get(link_id)
        if decoder is None:
            decoder = self.decoders[link_id] = link.Decoder()
        effects = []
        for frame in decoder.feed(data):
            for message in self._accept(frame, link_id, t):
                effects.extend(self.robot.step(message))
        return effects

    def command(self, message: Drive | Goal | Stop | Arm, t: float) -> list[Effect]:
        """Effects of a person's command; recorded as a mark, from which `command_of` makes it again."""
        self.t = t = whole_nanoseconds(t)
        message = dataclasses.replace(message, t=t)
        self.mark({"command": type(message).__name__.lower(), **dataclasses.asdict(message)}, t)
        return self.robot.step(message)

    def mark(self, content: dict, t: float) -> None:
        """Writes a mark (JSON) into the recording, if there is one."""
        if self.sink:
            self.sink.append(Kind.MARK, "", json.dumps(content).encode(), whole_nanoseconds(t))

    def encode(self, command: Command) -> bytes:
        """A command's bytes for `drive_link`, recorded as sent; a stop is said three times."""
        repeats = STOP_REPEATS if isinstance(command, StopCommand) else 1
        data = b"".join(self._frame(command) for _ in range(repeats))
        if self.sink:
            self.sink.append(Kind.TX, self.drive_link, data, self.t)
        return data

    def requests(self, t: float) -> dict[str, bytes]:
        """What other lines than boards' are to be told at time t, by link, recorded as sent; mostly nothing."""
        asked = {link_id: request for link_id, line in self.lines.items() if (request := line.requests(t))}
        for link_id, request in asked.items():
            if self.sink:
                self.sink.append(Kind.TX, link_id, request, whole_nanoseconds(t))
        return asked

    def health(self, t: float) -> dict:
        """What the link is worth at time t, for people: counts since the start and, per board, the last seconds."""
        return {
            "frames": dict(self.frames),
            "rejected": sum(decoder.rejected for decoder in self.decoders.values())
            + sum(line.rejected for line in self.lines.values()),
            "refused": dict(sum((line.refused for line in self.lines.values()), self.refused)),
            "faults": {link_id: line.fault for link_id, line in self.lines.items()},
            "lost": sum(health.lost for health in self.health_of.values()),
            "boards": {
                channels.SOURCES[source]: {
                    **self.health_of[source].summary(t),
                    "drift": clock.drift,
                    "reboots": clock.reboots,
                    "wrong_version": self.versions.get(source),
                }
                for source, clock in self.clocks.items()
            },
        }

    def _accept(self, frame: link.Frame, link_id: str, arrival: float) -> list[Message]:
        """The messages of a frame that is one of ours; otherwise none, and one more count.

        Only a frame that passed every sieve may touch the clock and the counters, so that noise cannot.
        """
        try:
            values = channels.read(frame, self.clocks)
        except channels.Refused as refused:
            self.refused[refused.reason] += 1
            if refused.reason == "version" and frame.payload:
                self.versions[frame.source] = frame.payload[0]
            return []
        clock, health = self.clocks[frame.source], self.health_of[frame.source]
        if frame.channel == channels.STATUS:
            self.versions.pop(frame.source, None)
            if clock.status(frame.time_ms, *channels.uptime_and_boots(values), arrival):
                health.restart()
        elif frame.source in self.versions:
            self.refused["version"] += 1
            return []
        if frame.source == self.driver:
            self.drive_link = link_id
        self.frames[channels.CHANNELS[frame.channel].name] += 1
        sampled = clock.to_host(frame.time_ms, arrival)
        health.count(frame.sequence, arrival, sampled)
        return channels.convert(frame, values, sampled, self.calibration)

    def _frame(self, command: Command) -> bytes:
        addressee = self.driver if isinstance(command, StopCommand) else channels.addressee(command)
        echo_ms = self.clocks[addressee].newest_ms
        frame = channels.encode_command(command, self.sequence, echo_ms)
        self.sequence = (self.sequence + 1) % 256
        return link.encode(frame)


def session_of(name: str, robot: Robot, params: Any, sink: Sink | None = None) -> Session:
    """The session of a robot by its name, with the lines that such a one speaks on; `params` are the robot's."""
    kind = ROBOTS[name]
    calibration = getattr(params, "calibration", channels.Calibration())
    lines: dict[str, SideLine] = {LASER: LaserLine(params.laser)} if kind.has_laser else {}
    lines |= {link_id: MouseLine(number) for number, link_id in enumerate(mouse_lines(kind.mice))}
    return Session(robot, calibration, sink, kind.boards, lines)


def whole_nanoseconds(t: float) -> float:
    """The time that a recording gives back for t, so that a replay sees the very same number."""
    return round(t * 1e9) / 1e9


def command_of(mark: bytes) -> Drive | Goal | Stop | Arm | None:
    """The person's command that a mark of a recording tells of, or None if it tells of something else."""
    fields = json.loads(mark)
    kind = COMMANDS.get(fields.pop("command", ""))
    if kind is None:
        return None
    if kind is Goal:
        fields["place"] = None if fields["place"] is None else tuple(fields["place"])
        fields["route"] = tuple(tuple(place) for place in fields.get("route", ()))
    return kind(**fields)
