"""What is known of a ring of rangefinders: where each one sits, where it looks, how far and how wide it sees."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from slam.params import Params


class RingParams(Params):
    """Rangefinders of one kind around a robot; ranges count from each sensor's face along its bearing."""

    model: Literal["sonar", "infrared", "beam"]
    bearings_deg: tuple[float, ...] = Field(max_length=4096)
    offset: float = Field(default=0.0, ge=0.0)  # m from the robot's centre, along the bearing
    height: float = Field(default=0.15, gt=0.0)  # m above the floor
    half_angle_deg: float = Field(default=0.0, ge=0.0, lt=90.0)
    min_range: float = Field(default=0.03, ge=0.0)  # m; shorter ones are not trusted
    max_range: float = Field(default=3.0, gt=0.0, le=200.0)  # m; nothing farther is reported

    @model_validator(mode="after")
    def _sonar_has_a_cone(self) -> RingParams:
        if self.model == "sonar" and self.half_angle_deg == 0.0:
            raise ValueError("a sonar needs a half_angle_deg above 0; a ring of thin beams is a beam")
        return self

    @property
    def bearings(self) -> np.ndarray:
        """Bearings (n,) in radians."""
        return np.radians(np.asarray(self.bearings_deg, float))

    @property
    def half_angle(self) -> float:
        """Half the cone's width in radians."""
        return math.radians(self.half_angle_deg)


EIGHT = tuple(float(bearing) for bearing in range(0, 360, 45))


def crunch_sensors() -> dict[str, RingParams]:
    """Crunch's eight sonars and eight GP2D12 infra-red rangefinders (thesis, 1.2)."""
    return {
        "sonar": RingParams(
            model="sonar",
            bearings_deg=EIGHT,
            offset=0.07,
            height=0.152,
            half_angle_deg=22.5,
            min_range=0.03,
            max_range=3.0,
        ),
        "infrared": RingParams(
            model="infrared", bearings_deg=EIGHT, offset=0.05, height=0.203, min_range=0.10, max_range=0.80
        ),
    }
