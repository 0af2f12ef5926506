"""A goal in another room is reached by the planner where steering by sight fails; what is in the way is found out."""

from __future__ import annotations

import math
from concurrent.futures import Executor, Future

import numpy as np
import pytest

from server.messages import Snapshot
from server.words import DriveWord, GoalWord, HoldWord
from tests.server.live_session import STEP, HandSession

BODY = 0.076  # m, the robot's radius
POCKET = np.array(  # a room within a room, open at the far end: by sight every way leads into its pocket
    [[-1.0, -1.5, 1.5, -1.5], [1.5, -1.5, 1.5, 1.5], [1.5, 1.5, -1.0, 1.5]], float
)


class Inline(Executor):
    """Works at once, so that a test does not depend on how fast a thread is."""

    def submit(self, fn, /, *args, **kwargs):  # type: ignore[override]
        """The finished future."""
        done = Future()
        done.set_result(fn(*args, **kwargs))
        return done


def session_in(walls: np.ndarray, **size: float) -> HandSession:
    """A robot at the origin of a hall with further walls; it has looked around."""
    session = HandSession(walls=walls, **size)
    session.bridge.navigator.executor = session.bridge.adviser.executor = Inline()
    session.advance(1.0)
    return session


def go(session: HandSession, place: tuple[float, float], seconds: float, plan: bool = True) -> bool:
    """Send the robot to a place and hold the lease; whether it says that it has arrived."""
    bridge = session.bridge
    bridge.hear("someone", GoalWord(type="goal", x=place[0], y=place[1], speed=0.3, seen=bridge.t, plan=plan))
    for _ in range(round(seconds / 0.1)):
        bridge.hear("someone", HoldWord(type="hold", seen=bridge.t))
        session.advance(0.1)
        if bridge.snapshot().goal is None:
            session.advance(0.2)
            return bridge.navigator.standing.state != "blocked"
    return False


def away(session: HandSession, place: tuple[float, float]) -> float:
    """Metres from a place to where the robot truly is."""
    return math.dist(session.virtual.pose[:2], place)


def test_the_planner_leaves_a_pocket_in_which_sight_is_caught():
    goal = (2.3, 0.0)
    caught = session_in(POCKET)
    assert not go(caught, goal, 60.0, plan=False)
    assert away(caught, goal) > 0.7
    planned = session_in(POCKET)
    nearest = NearestWall(planned)
    assert go(planned, goal, 120.0), planned.bridge.navigator.standing
    assert away(planned, goal) < 0.45
    assert nearest.metres > BODY
    assert planned.virtual.state == "armed"


class NearestWall:
    """Looks at every step how near the robot is to a wall."""

    def __init__(self, session: HandSession):
        self.metres = math.inf
        advance = session.virtual.advance

        def watched(seconds: float) -> bytes:
            data = advance(seconds)
            room = session.virtual.world.clearances(session.virtual.pose[None, :2], 1.0)
            self.metres = min(self.metres, float(room[0]))
            return data

        session.virtual.advance = watched  # type: ignore[method-assign]
