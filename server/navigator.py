"""The way to the driver's goal: planned on the best map, handed to the robot, and planned anew when that is called for.

It is called for when the map has grown or moved, and when the robot makes no way. Plans are made in a thread, since
they take longer than the event loop has, and one at a time; the robot goes on meanwhile. Asks no clock. Uses its
sibling `control`.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from server.control import Control
from server.messages import Goal, Message, Snapshot, Stop
from slam.cost_grid import CostGrid, CostParams, Surroundings, cost_grid
from slam.grid import Grid
from slam.params import Params
from slam.planning import NoWay, Route, let_out, plan, way_cost
from slam.suggestions import SuggestionParams
from slam.walls import Walls

log = logging.getLogger(__name__)

CHECK_PERIOD = 0.2  # s between two looks at how the robot gets on
REMEMBERED = 30.0  # s that viewers are told why a goal was given up


class NavigatorParams(Params):
    """How ways to a clicked place are planned, when they are planned anew, and which places are suggested."""

    farthest: float = Field(default=200.0, gt=0.0)  # m to a goal
    patience: float = Field(default=5.0, gt=0.0)  # s without way made after which the way is planned anew
    progress: float = Field(default=0.15, gt=0.0)  # m that count as way made
    tries: int = Field(default=3, ge=1)  # plans without way made after which the goal is given up
    better: float = Field(
        default=0.85, gt=0.0, le=1.0
    )  # cost of a new way, as share of the old one's, that is worth it
    moved: float = Field(default=0.1, gt=0.0)  # m by which the map may move under a way
    tight_clearance: float = Field(default=0.09, gt=0.0)  # m from a wall that must do where there is no way otherwise
    tight_occupied: float = Field(default=1.5, gt=0.0)  # log odds of a wall in the local map then: echoes blur doors
    tight_trail: float = Field(default=0.15, ge=0.0)  # m beside the path driven where no wall is believed then
    cost: CostParams = CostParams()
    suggestions: SuggestionParams = SuggestionParams()

    def tight_cost(self) -> CostParams:
        """What the floor costs where there is no way otherwise."""
        tight = {"clearance": self.tight_clearance, "occupied": self.tight_occupied, "trail": self.tight_trail}
        return self.cost.model_copy(update=tight)


class Standing(NamedTuple):
    """How it stands with the way, and why no further."""

    state: Literal["none", "planning", "driving", "blocked"] = "none"
    reason: str = ""


class Way(NamedTuple):
    """What a plan came to: another route, or none (the old one stays, or `reason` says why there is no way)."""

    route: Route | None
    reason: str = ""


Look = Callable[[], Snapshot]


def floor_of(snapshot: Snapshot, place: np.ndarray, params: CostParams) -> CostGrid:
    """The floor as the best map and the local map know it, wide enough for a place (2,)."""
    around = None
    if snapshot.local_map.size:
        x, y = (float(side) for side in snapshot.local_origin)
        grid = Grid(snapshot.local_map, snapshot.local_resolution, x, y)
        around = Surroundings(grid, snapshot.local_pose, snapshot.pose)
    return cost_grid(snapshot.path, snapshot.observations, np.stack([snapshot.pose[:2], place]), around, params)


def find_way(snapshot: Snapshot, place: tuple[float, float], params: NavigatorParams, may_keep: bool) -> Way:
    """A way from the robot to a place; none if the one that it drives is about as good and may be kept."""
    start, end = snapshot.pose[:2], np.array(place)
    if math.dist(start, end) > params.farthest:
        return Way(None, f"that is more than {params.farthest:.0f} m away")
    try:
        grid, route = way_on(snapshot, end, params.cost)
    except NoWay:  # the map is never exact, and what it gets wrong closes doors that the robot has come through
        try:
            grid, route = way_on(snapshot, end, params.tight_cost())
        except NoWay as error:
            return Way(None, str(error))
    if may_keep and snapshot.goal is not None:
        driven = way_cost(grid, start, np.vstack([snapshot.route, snapshot.goal]))
        if params.better * driven <= way_cost(grid, start, route.places):
            return Way(None)
    return Way(route)


def way_on(snapshot: Snapshot, end: np.ndarray, params: CostParams) -> tuple[CostGrid, Route]:
    """A way from the robot to a place (2,), and the floor that it leads over; NoWay if there is none."""
    start = snapshot.pose[:2]
    grid = let_out(floor_of(snapshot, end, params), start)
    return grid, plan(grid, start, end)


def metres_left(snapshot: Snapshot) -> float:
    """Metres from the robot through what is left of its route to its goal; 0 without one."""
    if snapshot.goal is None:
        return 0.0
    return float(np.hypot(*np.diff(np.vstack([snapshot.pose[:2], snapshot.route, snapshot.goal]), axis=0).T).sum())


class Navigator:
    """Follows the driver's goal. `tick` answers with the messages that the robot is to get."""

    def __init__(self, params: NavigatorParams, executor: Executor | None = None):
        self.params = params
        self.executor = executor or ThreadPoolExecutor(1, "navigator")
        self.work: Future[Way] | None = None
        self.dropped: Future[Way] | None = None  # a plan that nobody wants any more, and that may still be made
        self.begin()

    def begin(self) -> None:
        """Nothing of what was holds any more: another session."""
        self.standing = Standing()
        self.changed = -math.inf  # when the standing did
        self.goal: Goal | None = None  # the driver's
        self.drop()
        self.planned_on = np.zeros((0, 3))  # the best path of the newest plan
        self.checked = -math.inf
        self.shortest = math.inf  # m that were left at the best
        self.gained = 0.0  # when way was made last
        self.failures = 0

    def tick(self, t: float, control: Control, look: Look) -> list[Message]:
        """To be called often, with a way to look at the robot if need be."""
        goal = control.goal if control.is_planned else None
        if goal is not self.goal:
            self.head_for(goal, t)
        if goal is None:
            if self.standing.state == "blocked" and t - self.changed > REMEMBERED:
                self.stand("none", t)
            return []
        if self.work is not None:
            return self.take(self.work, goal, t, control, look) if self.work.done() else []
        is_busy = self.dropped is not None and not self.dropped.done()
        if is_busy or t - self.checked < CHECK_PERIOD:
            return []
        self.checked = t
        return self.watch(goal, t, control, look())

    def head_for(self, goal: Goal | None, t: float) -> None:
        """The driver has another goal, or none any more."""
        self.goal = goal
        self.drop()
        self.planned_on = np.zeros((0, 3))
        self.shortest, self.gained, self.failures = math.inf, t, 0
        self.checked = -math.inf
        self.stand("none" if goal is None else "planning", t)

    def drop(self) -> None:
        """Forget the plan that is being made. What cannot be called off any more is waited for before the next."""
        if self.work is not None and not self.work.cancel():
            self.dropped = self.work
        self.work = None

    def watch(self, goal: Goal, t: float, control: Control, snapshot: Snapshot) -> list[Message]:
        """Plan if there is no way yet, if the map has changed, or if the robot makes no way."""
        if snapshot.goal is None:
            control.arrive()
            return []
        left = metres_left(snapshot)
        if left < self.shortest - self.params.progress:
            self.shortest, self.gained, self.failures = left, t, 0
        if t - self.gained > self.params.patience:
            self.gained = t
            self.failures += 1
            if self.failures >= self.params.tries:
                return self.give_up("the robot makes no way there", t, control)
            self.submit(goal, snapshot, may_keep=False)
        elif len(snapshot.path) != len(self.planned_on):
            self.submit(goal, snapshot, may_keep=self.standing.state == "driving" and not self.has_moved(snapshot.path))
        return []

    def has_moved(self, path: np.ndarray) -> bool:
        """Whether the map lies elsewhere than when the way was planned."""
        common = min(len(path), len(self.planned_on))
        apart = np.hypot(*(path[:common, :2] - self.planned_on[:common, :2]).T)
        return bool(apart.max(initial=0.0) > self.params.moved)

    def submit(self, goal: Goal, snapshot: Snapshot, may_keep: bool) -> None:
        """Have a way planned."""
        assert goal.place is not None
        self.planned_on = snapshot.path
        self.work = self.executor.submit(find_way, snapshot, goal.place, self.params, may_keep)

    def take(self, work: Future[Way], goal: Goal, t: float, control: Control, look: Look) -> list[Message]:
        """A plan is there: the robot gets it, unless it has arrived meanwhile."""
        self.work = None
        try:
            way = work.result()
        except Exception as error:
            log.exception("planning failed")
            return self.give_up(f"planning failed ({error})", t, control)
        if look().goal is None:
            return []
        if way.reason and (self.standing.state != "driving" or self.failures):
            return self.give_up(way.reason, t, control)
        self.stand("driving", t)
        if way.route is None:
            return []  # the way that it drives is good, or if not, `watch` sees that no way is made
        self.shortest = way.route.metres
        places = [(float(x), float(y)) for x, y in way.route.places]
        return [Goal(t, places[-1], goal.speed, tuple(places[:-1]))]

    def give_up(self, reason: str, t: float, control: Control) -> list[Message]:
        """The robot stands still, and people are told why."""
        control.arrive()
        control.stops.note(t, reason, "planner")
        self.goal = self.work = None
        self.stand("blocked", t, reason)
        return [Stop(t)]

    def stand(self, state: Literal["none", "planning", "driving", "blocked"], t: float, reason: str = "") -> None:
        """The standing is another."""
        self.standing, self.changed = Standing(state, reason), t


def warm_up(params: NavigatorParams) -> None:
    """Compile or load the kernels, so that nobody waits for the first way."""
    seen = Walls(np.full(8, 1.0), np.full(8, 0.9))
    grid = cost_grid(np.zeros((1, 3)), [seen], np.zeros((1, 2)), None, params.cost)
    route = plan(grid, np.zeros(2), np.array([0.2, 0.2]))
    way_cost(grid, np.zeros(2), route.places)
