"""SE(2) as 3 x 3 matrices, one pose at a time."""

from __future__ import annotations

import math

import numpy as np


def matrix(pose):
    """Homogeneous matrix of a pose (3,)."""
    x, y, theta = pose
    return np.array([[math.cos(theta), -math.sin(theta), x], [math.sin(theta), math.cos(theta), y], [0.0, 0.0, 1.0]])


def from_matrix(m):
    """Pose (3,) of a homogeneous matrix."""
    return np.array([m[0, 2], m[1, 2], math.atan2(m[1, 0], m[0, 0])])


def compose(a, b):
    """a, then b in a's frame."""
    return from_matrix(matrix(a) @ matrix(b))


def inverse(a):
    """The pose that undoes a."""
    return from_matrix(np.linalg.inv(matrix(a)))


def between(a, b):
    """b as a sees it."""
    return from_matrix(np.linalg.inv(matrix(a)) @ matrix(b))
