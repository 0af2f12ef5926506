"""Localization by bumps as the paper has it: particles outside the bump space are removed, the others doubled.

Dye, Mapping with only a bumper, part 3. Its errors are normally distributed; here their sizes are those of the cart's
odometry with its slips, by their second moments. Once no particle is left the paper's run is over. Uses its siblings
`area`, `bumps`, `cart_odometry` and `pose_clusters`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slam.area import Area, clearance
from slam.bumps import in_bump_space
from slam.cart_odometry import DRIVE, CartParams, Stage, arc, turn_variance, way_variance
from slam.pose import compose
from slam.pose_clusters import Cluster, clusters


class Survival(NamedTuple):
    """Parameters of the paper's rule."""

    particles: int = 700
    tolerance: float = 0.03  # m, half the band's width
    size: float = 0.15  # m and rad of a cluster
    turn: float = math.radians(45.0)


class Survivors:
    """Equal particles that have all bumps in bump space."""

    def __init__(self, area: Area, cart: CartParams, params: Survival, seed: int):
        self.area = area
        self.cart = cart
        self.params = params
        self.rng = np.random.default_rng(seed)
        self.poses = poses_on_floor(area, params.particles, self.rng)
        self.n_alive = params.particles  # after the last bump, before they were doubled

    def step(self, stage: Stage) -> None:
        """One stage more; nothing happens any more once none is alive."""
        if not self.n_alive:
            return
        change = arc(stage.left, stage.right, self.cart)
        noise = noise_of(stage, change, self.cart) * self.rng.standard_normal(self.poses.shape)
        self.poses = compose(self.poses, change + noise)
        if stage.kind == DRIVE and stage.bumper:
            alive = np.flatnonzero(in_bump_space(self.area, self.poses, self.cart, self.params.tolerance))
            self.n_alive = alive.size
            if alive.size:
                self.poses = self.poses[np.resize(alive, self.params.particles)]

    def clusters(self) -> list[Cluster]:
        """Where the particles are, the heaviest cluster first; none once none is alive."""
        if not self.n_alive:
            return []
        weights = np.full(len(self.poses), 1.0 / len(self.poses))
        return clusters(self.poses, weights, self.params.size, self.params.turn)


def poses_on_floor(area: Area, n: int, rng: np.random.Generator) -> np.ndarray:
    """Poses (n, 3) drawn evenly from the floor and all headings."""
    points = area.walls.reshape(-1, 2)
    low, high = [*points.min(axis=0), -math.pi], [*points.max(axis=0), math.pi]
    poses = np.zeros((0, 3))
    while len(poses) < n:
        drawn = rng.uniform(low, high, (n, 3))
        poses = np.concatenate([poses, drawn[[clearance(area, x, y) > 0.0 for x, y, _ in drawn]]])
    return poses[:n]


def noise_of(stage: Stage, change: np.ndarray, cart: CartParams) -> np.ndarray:
    """Standard deviations (3,) of a stage's forward, lateral and heading errors; a bump's slips are in them."""
    way = 0.5 * cart.tick * (stage.left + stage.right)
    slip = math.sqrt(cart.slip_share) if stage.kind == DRIVE and stage.bumper else 0.0
    distance = math.hypot(math.sqrt(way_variance(way, cart)), slip * math.sqrt(2.0) * cart.slip_distance)
    heading = math.sqrt(turn_variance(way, change[2], cart))
    sideways = math.hypot(0.5 * heading * abs(way), distance)
    return np.array([distance, sideways, math.hypot(heading, slip * cart.slip_turn)])
