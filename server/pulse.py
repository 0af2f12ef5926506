"""How late the event loop is: a beat that should come at its time, and by how much it came later.

Knows no loop: `live` beats it. What stands in its way is seen in the tail, so quantiles of the last seconds are kept.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

BEATS = 1000  # that are kept: 20 s of them


class Lateness(NamedTuple):
    """Quantiles of the last beats' lateness (s); zeros before the first."""

    p50: float
    p99: float
    worst: float


class Pulse:
    """The last beats of a loop."""

    def __init__(self) -> None:
        self.late: deque[float] = deque(maxlen=BEATS)

    def beat(self, seconds: float) -> None:
        """A beat came `seconds` after its time."""
        self.late.append(max(0.0, seconds))

    def lateness(self) -> Lateness:
        """How late the beats came."""
        if not self.late:
            return Lateness(0.0, 0.0, 0.0)
        return Lateness(*(float(value) for value in np.quantile(self.late, [0.5, 0.99, 1.0])))
