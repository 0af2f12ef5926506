"""The radio between robot and host: a half-duplex line of 38,400 baud that packs, delays, loses and corrupts.

Modelled on a 900 MHz modem of the robot's time: it gathers bytes into chunks of at most 64, sends one chunk at a time
in either direction, drops whole chunks by its own checksum, and now and then lets a flipped bit through.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

BITS_PER_BYTE = 10  # 8N1


@dataclass(frozen=True)
class Radio:
    """Properties of the link; seconds, shares and bits."""

    latency: float = 0.03
    chunk_loss: float = 0.0
    bit_error_rate: float = 0.0
    baud: int = 38400
    chunk: int = 64
    turnaround: float = 0.002  # s to change direction
    max_queue: int = 1024  # bytes that wait on one side; more are lost, as in a modem's buffer

    def __post_init__(self) -> None:
        for name in ("chunk_loss", "bit_error_rate"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"radio: {name} must be between 0 and 1, found {getattr(self, name)}")
        if self.latency < 0.0 or self.baud <= 0 or self.chunk < 1:
            raise ValueError("radio: latency must not be negative, baud and chunk must be above 0")


@dataclass
class Direction:
    """One way: bytes that wait, and chunks on their way with their time of arrival."""

    waiting: bytearray = field(default_factory=bytearray)
    under_way: deque[tuple[float, bytes]] = field(default_factory=deque)
    sent: int = 0
    lost: int = 0

    def arrived(self, time: float) -> bytes:
        """What has come in by `time`."""
        parts = []
        while self.under_way and self.under_way[0][0] <= time + 1e-9:
            parts.append(self.under_way.popleft()[1])
        return b"".join(parts)


class Air:
    """Both directions of one link in simulated time; index 0 is down (robot to host), 1 is up."""

    def __init__(self, radio: Radio, seed: int):
        self.radio = radio
        self.rng = np.random.default_rng([seed, 0x0A17])
        self.directions = (Direction(), Direction())
        self.busy_until = 0.0
        self.last = 0

    def put(self, direction: int, data: bytes) -> None:
        """Hands bytes to the modem on one side; what its buffer does not hold is lost."""
        one = self.directions[direction]
        room = self.radio.max_queue - len(one.waiting)
        one.waiting += data[: max(room, 0)]

    def run(self, start: float, end: float) -> None:
        """Sends what waits between two times, the directions taking turns."""
        self.busy_until = max(self.busy_until, start)
        while self.busy_until < end:
            turn = 1 - self.last if self.directions[1 - self.last].waiting else self.last
            if not self.directions[turn].waiting:
                return
            self.send_chunk(turn)

    def send_chunk(self, direction: int) -> None:
        """One chunk on the air."""
        radio, one = self.radio, self.directions[direction]
        data = bytes(one.waiting[: radio.chunk])
        del one.waiting[: radio.chunk]
        if direction != self.last:
            self.busy_until += radio.turnaround
        self.last = direction
        self.busy_until += len(data) * BITS_PER_BYTE / radio.baud
        one.sent += 1
        if self.rng.random() < radio.chunk_loss:
            one.lost += 1
            return
        one.under_way.append((self.busy_until + radio.latency, self.corrupted(data)))

    def corrupted(self, data: bytes) -> bytes:
        """The bytes with each bit flipped at the radio's rate."""
        if self.radio.bit_error_rate <= 0.0:
            return data
        flips = self.rng.random((len(data), 8)) < self.radio.bit_error_rate
        return (np.frombuffer(data, np.uint8) ^ np.packbits(flips, axis=1)[:, 0]).tobytes()
