"""Drives a robot by itself until its map is closed: to the nearest frontier, on to the next, then it stops.

A robot sees most of what is new where it comes to stand, so that a frontier is given up for the next as soon as it is
seen. Like the navigator it plans on the best map and the local map together, and asks no clock. Uses its sibling
`navigator`.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from server.messages import Drive, Goal, Message, Snapshot, Stop
from server.navigator import NavigatorParams, floor_of
from slam.frontiers import Frontier, FrontierParams, frontiers
from slam.params import Params
from slam.planning import NoWay, let_out, plan


class ExplorerParams(Params):
    """When it looks anew, how it drives, and when it gives up."""

    period: float = Field(default=1.0, gt=0.0)  # s between two looks at the map
    speed: float = Field(default=0.2, gt=0.0)  # m/s
    turn: float = Field(default=0.6, gt=0.0)  # rad/s of a look around
    around: float = Field(default=6.3, ge=0.0)  # rad that it looks around at the start, and before it is done
    patience: float = Field(default=12.0, gt=0.0)  # s without way made after which a frontier is left alone
    same: float = Field(default=0.3, gt=0.0)  # m within which two frontiers are one
    frontier: FrontierParams = FrontierParams()


class Progress(NamedTuple):
    """What it does now, and how many frontiers it left alone."""

    state: Literal["looking", "driving", "done"]
    abandoned: int


class Explorer:
    """`tick` answers with the messages that the robot is to get."""

    def __init__(self, params: ExplorerParams, navigation: NavigatorParams):
        self.params = params
        self.navigation = navigation
        self.state: Literal["looking", "driving", "done"] = "looking"
        self.looked_until = -math.inf  # of the look around
        self.has_looked = False  # since it last drove
        self.checked = -math.inf
        self.target: np.ndarray | None = None
        self.nearest, self.gained = math.inf, 0.0  # m to the target at the best, and when
        self.left_alone: list[np.ndarray] = []

    @property
    def progress(self) -> Progress:
        """How it gets on."""
        return Progress(self.state, len(self.left_alone))

    def tick(self, t: float, snapshot: Snapshot) -> list[Message]:
        """To be called often; a snapshot need not be newer than a moment."""
        if self.state == "done":
            return []
        if self.looked_until == -math.inf:
            self.look_around(t)
        if t < self.looked_until:
            return [Drive(t, 0.0, self.params.turn)]
        if t - self.checked < self.params.period:
            return []
        self.checked = t
        return self.choose(t, snapshot)

    def look_around(self, t: float) -> None:
        """Turn once about, for the laser does not see what is behind."""
        self.state, self.target = "looking", None
        self.looked_until, self.has_looked = t + self.params.around / self.params.turn, True

    def choose(self, t: float, snapshot: Snapshot) -> list[Message]:
        """The next goal; none is left where all is known that can be reached."""
        params = self.params
        floor = floor_of(snapshot, snapshot.pose[:2], self.navigation.cost)
        start = snapshot.pose[:2]
        known = [
            frontier
            for frontier in frontiers(floor, start, params.frontier)
            if all(math.dist(frontier.place, place) > params.same for place in self.left_alone)
        ]
        if not known:
            if not self.has_looked:
                self.look_around(t)
                return [Drive(t, 0.0, params.turn)]
            self.state = "done"
            return [Stop(t)]
        chosen = self.kept(known) or known[0]
        if self.target is None or math.dist(self.target, chosen.place) > params.same:
            self.nearest, self.gained = math.inf, t
        self.target = chosen.place
        if chosen.way < self.nearest - 0.1:
            self.nearest, self.gained = chosen.way, t
        if t - self.gained > params.patience:
            self.left_alone.append(chosen.place)
            return []
        try:
            route = plan(let_out(floor, start), start, chosen.place)
        except NoWay:
            self.left_alone.append(chosen.place)
            return []
        self.state, self.has_looked = "driving", False
        places = [(float(x), float(y)) for x, y in route.places]
        return [Goal(t, places[-1], params.speed, tuple(places[:-1]))]

    def kept(self, known: list[Frontier]) -> Frontier | None:
        """The frontier that it goes to already, unless another is much better."""
        if self.target is None:
            return None
        near = [each for each in known if math.dist(each.place, self.target) < self.params.same]
        gain = self.params.frontier.gain
        if near and near[0].way - gain * near[0].length < known[0].way - gain * known[0].length + 1.0:
            return near[0]
        return None
