"""How a robot that somebody builds differs from the one that was drawn: masses, centre of gravity, sensors' zeros."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

MIDDLE = 512.0  # counts of 2.5 V
GYRO_COUNTS_PER_VOLT = 204.8
GYRO_COUNTS = 146.6773  # per rad/s
ACCELEROMETER_COUNTS = 204.8  # per g


@dataclass(frozen=True)
class Variation:
    """One such robot. A zero that is None is left to the part that the robot's seed has drawn."""

    mass: float = 1.0  # share of the nominal, as
    centre: float = 1.0  # the height of the centre of mass
    gyro_zero: float | None = None  # V from 2.5 V
    accelerometer_zero: float | None = None  # g
    gyro_walk: float = 0.0  # rad/s per root of a second by which the gyro's zero wanders

    @classmethod
    def drawn(cls, seed: int, level: float = 0.02) -> Variation:
        """Mass and centre +-20 %, gyro's zero +-0.2 V, accelerometer's +-`level` (g), all uniform.

        The gyro's zero wanders by 0.1 deg/s in a minute, as a part does that grows warm.
        """
        mass, centre, gyro, accelerometer = np.random.default_rng(seed).uniform(-1.0, 1.0, 4)
        walk = math.radians(0.1) / math.sqrt(60.0)
        return cls(1.0 + 0.2 * mass, 1.0 + 0.2 * centre, 0.2 * gyro, level * accelerometer, walk)

    def apply(self, robot: Any) -> None:
        """Makes a robot (struct robot or struct avr_robot) of this kind, before its first step."""
        physique, inertial = robot.body.physique, robot.inertial
        physique.mass *= self.mass
        physique.centre *= self.centre
        physique.inertia *= self.mass * self.centre**2
        if self.gyro_zero is not None:
            inertial.gyro_zero = MIDDLE + GYRO_COUNTS_PER_VOLT * self.gyro_zero
        if self.accelerometer_zero is not None:
            inertial.accelerometer_zero = MIDDLE + ACCELEROMETER_COUNTS * self.accelerometer_zero
        inertial.gyro_walk = GYRO_COUNTS * self.gyro_walk
