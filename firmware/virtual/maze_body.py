"""Maze Runner's body: two motors without encoders on a floor that slips, a castor, and a battery that sags.

A wheel's speed follows its motor's curve, power = A exp(B speed) (the robot's paper), with a lag; the power counts as
much as the battery has volts. No two motors are alike, and the floor gives way a little now and then: what was
commanded is not what happens. The robot is round to walls: it stops where it would push into one, and may turn there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from firmware.virtual.worlds import World

Drift = Literal["none", "low", "medium", "high"]
STANDING, GROWTH = 0.090149, 6.44209  # A, and B in s/m, as the paper's authors measured
TRACK = 0.20  # m between the wheels
RADIUS = 0.13  # m to the farthest corner of the plates
LAG = 0.12  # s in which a wheel follows two thirds of a change
NOMINAL, FULL, EMPTY = 11.4, 12.6, 9.9  # V of three cells: where the curve was measured, full, empty
CAPACITY = 2.2 * 3600.0  # As
RESISTANCE = 0.12  # ohm of battery and leads
IDLE, LOADED = 0.25, 1.6  # A: of the boards, and of a motor at full power
DRIFTS: dict[str, tuple[float, float]] = {  # standard deviations: the motors' A and B, a wheel's slip, all as shares
    "none": (0.0, 0.0), "low": (0.02, 0.03), "medium": (0.05, 0.06), "high": (0.08, 0.12),
}  # fmt: skip
SLIP_TIME = 0.5  # s that a slip lasts
CLEAR = 0.01  # m off a wall from which on it is not touched any more


@dataclass
class Battery:
    """Three lithium cells: charge left (As), and the volts under the present load."""

    charge: float = CAPACITY
    volts: float = FULL

    def drain(self, amperes: float, seconds: float) -> None:
        """Give current for a time."""
        self.charge = max(0.0, self.charge - amperes * seconds)
        self.volts = EMPTY + (FULL - EMPTY) * self.charge / CAPACITY - RESISTANCE * amperes


@dataclass
class MazeBody:
    """The body in a world; `step` it with the powers (-1..1) that the bridge gives its motors."""

    world: World
    x: float
    y: float
    heading: float
    seed: int = 0
    drift: Drift = "medium"
    speeds: list[float] = field(default_factory=lambda: [0.0, 0.0])  # m/s of the wheels' rims
    battery: Battery = field(default_factory=Battery)
    bumps: int = 0  # times that it ran into a wall
    distance: float = 0.0

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng([self.seed, 0x3A2E])
        unlike, self.slip_share = DRIFTS[self.drift]
        self.standing = STANDING * (1.0 + unlike * self.rng.standard_normal(2))
        self.growth = GROWTH * (1.0 + unlike * self.rng.standard_normal(2))
        self.slips = self.slip_share * self.rng.standard_normal(2)
        self.is_touching = False

    @property
    def pose(self) -> np.ndarray:
        """True pose (3,)."""
        return np.array([self.x, self.y, self.heading])

    def wanted(self, wheel: int, power: float) -> float:
        """The speed (m/s) at which a wheel turns in the end."""
        effective = abs(power) * self.battery.volts / NOMINAL
        if effective <= self.standing[wheel]:
            return 0.0
        return math.copysign(math.log(effective / self.standing[wheel]) / self.growth[wheel], power)

    def step(self, powers: tuple[float, float], seconds: float) -> None:
        """Let time pass, at most 20 ms."""
        follows = 1.0 - math.exp(-seconds / LAG)
        for wheel in (0, 1):
            self.speeds[wheel] += follows * (self.wanted(wheel, powers[wheel]) - self.speeds[wheel])
        self.battery.drain(IDLE + LOADED * (abs(powers[0]) + abs(powers[1])), seconds)
        if self.slip_share > 0.0:
            keeps = math.exp(-seconds / SLIP_TIME)
            fresh = self.slip_share * math.sqrt(1.0 - keeps**2)
            self.slips = keeps * self.slips + fresh * self.rng.standard_normal(2)
        left, right = (speed * (1.0 + slip) for speed, slip in zip(self.speeds, self.slips, strict=True))
        turn = (right - left) / TRACK * seconds
        way = 0.5 * (left + right) * seconds
        middle = self.heading + 0.5 * turn
        self.heading = math.remainder(self.heading + turn, 2.0 * math.pi)
        self.move(way * math.cos(middle), way * math.sin(middle))

    def move(self, dx: float, dy: float) -> None:
        """Go on, unless a wall is in the way: along it one may slide."""
        if dx == 0.0 and dy == 0.0:
            return
        for u, v in ((dx, dy), (dx, 0.0), (0.0, dy)):
            place = np.array([[self.x + u, self.y + v], [self.x, self.y]])
            there, here = self.world.clearances(place, 2.0 * RADIUS)
            if there >= RADIUS or there > here:
                self.x, self.y = self.x + u, self.y + v
                self.distance += math.hypot(u, v)
                if (u, v) != (dx, dy):
                    self.touch()
                elif there > RADIUS + CLEAR:
                    self.is_touching = False
                return
        self.touch()

    def touch(self) -> None:
        """Count each time that it runs into a wall anew."""
        self.bumps += not self.is_touching
        self.is_touching = True
