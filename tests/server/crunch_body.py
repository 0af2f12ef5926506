"""A robot that drives exact arcs in a world of segments, what it sends, and how a fold is fed with it."""

from __future__ import annotations

import math

import numpy as np

from server.messages import Estimate, Keyframe, Ranges, Wheels
from server.robots.crunch import CrunchParams
from slam.local_map import LocalMapParams
from slam.rangefinder import RingParams
from slam.walls import WallParams
from tests.naive.walls import nearest_crossing, rectangle

TRACK, RADIUS, WRAP = 0.19, 0.0508, 20.9
RATE = 50.0
HALL = rectangle(2.0, 0.0, 8.0, 1.2)  # a corridor 1.2 m wide, from x = -2 to 6
SENSORS = {
    "sonar": RingParams(
        model="sonar", bearings_deg=tuple(np.arange(0.0, 360.0, 45.0)), offset=0.07, height=0.152, half_angle_deg=22.5
    ),
    "infrared": RingParams(
        model="infrared", bearings_deg=tuple(np.arange(0.0, 360.0, 45.0)), offset=0.05, height=0.203, min_range=0.10,
        max_range=0.80,
    ),
}  # fmt: skip


def params_of(**changes):
    """Parameters that do not follow the defaults."""
    small = {
        "sensors": SENSORS,
        "track": TRACK,
        "calibration": {"wheel_radius": RADIUS},
        "vertex_spacing": 0.5,
        "hindsight": 2,
        "goal_radius": 0.2,
        "local_map": LocalMapParams(reach=1.0),
        "walls": WallParams(n_rays=120),
        "filter": {"particles": 30},
    }
    return CrunchParams.model_validate(small | changes)


class Body:
    """A robot that is driven exactly along arcs, and what it would send."""

    def __init__(self, start=0.0, tilt=0.0):
        self.pose, self.t, self.tilt = np.zeros(3), 0.0, tilt
        self.left = self.right = start
        self.rolled = 0.0

    def drive(self, speed, turn, seconds, tilt=None):
        """Wheels messages (50 Hz) of an arc; the tilt moves evenly to its new value."""
        n = round(seconds * RATE)
        tilts = np.linspace(self.tilt, self.tilt if tilt is None else tilt, n + 1)[1:]
        return [self.advance(speed / RATE, turn / RATE, float(angle)) for angle in tilts]

    def advance(self, way, turn, tilt):
        """One exact step along an arc, and its message."""
        self.t += 1.0 / RATE
        chord = way if abs(turn) < 1e-12 else way * math.sin(0.5 * turn) / (0.5 * turn)
        heading = self.pose[2] + 0.5 * turn
        self.pose = self.pose + [chord * math.cos(heading), chord * math.sin(heading), turn]
        swing = RADIUS * (tilt - self.tilt)
        self.left += way - 0.5 * TRACK * turn - swing
        self.right += way + 0.5 * TRACK * turn - swing
        self.rolled += abs(way)
        self.tilt = tilt
        return self.wheels()

    def wheels(self):
        return Wheels(self.t, self.left % WRAP, self.right % WRAP, self.tilt, WRAP)

    def ranges(self, sensor, world, pose=None, t=None):
        """A sweep of exact ranges in a world of segments."""
        ring, pose = SENSORS[sensor], self.pose if pose is None else pose
        found = []
        for bearing in pose[2] + ring.bearings:
            face = pose[:2] + ring.offset * np.array([math.cos(bearing), math.sin(bearing)])
            found.append(nearest_crossing(face, bearing, world))
        reading = np.array([value if value <= ring.max_range else math.inf for value in found])
        return Ranges(self.t if t is None else t, sensor, reading)


def feed(robot, messages):
    """All effects of the messages."""
    return [effect for message in messages for effect in robot.step(message)]


def tour(robot, body, metres, world=HALL, speed=0.3, turn=0.0):
    """Drive straight on with both rings looking, 12.5 times a second; all effects."""
    effects = []
    for _ in range(round(metres / speed * 12.5)):
        effects += feed(robot, body.drive(speed, turn, 4.0 / RATE))
        for sensor in SENSORS:
            effects += robot.step(body.ranges(sensor, world))
    return effects


def keyframes(effects):
    return [effect for effect in effects if isinstance(effect, Keyframe)]


def estimate_of(robot, path, t=1.0):
    """An estimate that believes in a path."""
    path = np.asarray(path, float)
    return Estimate(t, path, np.ones(len(path)), path[-1:], 0, 30, 30.0, 0, 1.0, -1.0)
