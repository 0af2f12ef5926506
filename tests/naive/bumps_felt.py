"""Slow twins of the kernels of the map from bumps: corners of a bumper, points along drives, sums over stages."""

from __future__ import annotations

import math

import numpy as np

from slam.cart_odometry import CartParams, arc
from slam.pose import compose


def support(delta: float, half_width: float, ahead: float) -> float:
    """The farthest of the bumper's two ends, seen along a wall's outward direction that the heading is off by delta."""
    ends = [(ahead, half_width), (ahead, -half_width)]
    return max(math.cos(delta) * x - math.sin(delta) * y for x, y in ends)


def composed(stages: np.ndarray, biases: np.ndarray, cart: CartParams) -> np.ndarray:
    """Motion (3,) of stages (s, 3), one after the other, of a cart with a shorter wheelbase that also drifts."""
    pose = np.zeros(3)
    for _, left, right in stages:
        drift = biases[1] * 0.5 * (left + right) * cart.wheelbase
        turn = (right - left) * (1.0 + biases[0]) + drift
        middle = 0.5 * (left + right)
        pose = compose(pose, arc(middle - 0.5 * turn, middle + 0.5 * turn, cart))
    return pose


def near_share(points: np.ndarray, segments: np.ndarray, pose: np.ndarray, near: float) -> float:
    """Mean over points (n, 2) at a pose of 1 / (1 + (d / near)^2), segments (m, 4) being rows of close points."""
    shares = []
    for x, y in points:
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        place = np.array([pose[0] + cos * x - sin * y, pose[1] + sin * x + cos * y])
        rows = [start + np.linspace(0, 1, 4001)[:, None] * (end - start) for start, end in segments.reshape(-1, 2, 2)]
        least = min(float(np.hypot(*(row - place).T).min()) for row in rows)
        shares.append(1.0 / (1.0 + (least / near) ** 2))
    return float(np.mean(shares))


def was_free(pieces: np.ndarray, spot: np.ndarray, half_width: float, contact: float) -> bool:
    """Whether some point along a drive's piece (4,), not near its end, has the spot to its side, well within."""
    for piece in pieces:
        start, end = piece[:2], piece[2:]
        length = float(np.hypot(*(end - start)))
        for at in np.linspace(0.0, max(0.0, length - 3.0 * contact), 2000):
            place = start + (end - start) / length * at
            if np.hypot(*(spot - place)) < half_width - 2.0 * contact and abs((spot - place) @ (end - start)) < 1e-3:
                return True
    return False
