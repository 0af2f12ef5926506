"""What a perfect loop closer could know: odometry refined with the true relative poses between true revisits.

The oracle sees no walls. Wherever the truth came back to a place it is told the pose relative to every earlier visit,
with a little noise; between revisits it has the odometry and the motion model, as Crunch has. What error it leaves is
what loops alone do not reveal.
"""

from __future__ import annotations

import math

import numpy as np

from slam.evaluate import nearest_of_visits, path_length
from slam.motion import MotionParams
from slam.pose import between, compose
from slam.pose_graph import LoopEdges, descend
from slam.refinement import Chain, Problem
from slam.trajectory import correct

LOOP_SIGMAS = np.array([0.02, 0.02, math.radians(0.5)])  # m, m, rad: how precisely the oracle knows a revisit
STEPS = 100  # of the solver, at most


def true_loops(truth: np.ndarray, way: np.ndarray, reach: float = 0.7, min_path: float = 20.0) -> np.ndarray:
    """Rows (k, 2) of vertices (earlier, later), each with the nearest of every visit within `reach` m.

    `way` (n,) are metres driven: a place counts as left after `min_path` of them. Rows of nan in `truth` are not known.
    """
    pairs = []
    for later in range(len(truth)):
        n_left = int(np.searchsorted(way, way[later] - min_path, side="right"))
        distances = np.hypot(*(truth[:n_left, :2] - truth[later, :2]).T)
        pairs += [(earlier, later) for earlier in nearest_of_visits(distances, reach)]
    return np.array(pairs, np.int64).reshape(-1, 2)


def oracle_path(odometry: np.ndarray, truth: np.ndarray, motion: MotionParams, seed: int) -> np.ndarray:
    """Vertices (n, 3) of `odometry` (n, 3) refined with the loops of the true poses (n, 3), nan where not known."""
    pairs = true_loops(truth, path_length(odometry))
    noise = np.random.default_rng(seed).normal(size=(len(pairs), 3)) * LOOP_SIGMAS
    motions = compose(between(truth[pairs[:, 0]], truth[pairs[:, 1]]), noise)
    precisions = np.broadcast_to(np.diag(LOOP_SIGMAS**-2.0), (len(pairs), 3, 3))
    problem = Problem(
        Chain.along(odometry), motion, [LoopEdges(pairs, motions, precisions)], np.zeros(len(truth), complex), 0.5
    )
    known = np.flatnonzero(np.isfinite(truth[:, 0]))
    return descend(problem, correct(odometry, known, truth[known]), np.zeros(3), STEPS)[0]  # only the minimum counts
