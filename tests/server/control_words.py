"""What people say to a helm, for tests of it."""

from server.control import Control, ControlParams
from server.words import DriveWord, GoalWord, PlainWord

FORWARD, STILL = (0.3, 0.0), (0.0, 0.0)


def drive(t: float, wish: tuple[float, float] = FORWARD) -> DriveWord:
    """A driver's word in front of a fresh picture."""
    return DriveWord(type="drive", speed=wish[0], turn=wish[1], seen=t)


def goal(t: float) -> GoalWord:
    """Drive to (2, 1)."""
    return GoalWord(type="goal", x=2.0, y=1.0, seen=t)


def plain(name) -> PlainWord:
    return PlainWord(type=name)


def control(**autopilot) -> Control:
    return Control(ControlParams(), **autopilot)
