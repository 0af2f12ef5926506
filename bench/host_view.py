"""What a host of the server's own code makes of the bytes that a radio leaves, against what the boards really said."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from firmware.virtual.avr import AvrCrunch
from server import channels
from server.clock import nearest
from server.link import Decoder, Frame
from server.messages import Message
from server.session import Session

SENSOR_RATE = 1.0001  # ms of the sensor board's crystal per ms
REMEMBERED = 4000  # frames of the boards: half a minute


class Nobody:
    """A robot's program that does nothing."""

    def step(self, message: Message) -> list:
        """No effects."""
        return []


class Believed(NamedTuple):
    """A frame, when the host takes it to be sampled, and when it came (s)."""

    frame: Frame
    sampled: float
    arrival: float


class Host(Session):
    """The server's end of the link, which keeps what it believed."""

    def __init__(self) -> None:
        super().__init__(Nobody(), channels.Calibration())
        self.believed: list[Believed] = []

    def _accept(self, frame: Frame, link_id: str, arrival: float) -> list[Message]:
        messages = super()._accept(frame, link_id, arrival)
        if messages:
            self.believed.append(Believed(frame, messages[0].t, arrival))
        return messages


class Tapped(AvrCrunch):
    """A robot whose boards are heard before the radio as well, and that can be looked at every millisecond."""

    said = b""

    def look(self) -> None:
        """A millisecond has passed."""

    def run(self, ms: int) -> bytes:
        data = b""
        for _ in range(ms):
            data += super().run(1)
            self.look()
        self.said += data
        return data


class Tap:
    """The frames that the boards sent of late, each with the time at which it was sampled (s, but for a constant)."""

    def __init__(self, robot: Tapped):
        self.robot = robot
        self.decoder = Decoder()
        self.times: dict[Frame, float] = {}
        self.order: deque[Frame] = deque()
        self.starts = {channels.DRIVE: 0.0, channels.SENSOR: 0.0}  # s, when each board booted
        self.resets = {channels.DRIVE: 1, channels.SENSOR: 1}

    def listen(self) -> int:
        """Takes what was said since the last call; returns how many frames."""
        self.note_resets()
        frames = self.decoder.feed(self.robot.said)
        self.robot.said = b""
        for frame in frames:
            self.times[frame] = self.sampled(frame)
            self.order.append(frame)
            if len(self.order) > REMEMBERED:
                self.times.pop(self.order.popleft(), None)
        return len(frames)

    def sampled(self, frame: Frame) -> float:
        """When a frame was sampled that has just been sent."""
        start = self.starts[frame.source]
        rate = 1000.0 * (SENSOR_RATE if frame.source == channels.SENSOR else 1.0)
        return start + nearest(frame.time_ms, round(rate * (self.robot.time - start))) / rate

    def note_resets(self) -> None:
        """A board that has booted counts from 0 again."""
        boards = {channels.DRIVE: self.robot.robot.drive, channels.SENSOR: self.robot.robot.sensor}
        for source, board in boards.items():
            resets = self.robot.lib.microcontroller_resets(board)
            if resets != self.resets[source]:
                self.resets[source], self.starts[source] = resets, self.robot.time


class HostView:
    """Counts what the host heard of what was said, what it believed though nobody said it, and how its clocks err."""

    def __init__(self, robot: Tapped):
        self.host = Host()
        self.tap = Tap(robot)
        self.begin()

    def begin(self) -> None:
        """Everything counts from now on."""
        self.said = self.heard = self.false = 0
        self.errors: dict[int, list[float]] = {channels.DRIVE: [], channels.SENSOR: []}
        self.arrivals: dict[int, list[float]] = {channels.DRIVE: [], channels.SENSOR: []}
        self.host.believed = []

    def look(self, knows_clocks: bool) -> None:
        """Compares what was believed since the last time with what was said; and the clocks, if they can be known."""
        self.said += self.tap.listen()
        self.heard += len(self.host.believed)
        for frame, sampled, arrival in self.host.believed:
            true = self.tap.times.get(frame)
            self.false += true is None
            if true is not None and knows_clocks:
                self.errors[frame.source].append(sampled - true)
            self.arrivals[frame.source].append(arrival)
        self.host.believed = []

    def clock_errors(self) -> np.ndarray:
        """How far each time is from its board's usual one (s): what is the same for all is the shortest way."""
        return np.concatenate([np.abs(np.array(errors) - np.median(errors or 0.0)) for errors in self.errors.values()])

    def longest_gap(self, source: int) -> float:
        """Without a frame of a board (s)."""
        return float(np.max(np.diff(self.arrivals[source])))

    def first_after(self, source: int, t: float) -> float:
        """How long after t the next frame of a board came (s)."""
        return next((arrival - t for arrival in self.arrivals[source] if arrival > t), float("inf"))
