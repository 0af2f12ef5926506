"""The navigator's rules: who has a goal gets a way, what changes is planned anew, and who is stuck is told why."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from server.adviser import Adviser
from server.control import Control, ControlParams
from server.guidance import route_view, suggestions_view
from server.messages import Goal, Message, Snapshot, Stop
from server.navigator import REMEMBERED, Navigator, NavigatorParams, Standing, metres_left
from server.words import GoalWord, PlainWord
from slam.cost_grid import CostParams
from slam.suggestions import SuggestionParams
from slam.uncertainty import Branches
from slam.walls import Walls
from tests.naive.walls import cast, rectangle
from tests.server.executors import AtOnce, Later
from tests.server.live_session import HandSession

PARAMS = NavigatorParams()
ROOMS = np.vstack([rectangle(3.0, 0.0, 8.0, 4.0), [[3.0, -2.0, 3.0, 1.0]]])  # two, open at the top


class Driven:
    """A navigator beside a robot that only says what it would say."""

    def __init__(self, later: bool = False):
        self.executor = Later() if later else AtOnce()
        self.navigator = Navigator(PARAMS, self.executor)
        self.control = Control(ControlParams())
        self.t = 0.0
        path = np.array([[x, 0.0, 0.0] for x in np.arange(0.0, 2.0, 0.5)])
        blank = HandSession().bridge.look()
        self.seen: Snapshot = replace(
            blank, pose=path[-1], path=path, observations=[cast(pose, ROOMS, 72, 2.0) for pose in path],
            local_map=np.zeros((0, 0)),
        )  # fmt: skip
        self.heard: list[Message] = []

    def go(self, x: float, y: float, plan: bool = True) -> None:
        """The driver's click."""
        self.obey(self.control.hear("v", GoalWord(type="goal", x=x, y=y, seen=self.t, plan=plan), self.t))

    def tick(self, seconds: float = 0.0) -> None:
        """Time passes in steps of a tenth."""
        for _ in range(max(1, round(seconds / 0.1))):
            self.t += 0.1
            self.obey(self.navigator.tick(self.t, self.control, lambda: self.seen))

    def obey(self, messages: list[Message]) -> None:
        """What the robot makes of it."""
        self.heard += messages
        for message in messages:
            is_goal = isinstance(message, Goal)
            route = np.array(message.route).reshape(-1, 2) if is_goal else np.zeros((0, 2))
            self.seen = replace(self.seen, goal=message.place if is_goal else None, route=route)

    def move(self, x: float, y: float) -> None:
        """Where it is now."""
        self.seen = replace(self.seen, pose=np.array([x, y, 0.0]))

    @property
    def state(self) -> str:
        return self.navigator.standing.state


def test_a_goal_gets_a_route_around_the_wall():
    driven = Driven()
    driven.go(5.0, 0.0)
    driven.tick(0.3)
    assert driven.state == "driving"
    route = driven.heard[-1]
    assert isinstance(route, Goal)
    assert route.place == (5.0, 0.0)
    assert max(y for _, y in route.route) > 1.0
    assert metres_left(driven.seen) > 4.0


def test_a_goal_by_sight_is_left_alone():
    driven = Driven()
    driven.go(5.0, 0.0, plan=False)
    driven.tick(1.0)
    assert driven.state == "none"
    assert len(driven.heard) == 1


def test_until_the_plan_is_there_it_is_being_planned_and_a_later_goal_wins():
    driven = Driven(later=True)
    driven.go(5.0, 0.0)
    driven.tick(0.3)
    assert driven.state == "planning"
    driven.go(0.5, 0.5)
    driven.tick(0.3)
    assert isinstance(driven.executor, Later)
    driven.executor.finish()
    driven.tick()
    assert driven.state == "driving"
    assert driven.seen.goal == (0.5, 0.5)
    assert sum(isinstance(message, Goal) and message.place == (5.0, 0.0) for message in driven.heard) == 1


def test_many_goals_leave_one_plan_to_be_made():
    driven = Driven(later=True)
    assert isinstance(driven.executor, Later)
    driven.go(5.0, 0.0)
    driven.tick(0.3)
    ((running, _),) = driven.executor.waiting
    running.set_running_or_notify_cancel()
    for step in range(100):
        driven.go(0.5, 0.01 * step)
        driven.tick(0.3)
    assert len(driven.executor.waiting) == 1, "the next waits for the one that is being made"
    driven.executor.finish()
    driven.tick(0.3)
    assert len(driven.executor.waiting) == 1
    assert driven.state == "planning"
    driven.executor.finish()
    driven.tick(0.3)
    assert driven.state == "driving"
    assert driven.seen.goal == (0.5, 0.99)


def test_a_plan_that_has_not_begun_is_called_off_with_its_goal():
    driven = Driven(later=True)
    assert isinstance(driven.executor, Later)
    driven.go(5.0, 0.0)
    driven.tick(0.3)
    ((waiting, _),) = driven.executor.waiting
    driven.navigator.begin()
    assert waiting.cancelled()


def test_a_plan_that_fails_gives_the_goal_up_and_the_next_is_planned():
    driven = Driven(later=True)
    assert isinstance(driven.executor, Later)
    driven.go(5.0, 0.0)
    driven.tick(0.3)
    ((failing, _),) = driven.executor.waiting
    failing.set_exception(ValueError("no such cell"))
    driven.executor.waiting = []
    driven.tick()
    assert driven.navigator.standing == Standing("blocked", "planning failed (no such cell)")
    assert isinstance(driven.heard[-1], Stop)
    assert driven.control.goal is None
    driven.go(5.0, 0.0)
    driven.tick(0.3)
    driven.executor.finish()
    driven.tick(0.1)
    assert driven.state == "driving"


def test_a_goal_taken_back_ends_it():
    driven = Driven(later=True)
    driven.go(5.0, 0.0)
    driven.tick(0.3)
    driven.obey(driven.control.hear("v", PlainWord(type="cancel"), driven.t))
    driven.executor.finish()  # type: ignore[union-attr]
    driven.tick(0.5)
    assert driven.state == "none"
    assert isinstance(driven.heard[-1], Stop)


def test_a_grown_map_keeps_a_good_way_and_a_moved_one_does_not():
    driven = Driven()
    driven.go(5.0, 0.0)
    driven.tick(0.3)
    said = len(driven.heard)
    path, seen = driven.seen.path, driven.seen.observations
    driven.seen = replace(driven.seen, path=np.vstack([path, path[-1]]), observations=[*seen, seen[-1]])
    driven.tick(0.5)
    assert len(driven.heard) == said, "as good as before"
    moved = driven.seen.path + np.array([0.0, 0.2, 0.0])
    driven.seen = replace(driven.seen, path=np.vstack([moved, moved[-1]]), observations=[*seen, seen[-1], seen[-1]])
    driven.tick(0.5)
    assert len(driven.heard) == said + 1


def test_a_robot_that_makes_no_way_is_given_up_after_some_plans():
    driven = Driven()
    driven.go(5.0, 0.0)
    driven.tick(PARAMS.patience * (PARAMS.tries - 0.5))
    assert driven.state == "driving"
    driven.tick(PARAMS.patience)
    assert driven.navigator.standing == Standing("blocked", "the robot makes no way there")
    assert isinstance(driven.heard[-1], Stop)
    assert driven.control.goal is None
    assert driven.control.stops.newest()[0].by == "planner"
    driven.tick(REMEMBERED + 0.2)
    assert driven.state == "none"


def test_one_that_makes_way_slowly_is_not():
    driven = Driven()
    driven.go(1.5, 1.2)
    for _ in range(5):
        x, y, _ = driven.seen.pose
        driven.move(x, y + 1.1 * PARAMS.progress)
        driven.tick(0.9 * PARAMS.patience)
    assert driven.state == "driving"


def test_a_place_too_far_to_plan_is_given_up_with_the_reason():
    driven = Driven()
    driven.go(PARAMS.farthest + 2.0, 0.0)
    driven.tick(0.3)
    assert driven.navigator.standing == Standing("blocked", "that is more than 200 m away")


def test_arriving_ends_the_goal():
    driven = Driven()
    driven.go(0.5, 0.5)
    driven.tick(0.3)
    driven.seen = replace(driven.seen, goal=None)
    driven.tick(0.5)
    assert driven.control.goal is None
    assert driven.state == "none"


def test_viewers_see_what_is_left_of_the_way():
    driven = Driven()
    driven.go(5.0, 0.0)
    driven.tick(0.3)
    view = route_view(driven.seen, driven.navigator.standing)
    np.testing.assert_allclose(view.arrays["route"][-1], [5.0, 0.0])
    assert len(view.arrays["route"]) == len(driven.seen.route) + 1
    assert view.fields["state"] == "driving"
    assert view.fields["remaining_m"] == pytest.approx(metres_left(driven.seen), abs=0.06)
    rest = route_view(replace(driven.seen, goal=None), Standing("blocked", "a reason"))
    assert rest.arrays["route"].shape == (0, 2)
    assert rest.fields["reason"] == "a reason"


def drifted(n_paths: int = 40) -> Snapshot:
    """A robot that has come round to where it began, on paths that turn a little differently."""
    drifts = np.linspace(-0.02, 0.02, n_paths)
    steps = np.arange(21)
    headings = 0.3 * steps + drifts[:, None] * steps
    x, y = np.cumsum(0.5 * np.cos(headings), axis=1), np.cumsum(0.5 * np.sin(headings), axis=1)
    paths = np.stack([x - x[:, :1], y - y[:, :1], headings], axis=2)
    rows = np.arange(n_paths * 20).reshape(n_paths, 20) + 1
    branches = Branches(
        np.vstack([paths[:1, 0], paths[:, 1:].reshape(-1, 3)]),
        np.concatenate([[-1], np.column_stack([np.zeros(n_paths, int), rows[:, :-1]]).ravel()]),
        np.concatenate([[0], np.tile(np.arange(1, 21), n_paths)]),
    )
    path = paths[n_paths // 2]
    spread = np.sqrt(np.sum(np.var(paths[..., :2], axis=0), axis=1))
    walls = Walls(np.full(72, np.inf), np.full(72, 1.0))
    return replace(
        HandSession().bridge.look(), path=path, pose=path[-1], observations=[walls] * 21, branches=branches,
        spread=spread, affinity=1.0,
    )  # fmt: skip


def test_the_adviser_names_the_start_and_how_far_it_is():
    snapshot = drifted()
    adviser = Adviser(SuggestionParams(least_gain=0.03), CostParams(), AtOnce())
    for t in (0.0, 0.1):  # asked, and taken
        adviser.tick(t, lambda: snapshot)
    assert adviser.suggestions
    first = suggestions_view(adviser.suggestions).fields["suggestions"][0]
    assert math.dist((first["x"], first["y"]), (0.0, 0.0)) < 2.0
    assert math.dist((first["x"], first["y"]), snapshot.pose[:2]) <= first["drive_m"] + 0.1
    assert first["text"].startswith("Drive ")


def test_advice_that_fails_ends_nothing():
    snapshot = drifted()
    executor = Later()
    adviser = Adviser(SuggestionParams(), CostParams(), executor)
    adviser.tick(0.0, lambda: snapshot)
    ((failing, _),) = executor.waiting
    failing.set_exception(ValueError("no such cell"))
    executor.waiting = []
    adviser.tick(0.1, lambda: snapshot)
    assert adviser.work is None
    adviser.tick(10.0, lambda: replace(snapshot, affinity=2.0))
    assert adviser.work is not None


def test_the_adviser_is_not_asked_again_before_something_is_new():
    snapshot = drifted()
    executor = Later()
    adviser = Adviser(SuggestionParams(), CostParams(), executor)
    for t in (0.0, 5.0):
        adviser.tick(t, lambda: snapshot)
        executor.finish()
        adviser.tick(t + 0.1, lambda: snapshot)
    assert adviser.work is None
    adviser.tick(10.0, lambda: replace(snapshot, affinity=2.0))
    assert adviser.work is not None
