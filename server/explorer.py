"""Drives a robot by itself until its map is closed: to the nearest frontier, on to the next, then it stops.

A robot sees most of what is new where it comes to stand, so that a frontier is given up for the next as soon as it is
seen. Or it follows a wall until it has come around to where it began. Like the navigator it plans on the best map and
the local map together, in a thread where it is given one, and asks no clock. Uses its sibling `navigator`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from server.messages import Drive, Goal, Message, Snapshot, Stop
from server.navigator import NavigatorParams, floor_of
from server.robots.pilot import SIGHT
from slam.cost_grid import CostGrid, cost_grid
from slam.frontiers import Frontier, FrontierParams, frontiers
from slam.params import Params
from slam.planning import NoWay, let_out, plan, way_cost
from slam.pose import wrap
from slam.wall_following import Lap, WallFollowingParams, follow
from slam.walls import Walls

REPEAT = 0.1  # s between two words to a robot that turns or follows a wall
LONGER = 4.0  # s for each rad of a look around, at the most

State = Literal["off", "looking", "driving", "following", "done"]
Look = Callable[[], Snapshot]


class ExplorerParams(Params):
    """By which rule it explores, when it looks anew, how it drives, and when it gives up."""

    rule: Literal["frontiers", "wall"] = "frontiers"  # to where the map ends, or along a wall
    period: float = Field(default=1.0, gt=0.0)  # s between two looks at the map
    speed: float = Field(default=0.2, gt=0.0)  # m/s
    turn: float = Field(default=0.6, gt=0.0)  # rad/s of a look around
    around: float = Field(default=6.3, ge=0.0)  # rad that it looks around at the start, and before it is done
    patience: float = Field(default=12.0, gt=0.0)  # s without way made after which a frontier is left alone
    same: float = Field(default=0.3, gt=0.0)  # m within which two frontiers are one
    frontier: FrontierParams = FrontierParams()
    wall: WallFollowingParams = WallFollowingParams()


class Progress(NamedTuple):
    """What it does now, and how many frontiers it left alone."""

    state: State
    abandoned: int


class Choice(NamedTuple):
    """A frontier, and the places (n, 2) to pass on the way to it, which are none where there is no way.

    None where the way that the robot drives already is about as good.
    """

    frontier: Frontier
    places: np.ndarray | None


class Explorer:
    """Switched by `autopilot`; `tick` answers with the messages that the robot is to get."""

    def __init__(self, params: ExplorerParams, navigation: NavigatorParams, executor: Executor | None = None):
        self.params = params
        self.navigation = navigation
        self.executor = executor
        self.begin()

    def begin(self) -> None:
        """Nothing of what was holds any more: another session, or somebody switches it on again."""
        self.state: State = "off"
        self.told = self.checked = -math.inf  # when it spoke last, and looked at the map last
        self.looked_until = -math.inf  # of the look around, at the latest,
        self.turned, self.heading = 0.0, 0.0  # rad, so far; and where it looked last
        self.has_looked = False  # since it last drove
        self.is_waiting = False  # until it sees something
        self.target: np.ndarray | None = None
        self.nearest, self.gained = math.inf, 0.0  # m to the target at the best, and when
        self.left_alone: list[np.ndarray] = []
        self.work: tuple[Future[Choice | None], Snapshot] | None = None  # under way, and what it looks at
        self.lap = Lap(self.params.wall)

    @property
    def progress(self) -> Progress:
        """How it gets on."""
        return Progress(self.state, len(self.left_alone))

    @property
    def autopilot(self) -> bool:
        """Whether it drives."""
        return self.state not in ("off", "done")

    @autopilot.setter
    def autopilot(self, is_on: bool) -> None:
        if is_on and not self.autopilot:
            self.begin()
            self.state = "following" if self.params.rule == "wall" else "looking"
        elif not is_on and self.autopilot:
            self.state, self.work = "off", None

    @property
    def finished(self) -> bool:
        """Whether the map is closed, as far as can be."""
        return self.state == "done"

    def tick(self, t: float, look: Look) -> list[Message]:
        """To be called often, with a way to look at the robot if need be."""
        if not self.autopilot:
            return []
        if self.state == "following":
            return self.follow(t, look) if t - self.told >= REPEAT else []
        if self.looked_until == -math.inf:
            self.look_around(t, look())
        if t < self.looked_until and self.turned < self.params.around:
            return self.turn_on(t, look) if t - self.told >= REPEAT else []
        if self.work is not None:
            return self.take(*self.work, t) if self.work[0].done() else []
        if t - self.checked < self.params.period:
            return []
        self.checked = t
        return self.watch(t, look())

    def look_around(self, t: float, snapshot: Snapshot) -> None:
        """Turn once about, for the laser does not see what is behind."""
        self.state, self.target, self.has_looked = "looking", None, True
        self.looked_until = t + LONGER * self.params.around
        self.turned, self.heading = 0.0, float(snapshot.pose[2])

    def turn_on(self, t: float, look: Look) -> list[Message]:
        """Another word of the look around; who sees nothing waits."""
        self.told, snapshot = t, look()
        if is_blind(snapshot):
            self.looked_until = math.inf
            return self.wait(t)
        if self.looked_until == math.inf:
            self.look_around(t, snapshot)
        self.is_waiting, heading = False, float(snapshot.pose[2])
        self.turned += float(wrap(heading - self.heading))
        self.heading = heading
        return [Drive(t, 0.0, self.params.turn)]

    def wait(self, t: float) -> list[Message]:
        """Stand still, which is said once."""
        was_waiting, self.is_waiting = self.is_waiting, True
        return [] if was_waiting else [Stop(t)]

    def follow(self, t: float, look: Look) -> list[Message]:
        """Another word of the way along a wall; who sees nothing waits."""
        self.told = t
        snapshot = look()
        if is_blind(snapshot):
            return self.wait(t)
        self.is_waiting = False
        if self.lap.step(snapshot.pose):
            self.state = "done"
            return [Stop(t)]
        ends = [ends_of(beam) for beam in snapshot.beams.values()]
        speed, turn = follow(np.concatenate([np.empty((0, 2)), *ends]), self.params.wall)
        return [Drive(t, speed, turn)]

    def watch(self, t: float, snapshot: Snapshot) -> list[Message]:
        """Choose the next frontier, here or in the thread."""
        if is_blind(snapshot):
            return self.wait(t)
        self.is_waiting = False
        arguments = snapshot, tuple(self.left_alone), self.target, self.params, self.navigation
        if self.executor is None:
            return self.drive_to(choose(*arguments), t, snapshot)
        self.work = self.executor.submit(choose, *arguments), snapshot
        return []

    def take(self, work: Future[Choice | None], snapshot: Snapshot, t: float) -> list[Message]:
        """The choice is there."""
        self.work = None
        return self.drive_to(work.result(), t, snapshot)

    def drive_to(self, choice: Choice | None, t: float, snapshot: Snapshot) -> list[Message]:
        """The next goal; none is left where all is known that can be reached."""
        if choice is None:
            if not self.has_looked:
                self.look_around(t, snapshot)
                return []
            self.state = "done"
            return [Stop(t)]
        frontier, places = choice
        if self.target is None or math.dist(self.target, frontier.place) > self.params.same:
            self.nearest, self.gained = math.inf, t
        self.target = frontier.place
        if frontier.way < self.nearest - 0.1:
            self.nearest, self.gained = frontier.way, t
        if t - self.gained > self.params.patience or (places is not None and not len(places)):
            self.left_alone.append(frontier.place)
            return []
        self.state, self.has_looked = "driving", False
        if places is None:
            return []
        way = [(float(x), float(y)) for x, y in places]
        return [Goal(t, way[-1], self.params.speed, tuple(way[:-1]))]


def is_blind(snapshot: Snapshot) -> bool:
    """Whether the robot has seen nothing for too long to drive by it."""
    return snapshot.t - snapshot.looked > SIGHT


def choose(
    snapshot: Snapshot, left_alone: tuple[np.ndarray, ...], target: np.ndarray | None, params: ExplorerParams,
    navigation: NavigatorParams,
) -> Choice | None:  # fmt: skip
    """The frontier to drive to, and the way; None where none is left but those `left_alone`."""
    start = snapshot.pose[:2]
    for cost in (navigation.cost, navigation.tight_cost()):  # the map is never exact, and may close doors
        floor = floor_of(snapshot, start, cost)
        try:
            found = frontiers(floor, start, params.frontier)
        except NoWay:  # walls all around: what stands so near may be gone after another look
            continue
        known = [each for each in found if all(math.dist(each.place, place) > params.same for place in left_alone)]
        if known:
            chosen = kept(known, target, params) or known[0]
            return Choice(chosen, way_to(chosen.place, floor, snapshot, params.same, navigation.better))
    return None


def way_to(place: np.ndarray, floor: CostGrid, snapshot: Snapshot, same: float, better: float) -> np.ndarray | None:
    """Places (n, 2) to pass; none where there is no way, None where the old one costs little more.

    A robot between two ways of about the same length would else turn to the one and the other for ever.
    """
    start = snapshot.pose[:2]
    floor = let_out(floor, start)
    try:
        places = plan(floor, start, place).places
    except NoWay:
        return np.empty((0, 2))
    if snapshot.goal is not None and math.dist(snapshot.goal, place) < same:
        driven = way_cost(floor, start, np.vstack([snapshot.route, snapshot.goal]))
        if better * driven <= way_cost(floor, start, places):
            return None
    return places


def kept(known: list[Frontier], target: np.ndarray | None, params: ExplorerParams) -> Frontier | None:
    """The frontier that it goes to already, unless another is much better."""
    if target is None:
        return None
    near = [each for each in known if math.dist(each.place, target) < params.same]
    gain = params.frontier.gain
    if near and near[0].way - gain * near[0].length < known[0].way - gain * known[0].length + 1.0:
        return near[0]
    return None


def ends_of(beam: dict) -> np.ndarray:
    """Where the beams (n,) of a rangefinder that met something ended (k, 2), in the robot's frame."""
    ranges = np.asarray(beam["ranges"], float)
    far = (np.asarray(beam["offsets"], float) + ranges)[:, None]
    bearings = np.asarray(beam["bearings"], float)
    ends = far * np.column_stack([np.cos(bearings), np.sin(bearings)])
    return ends[np.isfinite(ranges)]


def warm_up(params: ExplorerParams, navigation: NavigatorParams) -> None:
    """Compile or load the kernels, so that nobody waits for the first frontier."""
    seen = Walls(np.full(64, np.inf), np.full(64, 1.0))
    grid = cost_grid(np.zeros((1, 3)), [seen], np.zeros((1, 2)), None, navigation.cost)
    nearest = frontiers(grid, np.zeros(2), params.frontier)[0]
    plan(grid, np.zeros(2), nearest.place)
