"""Drive plans: waypoints and speeds from TOML, and the driver that follows them. The driver sees only the true pose.

    speed = 0.3                      # m/s, where a waypoint names none
    laps = 2                         # times through the list
    closed = true                    # laps join: from the last waypoint back to the first
    waypoints = [[1.0, 2.0], [3.0, 2.0], {at = [3.0, 4.0], speed = 0.2, pause = 3.0}]

It keeps clear of walls only as far as the plan does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from firmware.virtual.worlds import numbers, read_toml, resolve

BUILT_IN = Path(__file__).resolve().parent / "plans"
TOML_KEYS = {"name", "title", "world", "speed", "max_turn", "lookahead", "laps", "closed", "waypoints"}
REACHED = 0.06  # m from a stop
SHARP = -0.3  # cosine of a turn that is made on the spot


class PlanError(ValueError):
    """A plan that cannot be driven; the message names file, place and remedy in one line."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Points (n, 2) to pass in order, laps already unrolled; speed (n,) toward each, pause (n,) seconds at each."""

    points: np.ndarray
    speeds: np.ndarray
    pauses: np.ndarray
    name: str = "plan"
    world: str | None = None
    max_turn: float = 1.2  # rad/s
    lookahead: float = 0.30  # m

    @classmethod
    def through(cls, points: np.ndarray, speed: float = 0.3, **options: Any) -> Plan:
        """Plan through points (n, 2) at one speed without pauses."""
        points = np.asarray(points, float)
        return cls(points, np.full(len(points), speed), np.zeros(len(points)), **options)

    @property
    def start(self) -> np.ndarray:
        """Pose (3,) at the first point, looking to the next."""
        ahead = self.points[min(1, len(self.points) - 1)] - self.points[0]
        return np.array([*self.points[0], math.atan2(ahead[1], ahead[0])])

    @property
    def length(self) -> float:
        """Metres along the points."""
        return float(np.sum(np.hypot(*np.diff(self.points, axis=0).T)))


def load_plan(source: str | Path) -> Plan:
    """Plan from a TOML file or by a built-in name ("demo", "corridor50"). Raises PlanError."""
    path = resolve(source, BUILT_IN, "plan", PlanError)
    table = read_toml(path, TOML_KEYS, PlanError)
    speed = positive(table, "speed", 0.3, path)
    waypoints = table.get("waypoints")
    if not isinstance(waypoints, list) or len(waypoints) < 2:
        raise PlanError(f"{path}: waypoints: needs at least two, such as waypoints = [[0.0, 0.0], [3.0, 0.0]]")
    rows = [waypoint(item, speed, f"{path}: waypoints[{i}]") for i, item in enumerate(waypoints)]
    laps = table.get("laps", 1)
    if not isinstance(laps, int) or isinstance(laps, bool) or laps < 1:
        raise PlanError(f"{path}: laps: needs a whole number from 1, found {laps!r}")
    unrolled = rows * laps + (rows[:1] if table.get("closed", False) else [])
    x, y, speeds, pauses = np.array(unrolled).T
    return Plan(
        np.column_stack([x, y]),
        speeds,
        pauses,
        name=str(table.get("name", path.stem)),
        world=table.get("world"),
        max_turn=positive(table, "max_turn", 1.2, path),
        lookahead=positive(table, "lookahead", 0.30, path),
    )


def positive(table: dict[str, Any], key: str, default: float, path: Path) -> float:
    """A number above 0 from a table."""
    value = table.get(key, default)
    if not isinstance(value, int | float) or isinstance(value, bool) or not 0.0 < value < math.inf:
        raise PlanError(f"{path}: {key}: needs a number above 0, found {value!r}")
    return float(value)


def waypoint(item: Any, speed: float, place: str) -> list[float]:
    """[x, y, speed, pause] of one waypoint."""
    if isinstance(item, list):
        return [*numbers(item, 2, place, PlanError), speed, 0.0]
    if not isinstance(item, dict) or set(item) - {"at", "speed", "pause"} or "at" not in item:
        raise PlanError(f"{place}: needs [x, y] or {{at = [x, y], speed = 0.2, pause = 3.0}}, found {item!r}")
    at = numbers(item["at"], 2, f"{place}.at", PlanError)
    own, pause = numbers([item.get("speed", speed), item.get("pause", 0.0)], 2, place, PlanError)
    if own <= 0.0 or pause < 0.0:
        raise PlanError(f"{place}: speed must be above 0 and pause not negative")
    return [*at, own, pause]


@dataclass(slots=True)
class Leg:
    """One straight piece of the way."""

    x: float
    y: float
    dx: float  # unit vector
    dy: float
    length: float
    speed: float
    pause: float  # at its end
    left: float = 0.0  # m from its end to the next stop
    stops: bool = False  # at its end: a pause, a turn on the spot, or the end of the plan


def legs_of(plan: Plan) -> list[Leg]:
    """The plan's legs; points on top of each other make none, but keep their pause."""
    legs: list[Leg] = []
    for a, b, speed, pause in zip(plan.points[:-1], plan.points[1:], plan.speeds[1:], plan.pauses[1:], strict=True):
        length = math.hypot(b[0] - a[0], b[1] - a[1])
        if length > 1e-6:
            dx, dy = float(b[0] - a[0]) / length, float(b[1] - a[1]) / length
            legs.append(Leg(float(a[0]), float(a[1]), dx, dy, length, float(speed), float(pause)))
        elif legs:
            legs[-1].pause += float(pause)
    return with_stops(legs)


def with_stops(legs: list[Leg]) -> list[Leg]:
    """The legs, told where the driver must come to a stand and how far that is."""
    left, after = 0.0, None
    for leg in reversed(legs):
        is_sharp = after is None or leg.dx * after.dx + leg.dy * after.dy < SHARP
        leg.stops = is_sharp or leg.pause > 0.0
        leg.left = 0.0 if leg.stops else left
        left, after = leg.left + leg.length, leg
    return legs


@dataclass
class Driver:
    """Pure pursuit (Coulter 1992) of a plan: turns on the spot when the way lies far to the side."""

    plan: Plan
    legs: list[Leg] = field(init=False)
    index: int = field(init=False, default=0)
    along: float = field(init=False, default=0.0)
    resting: float = field(init=False, default=0.0)  # s of pause left
    is_turning: bool = field(init=False, default=False)
    finished: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        self.legs = legs_of(self.plan)
        self.finished = not self.legs
        self.resting = float(self.plan.pauses[0])

    def step(self, x: float, y: float, heading: float, seconds: float) -> tuple[float, float]:
        """Speed (m/s) and turn rate (rad/s) to command for the next `seconds`."""
        if self.resting > 0.0:
            self.resting -= seconds
            return 0.0, 0.0
        self.progress(x, y)
        if self.finished or self.resting > 0.0:
            return 0.0, 0.0
        target_x, target_y = self.target()
        return self.pursue(target_x - x, target_y - y, heading)

    def progress(self, x: float, y: float) -> None:
        """Moves along the legs as far as the robot has come."""
        while not self.finished:
            leg = self.legs[self.index]
            self.along, beside = project(leg, x, y)
            remaining = leg.length - self.along
            if leg.stops:
                if remaining > REACHED:
                    return
            elif self.along < leg.length and not (
                remaining < self.plan.lookahead and project(self.legs[self.index + 1], x, y)[1] < beside - 1e-6
            ):
                return
            self.resting = leg.pause
            self.index += 1
            self.along = 0.0
            self.finished = self.index == len(self.legs)
            if self.resting > 0.0:
                return

    def target(self) -> tuple[float, float]:
        """The point a lookahead along the way, not beyond a stop."""
        index, reach = self.index, self.along + self.plan.lookahead
        while reach > self.legs[index].length and not self.legs[index].stops:
            reach -= self.legs[index].length
            index += 1
        leg = self.legs[index]
        return leg.x + leg.dx * reach, leg.y + leg.dy * reach  # beyond a stop it aims straight on

    def pursue(self, ahead_x: float, ahead_y: float, heading: float) -> tuple[float, float]:
        """Speed and turn rate toward an offset in the world."""
        leg, max_turn = self.legs[self.index], self.plan.max_turn
        bearing = math.remainder(math.atan2(ahead_y, ahead_x) - heading, 2.0 * math.pi)
        self.is_turning = abs(bearing) > (0.35 if self.is_turning else 1.0)
        if self.is_turning:
            return 0.0, math.copysign(min(max_turn, 2.0 * abs(bearing)), bearing)
        curvature = 2.0 * math.sin(bearing) / max(math.hypot(ahead_x, ahead_y), 0.05)
        left = leg.left + leg.length - self.along
        speed = min(leg.speed, max(0.06, 0.8 * left))  # eases off before a stop
        speed = min(speed, max_turn / max(abs(curvature), 1e-9))
        return speed, speed * curvature

    def rejoin(self, x: float, y: float, window: float = 15.0) -> None:
        """Goes on from the nearest point of the way at most `window` metres ahead, after somebody else drove."""
        best, reach, start = math.inf, 0.0, self.index
        for index in range(start, len(self.legs)):
            leg = self.legs[index]
            beside = project(leg, x, y)[1]
            if beside < best - 1e-9:
                best, self.index = beside, index
            reach += leg.length
            if reach > window or (index > start and leg.pause > 0.0):
                break


def project(leg: Leg, x: float, y: float) -> tuple[float, float]:
    """Distance along a leg of the point nearest to (x, y), and how far away that is."""
    ox, oy = x - leg.x, y - leg.y
    along = min(max(ox * leg.dx + oy * leg.dy, 0.0), leg.length)
    return along, math.hypot(ox - along * leg.dx, oy - along * leg.dy)
