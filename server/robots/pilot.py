"""How a robot steers by itself: along a route to a goal, or where a person wishes, bent off obstacles.

Directions come from the vector field histogram (Crunch thesis, 2.2). A route is followed by pure pursuit of a point
some way ahead on it (Coulter, CMU-RI-TR-92-01, 1992), with the histogram between that point and the wheels. Knows no
map and no sensor: whoever asks for a command hands in what can be seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from server.commands import DriveCommand, StopCommand
from server.messages import Drive, Goal
from slam.pose import between
from slam.vfh import Steering, Vfh

FURTHEST_DETOUR = math.radians(40.0)  # from what a person wishes to the nearest open way
STRAIGHT = math.radians(2.0)  # off the wish that is no bend
See = Callable[[float], np.ndarray]  # the polar histogram (sectors,) now, of obstacles nearer than some metres

SIGHT = 0.5  # s after which what was seen last is too old to steer by


class Reins(NamedTuple):
    """What turns a bearing into a command."""

    goal_radius: float  # m from the goal that count as there
    look_ahead: float  # m along a route to the point that is steered to
    turn_gain: float  # rad/s per rad of bearing
    max_turn: float  # rad/s


class Course:
    """A route from where the robot stood to its goal; what has been passed stays behind."""

    def __init__(self, start: np.ndarray, goal: Goal, look_ahead: float):
        """`start` (2,) in the world."""
        assert goal.place is not None
        self.places = np.array([start, *goal.route, goal.place], float)
        self.look_ahead = look_ahead
        steps = np.diff(self.places, axis=0)
        self.lengths = np.hypot(*steps.T)
        self.marks = np.concatenate([[0.0], np.cumsum(self.lengths)])  # m from the start to each place
        self.passed = 0.0  # m

    def advance(self, position: np.ndarray) -> None:
        """Go on to the point of the course that is nearest to a position (2,).

        It is sought a little way on from the last one only, so that a course which comes back near itself is driven
        in full.
        """
        steps = np.diff(self.places, axis=0)
        along = np.einsum("ij,ij->i", position - self.places[:-1], steps) / np.maximum(self.lengths, 1e-9)
        candidates = self.marks[:-1] + np.clip(along, 0.0, self.lengths)
        candidates = np.clip(candidates, self.passed, self.passed + 2.0 * self.look_ahead)
        self.passed = float(candidates[np.argmin(np.hypot(*(self.at(candidates) - position).T))])

    def ahead(self) -> np.ndarray:
        """The point (2,) to steer to: `look_ahead` m on; the goal itself where there is no route."""
        is_direct = len(self.places) == 2
        return self.places[-1] if is_direct else self.at(np.array([self.passed + self.look_ahead]))[0]

    def at(self, metres: np.ndarray) -> np.ndarray:
        """The points (n, 2) so many metres (n,) from the start."""
        return np.stack([np.interp(metres, self.marks, self.places[:, axis]) for axis in (0, 1)], axis=1)

    def rest(self) -> np.ndarray:
        """The places (r, 2) on the way to the goal that are still to be passed."""
        return self.places[1:-1][self.marks[1:-1] > self.passed]


class Pilot:
    """Goes to a goal, or does what a person wishes as far as there is room."""

    def __init__(self, vfh: Vfh, reins: Reins):
        self.vfh = vfh
        self.reins = reins
        self.goal: Goal | None = None
        self.course: Course | None = None
        self.wish: Drive | None = None
        self.bearing: float | None = None  # commanded, in the robot's frame
        self.steered: float | None = None  # the same in the odometry frame, which the robot's turning leaves alone
        self.meant: float | None = None  # where a person wished to go, in that frame, while the robot is bent off it

    @property
    def is_resting(self) -> bool:
        """Whether there is nothing to reach, and nobody wishes anything."""
        return self.goal is None and self.wish is None

    def rest(self) -> None:
        """Nothing is to be reached any more, and nobody wishes anything."""
        self.goal = self.course = self.wish = None
        self.bearing = self.steered = self.meant = None

    def aim(self, goal: Goal, pose: np.ndarray) -> None:
        """Head for a goal from a pose (3,) in the world; another route to the same goal changes no choice of ways."""
        is_same = self.goal is not None and self.goal.place == goal.place
        bearing, steered = (self.bearing, self.steered) if is_same else (None, None)
        self.rest()
        self.goal, self.bearing, self.steered = goal, bearing, steered
        self.course = Course(pose[:2], goal, self.reins.look_ahead)

    def follow(self, wish: Drive) -> None:
        """Do what a person wishes, until there is another wish."""
        if self.wish is None:
            self.rest()
        self.wish = wish if wish.speed or wish.turn else None

    def objective(self, pose: np.ndarray) -> float | None:
        """Bearing in the robot's frame to what it heads for; None if it heads for nothing."""
        if self.wish is not None:
            return self.wish.turn / self.reins.turn_gain if self.wish.speed > 0.0 else None
        if self.course is None:
            return None
        offset = self.offset(pose)
        return math.atan2(offset[1], offset[0])

    def shown(self, pose: np.ndarray) -> dict[str, Any]:
        """What a snapshot of the robot at `pose` (3,) in the world tells of where it heads, by the snapshot's names."""
        return {
            "goal": self.goal.place if self.goal else None,
            "goal_bearing": self.objective(pose),
            "steering": self.bearing,
            "route": self.course.rest() if self.course else np.zeros((0, 2)),
        }

    def offset(self, pose: np.ndarray) -> np.ndarray:
        """The point to steer to (2,), in the frame of the robot at `pose` (3,) in the world."""
        assert self.course is not None
        return between(pose, np.array([*self.course.ahead(), 0.0]))[:2]

    def steer(self, pose: np.ndarray, heading: float, see: See) -> DriveCommand | StopCommand | None:
        """The next command of the robot at `pose` (3,) in the world with `heading` by odometry; None without a task."""
        if self.goal is not None:
            return self.approach(self.goal, pose, heading, see)
        return None if self.wish is None else self.share(self.wish, heading, see)

    def approach(self, goal: Goal, pose: np.ndarray, heading: float, see: See) -> DriveCommand | StopCommand:
        """One step towards the goal."""
        assert goal.place is not None
        assert self.course is not None
        if math.hypot(goal.place[0] - pose[0], goal.place[1] - pose[1]) < self.reins.goal_radius:
            self.rest()
            return StopCommand()
        self.course.advance(pose[:2])
        offset = self.offset(pose)
        steering = self.choose(see(math.hypot(*offset)), math.atan2(offset[1], offset[0]), heading)
        if steering.bearing is None:
            return DriveCommand(0.0, 0.0)
        speed = min(steering.speed, goal.speed) * max(0.0, math.cos(steering.bearing))
        return DriveCommand(speed, self.turn(steering.bearing))

    def share(self, wish: Drive, heading: float, see: See) -> DriveCommand:
        """What a person wishes, bent towards the nearest open way and slowed by what stands ahead.

        The wished turn rate stands for the bearing at which it would come about by itself, so that nothing is changed
        where there is room. Who wishes straight on means the direction from before the robot was bent off it, and is
        led back to it. Where no way near enough is open, it goes on as wished, as slowly as what is ahead demands.
        """
        densities = see(math.inf)
        if wish.speed <= 0.0:
            self.bearing = self.steered = self.meant = None
            return DriveCommand(wish.speed * self.vfh.room(densities[len(densities) // 2]), wish.turn)
        lead = wish.turn / self.reins.turn_gain
        meant = self.meant if wish.turn == 0.0 else None
        wanted = lead if meant is None else math.remainder(meant - heading, 2.0 * math.pi)
        bearing, _, valley = self.choose(densities, wanted, heading)
        if bearing is None or valley is None or detour(valley, wanted) > FURTHEST_DETOUR:
            bearing = self.bearing = wanted
            self.steered = None
        is_bent = abs(bearing - lead) > STRAIGHT
        self.meant = heading + wanted if is_bent else None
        speed = min(wish.speed, self.vfh.params.max_speed) if is_bent else wish.speed
        room = self.vfh.room(densities[0]) * max(0.0, math.cos(bearing - lead))
        return DriveCommand(speed * room, self.turn(bearing))

    def choose(self, densities: np.ndarray, wanted: float, heading: float) -> Steering:
        """The way nearest to a wanted bearing, and among ways as good the one that was begun."""
        last = None if self.steered is None else math.remainder(self.steered - heading, 2.0 * math.pi)
        steering = self.vfh.steer(densities, wanted, last)
        self.bearing = steering.bearing
        self.steered = None if steering.bearing is None else steering.bearing + heading
        return steering

    def turn(self, bearing: float) -> float:
        """Turn rate towards a bearing, rad/s."""
        return max(-self.reins.max_turn, min(self.reins.max_turn, self.reins.turn_gain * bearing))


def detour(valley: tuple[float, float], bearing: float) -> float:
    """By how much a valley misses a bearing, rad; 0 if it holds it."""
    start, end = valley
    into = (bearing - start) % (2.0 * math.pi)
    return 0.0 if into <= end - start else min(2.0 * math.pi - into, into - (end - start))
