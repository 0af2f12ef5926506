"""Gathers where thin beams met walls along a drive, for what wants single readings rather than a fused map.

Echoes are kept by nodes, places a little apart on the way; what was seen between two of them hangs on the earlier one
by the odometry, which errs little over so short a way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from slam.params import Params
from slam.pose import inverse, transform
from slam.rangefinder import RingParams


class EchoParams(Params):
    """How densely echoes are gathered."""

    spacing: float = Field(default=0.25, gt=0.0)  # m between nodes
    turn: float = Field(default=0.3, gt=0.0)  # rad between nodes, where the robot turns on the spot
    step: float = Field(default=0.05, ge=0.0)  # m between sweeps that are kept, so that standing still counts once
    step_turn: float = Field(default=0.1, ge=0.0)  # rad between them, likewise


class Sweep(NamedTuple):
    """Ranges (n,) of a ring, by its name, on a body at `pose` (3,) that leans forward by `tilt`."""

    name: str
    ring: RingParams
    ranges: np.ndarray
    pose: np.ndarray
    tilt: float = 0.0


class Echoes(NamedTuple):
    """Ends of beams by nodes: `points` (m, 2) and unit `views` (m, 2), from sensor to end, in the nodes' frames.

    `nodes` (m,) ascend; `rows` (n,) are the odometry rows that the n nodes stand at.
    """

    points: np.ndarray
    views: np.ndarray
    nodes: np.ndarray
    rows: np.ndarray


def ends_of(sweep: Sweep) -> tuple[np.ndarray, np.ndarray]:
    """Points (k, 2) where a sweep's beams met walls and the bearings (k,) they went, in the frame of its pose.

    A leaning beam is projected on the floor, and what may have met the floor left out, as in `slam.local_map`.
    """
    ring, tilt = sweep.ring, sweep.tilt
    slopes = math.sin(tilt) * np.cos(ring.bearings)  # sines of the beams' angles below the horizon
    floor = np.where(slopes > 1e-3, 0.9 * ring.height / np.maximum(slopes, 1e-3), np.inf)
    ranges = np.nan_to_num(sweep.ranges, nan=np.inf, posinf=np.inf)
    is_echo = (ranges >= ring.min_range) & (ranges <= np.minimum(ring.max_range, floor))
    bearings = sweep.pose[2] + ring.bearings[is_echo]
    reach = ring.offset + ranges[is_echo] * np.sqrt(1.0 - slopes[is_echo] ** 2)
    lean = ring.height * math.sin(tilt)  # the leaning body carries its sensors forward
    base = sweep.pose[:2] + lean * np.array([math.cos(sweep.pose[2]), math.sin(sweep.pose[2])])
    return base + reach[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=1), bearings


class EchoLog:
    """Takes sweeps up as they come; `echoes` hands over what they met."""

    def __init__(self, params: EchoParams):
        self.params = params
        self.rows: list[int] = []
        self.node = np.zeros(3)  # the newest node's pose in the odometry frame
        self.looked: dict[str, np.ndarray] = {}  # where each ring's last kept sweep was
        self.points: list[np.ndarray] = []
        self.views: list[np.ndarray] = []
        self.nodes: list[np.ndarray] = []

    def look(self, row: int, odometry: np.ndarray, sweep: Sweep) -> None:
        """Take up a sweep that came when row `row` of the odometry, the pose `odometry` (3,), was the newest."""
        if sweep.ring.model == "sonar":
            return  # its echo may have come from anywhere in a wide cone
        params = self.params
        if sweep.name in self.looked and is_near(self.looked[sweep.name], sweep.pose, params.step, params.step_turn):
            return
        self.looked[sweep.name] = sweep.pose
        if not self.rows or not is_near(self.node, odometry, params.spacing, params.turn):
            self.rows.append(row)
            self.node = np.array(odometry, float)
        ends, bearings = ends_of(sweep)
        bearings = bearings - self.node[2]
        self.points.append(transform(inverse(self.node), ends))
        self.views.append(np.stack([np.cos(bearings), np.sin(bearings)], axis=1))
        self.nodes.append(np.full(len(ends), len(self.rows) - 1))

    def echoes(self) -> Echoes:
        """All that was gathered."""
        none = np.empty((0, 2))
        return Echoes(
            np.concatenate([none, *self.points]),
            np.concatenate([none, *self.views]),
            np.concatenate([np.empty(0, np.int64), *self.nodes]),
            np.array(self.rows, np.int64),
        )


def is_near(pose: np.ndarray, other: np.ndarray, distance: float, turn: float) -> bool:
    """Whether two poses differ by less than `distance` m and `turn` rad."""
    apart = math.hypot(other[0] - pose[0], other[1] - pose[1])
    return apart < distance and abs(math.remainder(other[2] - pose[2], 2.0 * math.pi)) < turn
