"""Dead reckoning from two wheels, and where the robot was when a late reading was taken."""

from __future__ import annotations

import math
from collections import deque

from server.messages import Wheels

FASTEST = 2.0  # m/s that a wheel can roll; a longer step means that the board began to count anew
SLACK = 0.1  # m of such a step that jitter of the clock may explain
KEPT = 32  # readings of history; at 50 Hz longer than any reading is under way on the board


class WheelOdometry:
    """Integrates wheel rotations along arcs; adds the body's tilt, for encoders measure the wheel against the body."""

    def __init__(self, track: float, wheel_radius: float):
        self.track = track
        self.wheel_radius = wheel_radius
        self.x = self.y = self.theta = 0.0
        self.last: Wheels | None = None
        self.restarts = 0  # times the counts jumped, as after a reboot of the board
        self.history: deque[tuple[float, float, float, float, float]] = deque(maxlen=KEPT)  # t, x, y, theta, tilt

    def roll(self, wheels: Wheels) -> float:
        """Take a reading up; returns the distance (m) that the robot's centre moved, negative backwards."""
        forward = 0.0
        if self.last is not None:
            swing = self.wheel_radius * (wheels.tilt - self.last.tilt)
            half = 0.5 * wheels.wrap
            left = (wheels.left - self.last.left + half) % wheels.wrap - half + swing
            right = (wheels.right - self.last.right + half) % wheels.wrap - half + swing
            if max(abs(left), abs(right)) > FASTEST * max(0.0, wheels.t - self.last.t) + SLACK:
                left = right = 0.0
                self.restarts += 1
            forward = 0.5 * (left + right)
            turn = (right - left) / self.track
            heading = self.theta + 0.5 * turn
            self.x += forward * math.cos(heading)
            self.y += forward * math.sin(heading)
            self.theta = math.remainder(self.theta + turn, 2.0 * math.pi)
        self.last = wheels
        self.history.append((wheels.t, self.x, self.y, self.theta, wheels.tilt))
        return forward

    def at(self, t: float) -> tuple[float, float, float, float]:
        """(x, y, theta, tilt) at time t, between the readings kept; the oldest or newest of them beyond."""
        newer = self.history[-1]
        if t >= newer[0]:
            return newer[1:]
        for older in reversed(self.history):
            if older[0] <= t:
                span = newer[0] - older[0]
                share = (t - older[0]) / span if span > 0.0 else 0.0
                turn = math.remainder(newer[3] - older[3], 2.0 * math.pi)
                return (
                    older[1] + share * (newer[1] - older[1]),
                    older[2] + share * (newer[2] - older[2]),
                    older[3] + share * turn,
                    older[4] + share * (newer[4] - older[4]),
                )
            newer = older
        return newer[1:]
