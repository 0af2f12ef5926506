"""Whether a robot that lives by the clock keeps up with it. Both who serve one on a line and who have one in their own
process must leave time out when the machine is too slow, and say so."""

from __future__ import annotations

WINDOW = 5.0  # s over which the share is taken
LEAST_SHARE = 0.95  # of the clock's time that the robot should live
NAP = 2.0  # s at once: the machine slept, and is not slow


class Pace:
    """Adds up the time that passed and the time that was left out; `complaint` is empty while all is well."""

    def __init__(self) -> None:
        self.passed = self.lost = 0.0
        self.complaint = ""

    def note(self, passed: float, lost: float) -> bool:
        """Some of the `passed` seconds were `lost`; whether there is a new complaint."""
        if passed > NAP:
            return False
        self.passed += passed
        self.lost += lost
        if self.passed < WINDOW:
            return False
        was_well = not self.complaint
        share = 1.0 - self.lost / self.passed
        self.complaint = (
            f"this machine is too slow for this robot: of each second it lives {share:.2f} s"
            if share < LEAST_SHARE
            else ""
        )
        self.passed = self.lost = 0.0
        return was_well and bool(self.complaint)
