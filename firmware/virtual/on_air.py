"""The two ends of a robot's link in simulated time: what every virtual robot does between its boards and the host."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from firmware.virtual.radio import Air, Radio

STEP_MS = 20  # the driver's and the radio's beat
TRUTH_MS = 20  # between two rows of the truth
DOWN, UP = 0, 1


class OnAir(ABC):
    """A robot that is advanced in steps and speaks over a radio, if there is one.

    Whoever is one gives `time`, and `run` and `receive`, the boards' own ends of the line.
    """

    def __init__(self, radio: Radio | None, seed: int):
        self.air = Air(radio, seed) if radio is not None else None
        self.remainder_ms = 0.0

    @property
    @abstractmethod
    def time(self) -> float:
        """Simulated seconds since the start."""

    @abstractmethod
    def run(self, ms: int) -> bytes:
        """Lets boards and body live for at most STEP_MS; returns the bytes that the boards sent."""

    @abstractmethod
    def receive(self, data: bytes) -> None:
        """Bytes that reached the boards."""

    def write(self, data: bytes) -> None:
        """Bytes from the host; the radio, if there is one, delays them."""
        if self.air is not None:
            self.air.put(UP, data)
        elif data:
            self.receive(data)

    def advance(self, seconds: float) -> bytes:
        """Lets simulated time pass; returns the bytes that reached the host meanwhile."""
        if not seconds >= 0.0:
            raise ValueError(f"cannot advance by {seconds} s: time does not run backwards")
        self.remainder_ms += seconds * 1000.0
        parts = []
        while (ms := min(STEP_MS, int(self.remainder_ms + 1e-6))) > 0:
            self.remainder_ms -= ms
            parts.append(self.step(ms))
        return b"".join(parts)

    def step(self, ms: int) -> bytes:
        """At most STEP_MS: the boards and the body, then the radio."""
        sent = self.run(ms)
        if self.air is None:
            return sent
        now = self.time
        self.air.put(DOWN, sent)
        self.air.run(now - ms * 1e-3, now)
        commands = self.air.directions[UP].arrived(now)
        if commands:
            self.receive(commands)
        return self.air.directions[DOWN].arrived(now)


class OneBoard(OnAir):
    """A robot of one board, `board`, that is stepped ms by ms, and of which the truth is kept.

    Whoever is one gives `pose`, and in `live` what a ms does to all but the board.
    """

    board: Any

    def __init__(self, radio: Radio | None, seed: int):
        super().__init__(radio, seed)
        self.now_ms = 0
        self.rows: list[np.ndarray] = []

    @property
    def time(self) -> float:
        """Simulated seconds since the start."""
        return self.now_ms * 1e-3

    @property
    @abstractmethod
    def pose(self) -> np.ndarray:
        """True pose (3,) of the middle of its axle."""

    def truth(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) and true poses (n, 3), fifty a second, while it was advanced."""
        rows = np.array(self.rows).reshape(-1, 4)
        return rows[:, 0].copy(), rows[:, 1:].copy()

    def receive(self, data: bytes) -> None:
        """Bytes that reached the board."""
        self.board.receive(data)

    def run(self, ms: int) -> bytes:
        """Lets board and body live; returns what the board sent."""
        sent = []
        for _ in range(ms):
            self.now_ms += 1
            sent.append(self.board.run(1))
            self.live()
            if self.now_ms % TRUTH_MS == 0:
                self.rows.append(np.array([self.time, *self.pose]))
        return b"".join(sent)

    def live(self) -> None:
        """A ms has passed for the board."""
