"""Particles laid onto their maps one after the other, and poses drawn by numpy's factors of the information."""

import numpy as np

from slam.map_matching import lay
from tests.naive.counter_random import gaussian


def draw_pose(pose, hessian, seed, step, particle):
    """A pose (3,) drawn around another, and the logarithm of the root of the determinant of the information."""
    normals = [gaussian(seed, step, particle, stream) for stream in range(3)]
    root = np.linalg.cholesky(hessian)
    return pose + np.linalg.inv(root.T) @ normals, 0.5 * np.linalg.slogdet(hessian)[1]


def move_particle(cells, home, scan, pose, prior, rule, seed, step, particle):
    """Where a particle goes from a guess (3,), and the logarithm of what its weight is multiplied by."""
    laid, hessian = np.array(pose), np.empty((3, 3))
    cost = lay(cells, home, scan, laid, prior, rule, hessian)
    drawn, log_root = draw_pose(laid, hessian, seed, step, particle)
    return drawn, -cost - log_root
