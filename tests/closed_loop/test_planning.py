"""A goal is reached by the planner where steering by sight fails, and suggestions keep what they promise."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from firmware.virtual import VirtualCrunch, World, load_world
from server.estimator import InlineEstimator
from server.words import DriveWord, GoalWord, HoldWord
from slam.path_filter import PathFilter
from tests.naive.walls import rectangle
from tests.server.executors import AtOnce
from tests.server.live_session import PARAMS, HandSession

BODY = 0.076  # m, the robot's radius
HALL = rectangle(0.0, 0.0, 7.0, 5.4)
POCKET = np.array([[-1.0, -1.5, 1.5, -1.5], [1.5, -1.5, 1.5, 1.5], [1.5, 1.5, -1.0, 1.5]])  # open where it came from
RING = np.vstack([rectangle(0.0, 0.0, 8.0, 6.0), rectangle(0.0, 0.0, 5.2, 3.2)])  # a corridor 1.4 m wide


class Loop(HandSession):
    """A robot in a world of its own, whose plans are made at once."""

    def __init__(
        self,
        world: World,
        drift: Literal["low", "medium", "high"] = "low",
        particles: int = 200,
        directions: float = 1.0,
    ):
        super().__init__()
        self.virtual = self.link.robot = VirtualCrunch(world, seed=1, drift=drift)
        chosen = PARAMS.filter_params()
        direction = chosen.direction.model_copy(update={"gain": directions * chosen.direction.gain})
        chosen = chosen.model_copy(update={"particles": particles, "direction": direction})
        self.bridge.estimator = InlineEstimator(lambda: PathFilter(chosen, 0, 1), self.bridge.believe)
        self.bridge.navigator.executor = self.bridge.adviser.executor = AtOnce()
        self.start = world.start[:2]
        self.nearest_wall = math.inf
        self.advance(1.0)

    def go(self, place: tuple[float, float], seconds: float, plan: bool = True) -> bool:
        """Send it to a place of the world and hold the lease; whether it got there, as far as it knows."""
        bridge = self.bridge
        x, y = np.subtract(place, self.start)
        bridge.hear("someone", GoalWord(type="goal", x=float(x), y=float(y), speed=0.3, seen=bridge.t, plan=plan))
        for _ in range(round(seconds / 0.1)):
            bridge.hear("someone", HoldWord(type="hold", seen=bridge.t))
            self.advance(0.1)
            room = self.virtual.world.clearances(self.virtual.pose[None, :2], 1.0)
            self.nearest_wall = min(self.nearest_wall, float(room[0]))
            if bridge.look().goal is None:
                return bridge.navigator.standing.state != "blocked"
        return False

    def away(self, place: tuple[float, float]) -> float:
        """Metres from a place of the world to where the robot truly is."""
        return math.dist(self.virtual.pose[:2], place)


def test_the_planner_leaves_a_pocket_in_which_sight_is_caught():
    place = World(np.vstack([HALL, POCKET]), np.zeros(3))
    behind = (2.3, 0.0)
    caught = Loop(place)
    assert not caught.go(behind, 60.0, plan=False)
    assert caught.away(behind) > 0.75
    planned = Loop(place, particles=500)  # 200 lose half a metre on the way around
    assert planned.go(behind, 120.0), planned.bridge.navigator.standing
    assert planned.away(behind) < 0.7, "its radius, and 5% of the way"
    assert planned.nearest_wall > BODY
    assert planned.virtual.state == "armed"


def test_rooms_of_an_office_are_reached_one_after_the_other():
    loop = Loop(load_world("demo"), "low", 300)
    for place, (left, right) in (((2.2, 2.0), (0.0, 4.4)), ((8.0, 2.5), (4.52, 9.4))):
        assert loop.go(place, 180.0), f"{place}: {loop.bridge.navigator.standing}, stands at {loop.virtual.pose}"
        x, y, _ = loop.virtual.pose
        assert left < x < right, "the room; how near to the place is the map's affair"
        assert 0.0 < y < 3.88
    assert loop.nearest_wall > BODY


def test_a_place_without_a_way_is_given_up_and_the_robot_stands():
    closed = rectangle(1.6, 0.0, 1.4, 1.4)
    loop = Loop(World(np.vstack([HALL, closed]), np.zeros(3)))
    assert not loop.go((1.6, 0.0), 240.0)
    assert loop.bridge.navigator.standing.state == "blocked"
    assert loop.bridge.navigator.standing.reason == "walls close every way there", "after a walk around them"
    assert loop.bridge.control.goal is None
    assert loop.bridge.control.stops.newest()[0].by == "planner"
    loop.advance(4.0)  # it brakes, and finds its balance
    stood = loop.virtual.pose[:2].copy()
    loop.advance(1.0)
    assert math.dist(stood, loop.virtual.pose[:2]) < 0.02
    assert loop.nearest_wall > BODY


def test_driving_by_hand_ends_a_planned_way():
    loop = Loop(World(HALL, np.zeros(3)))
    loop.go((2.0, 1.0), 1.0)
    assert loop.bridge.navigator.standing.state == "driving"
    loop.bridge.hear("someone", DriveWord(type="drive", speed=0.1, turn=0.0, seen=loop.bridge.t))
    loop.advance(0.1)
    assert loop.bridge.navigator.standing.state == "none"
    assert loop.bridge.look().goal is None


def test_driving_where_it_suggests_makes_the_uncertain_stretch_surer():
    loop = Loop(World(RING, np.array([-3.3, -2.3, 0.0])), "high", 400, directions=0.0)  # with them it is sure enough
    for place in ((3.3, -2.3), (3.3, 2.3), (-2.2, 2.3)):
        assert loop.go(place, 120.0), f"{place}: {loop.bridge.navigator.standing}, stands at {loop.virtual.pose}"
    before = loop.bridge.look()
    for _ in range(3):  # asked, thought over, taken
        loop.bridge.adviser.tick(loop.bridge.t, loop.bridge.look)
        loop.advance(3.5)
    first = loop.bridge.adviser.suggestions[0]
    assert math.dist(first.place, before.path[0, :2]) < 3.0, "back to where it began"
    uncertain = np.flatnonzero(before.spread >= 0.5 * before.spread.max())
    for place in (tuple(first.place + loop.start), (-1.3, -2.3)):  # there, and on along the old path
        assert loop.go(place, 120.0), loop.bridge.navigator.standing
    gained = np.mean(before.spread[uncertain] - loop.bridge.look().spread[uncertain])
    assert gained > 0.8 * first.gain
