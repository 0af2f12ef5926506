"""Greedy local search that lays the whole path anew for every perturbation and judges all of it."""

from __future__ import annotations

import numpy as np

from tests.naive import counter_random, motion

WHERE, SIZE, ANGLE_STEP, DISTANCE_STEP = 16, 17, 18, 19  # streams


def lay(start, motions, travelled, corrections, noise):
    """The path that starts at a pose and is corrected so."""
    path = [np.asarray(start, float)]
    for step, way, (angle, distance) in zip(motions[1:], travelled[1:], corrections[1:], strict=True):
        path.append(motion.moved_pose(path[-1], step, way, noise, angle, distance, 0.0, 0.0))
    return path


def likelihood(path, corrections, affinity):
    """Plausibility of the corrections and the whole map's affinity with itself."""
    return -0.5 * float(np.sum(np.square(corrections))) + affinity(path)


def search(start, motions, travelled, corrections, noise, affinity, n_tries, sizes, seed):
    """Better corrections (n, 2) than those given, and how many perturbations were kept."""
    n, kept = len(motions), 0
    corrections = np.array(corrections)
    best = likelihood(lay(start, motions, travelled, corrections, noise), corrections, affinity)
    for attempt in range(n_tries):
        vertex = 1 + int(counter_random.uniform(seed, n, attempt, WHERE) * (n - 1))
        size = sizes[0] * (sizes[1] / sizes[0]) ** counter_random.uniform(seed, n, attempt, SIZE)
        trial = corrections.copy()
        trial[vertex, 0] += size * counter_random.gaussian(seed, n, attempt, ANGLE_STEP)
        trial[vertex, 1] += size * counter_random.gaussian(seed, n, attempt, DISTANCE_STEP)
        value = likelihood(lay(start, motions, travelled, trial, noise), trial, affinity)
        if value > best:
            best, corrections, kept = value, trial, kept + 1
    return corrections, kept
