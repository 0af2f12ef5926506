"""SE(2) on arrays of shape (..., 3): (x, y, theta) in metres and radians. `pose_a_b` maps frame b into frame a."""

from __future__ import annotations

import numpy as np


def wrap(angles: np.ndarray | float) -> np.ndarray:
    """Angles in (-pi, pi]."""
    wrapped = np.pi - np.mod(np.pi - np.asarray(angles, float), 2.0 * np.pi)
    return wrapped + 2.0 * np.pi * (wrapped <= -np.pi)  # where the remainder rounds up to a whole turn


def compose(pose_a_b: np.ndarray, pose_b_c: np.ndarray) -> np.ndarray:
    """pose_a_c; shapes broadcast."""
    a, b = np.broadcast_arrays(np.asarray(pose_a_b, float), np.asarray(pose_b_c, float))
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    composed = np.empty(a.shape)
    composed[..., 0] = a[..., 0] + cos * b[..., 0] - sin * b[..., 1]
    composed[..., 1] = a[..., 1] + sin * b[..., 0] + cos * b[..., 1]
    composed[..., 2] = wrap(a[..., 2] + b[..., 2])
    return composed


def inverse(pose_a_b: np.ndarray) -> np.ndarray:
    """pose_b_a."""
    a = np.asarray(pose_a_b, float)
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    inverted = np.empty(a.shape)
    inverted[..., 0] = -cos * a[..., 0] - sin * a[..., 1]
    inverted[..., 1] = sin * a[..., 0] - cos * a[..., 1]
    inverted[..., 2] = wrap(-a[..., 2])
    return inverted


def between(pose_a_b: np.ndarray, pose_a_c: np.ndarray) -> np.ndarray:
    """pose_b_c: the motion from b to c, in b's frame."""
    return compose(inverse(pose_a_b), pose_a_c)


def transform(pose_a_b: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (..., 2) of frame b in frame a; the pose is one (3,) or broadcasts against the points' leading shape."""
    a = np.asarray(pose_a_b, float)
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x, y = points[..., 0], points[..., 1]
    return np.stack([a[..., 0] + cos * x - sin * y, a[..., 1] + sin * x + cos * y], axis=-1)
