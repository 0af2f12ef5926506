"""Near obstacles: a GP2D12 sees one before its nose as if it stood farther away, and the sonar beside it knows better.

Below 8 cm the infra-red's curve folds back, so that 3 cm read like 20. The sonar measures down to 3 cm and breaks
the tie.
"""

from __future__ import annotations

import numpy as np

from slam.rangefinder import RingParams

FOLD = 0.08  # m from the infra-red's face, below which its curve falls again (datasheet)
MARGIN = 0.07  # m that a sonar's noise, a lean and the way between two pings may hide
ROUNDING = 0.001  # m by which an echo counted in whole microseconds may fall short of the sonar's nearest range


class TieBreaker:
    """Follows the sonar, two pings deep since one in fifty is lost, and corrects what is fused.

    Does nothing for sensors whose infra-red does not fold: beams of a laser that stand in for it are trusted nearer.
    """

    def __init__(self, sensors: dict[str, RingParams]):
        self.sensors = sensors
        infrared, sonar = sensors.get("infrared"), sensors.get("sonar")
        self.nearest: float | None = None  # m from the sonar's face; nearer echoes cast doubt on the infra-red
        if infrared and sonar and may_fold(infrared, sonar):
            self.nearest = FOLD + MARGIN + infrared.offset - sonar.offset
            self.newest = np.full(len(sonar.bearings_deg), np.nan)
            self.before = self.newest.copy()

    def believed(self, sensor: str, ranges: np.ndarray) -> np.ndarray:
        """A sweep (n,) as it may be fused; nan where an infra-red reading may be folded."""
        if self.nearest is None or sensor not in ("infrared", "sonar") or len(ranges) != len(self.newest):
            return ranges
        if sensor == "infrared":
            return np.where(np.fmin(self.newest, self.before) < self.nearest, np.nan, ranges)
        is_measured = ~np.isnan(ranges)
        self.before = np.where(is_measured, self.newest, self.before)
        self.newest = np.where(is_measured, ranges, self.newest)
        shortest = self.sensors["sonar"].min_range
        return np.where(np.abs(ranges - shortest) < ROUNDING, np.maximum(ranges, shortest), ranges)


def may_fold(infrared: RingParams, sonar: RingParams) -> bool:
    """Whether the infra-red folds back, and the sonar looks the same ways."""
    if (infrared.model, sonar.model) != ("infrared", "sonar"):
        return False
    return infrared.min_range >= FOLD and infrared.bearings_deg == sonar.bearings_deg
