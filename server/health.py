"""How well one board is heard: frames that came, frames that the sequence numbers miss, and the age of the last."""

from __future__ import annotations

import math
from collections import deque

WINDOW = 5  # s over which the loss is told
SEQUENCES = 256


class SourceHealth:
    """Counts of one source's frames, in all and over the last seconds."""

    def __init__(self) -> None:
        self.received = 0
        self.lost = 0
        self.sequence: int | None = None
        self.first = math.inf  # s, when the first and the newest frame were sampled
        self.newest = -math.inf
        self.last = -math.inf  # s, when the last one came
        self.seconds: deque[list[int]] = deque(maxlen=WINDOW)  # (second, received, lost)

    def restart(self) -> None:
        """The board has booted: its numbers begin anew."""
        self.sequence = None

    def count(self, sequence: int, t: float, sampled: float) -> int:
        """Counts a good frame that came at time t and was sampled at `sampled`; returns how many miss before it."""
        missing = self._missing(sequence, sampled)
        self.sequence = sequence
        self.received += 1
        self.lost += missing
        self.first = min(self.first, sampled)
        self.newest = max(self.newest, sampled)
        self.last = t
        if not self.seconds or self.seconds[-1][0] != int(t):
            self.seconds.append([int(t), 0, 0])
        self.seconds[-1][1] += 1
        self.seconds[-1][2] += missing
        return missing

    def _missing(self, sequence: int, sampled: float) -> int:
        """The gap in the numbers, with as many whole wraps as the board's usual rate makes likely.

        The board's own time tells it: frames that stood in a queue come late, but none of them is missing.
        """
        if self.sequence is None:
            return 0
        gap = (sequence - self.sequence - 1) % SEQUENCES
        age = self.newest - self.first
        usual = (self.received + self.lost) / age * (sampled - self.newest) if age > 1.0 else 0.0
        wraps = round((usual - 1.0 - gap) / SEQUENCES)
        return max(gap + wraps * SEQUENCES, 0)  # a frame heard twice looks like the longest gap, and is none

    def summary(self, t: float) -> dict:
        """Age of the newest frame (s) and loss of the last seconds (share), None before the first; and all counts."""
        recent = [second for second in self.seconds if second[0] > t - WINDOW]
        received, lost = sum(second[1] for second in recent), sum(second[2] for second in recent)
        if self.received == 0:
            return {"age": None, "loss": None, "received": 0, "lost": 0}
        loss = lost / (received + lost) if received else 1.0
        return {"age": t - self.last, "loss": loss, "received": self.received, "lost": self.lost}
