"""Choose which particles have children. Weights are kept as logarithms and normalised where they are read."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


def normalize(log_weights: np.ndarray) -> np.ndarray:
    """Weights (n,) that sum to one, proportional to exp(log_weights).

    Minus infinity is a particle that cannot be; where all are, nothing is known of any and the weights are equal.
    Raises ValueError for an empty set, for nan and for plus infinity.
    """
    log_weights = np.asarray(log_weights, float)
    if log_weights.size == 0:
        raise ValueError("no particles to normalise")
    greatest = np.max(log_weights)
    if np.isnan(greatest) or greatest == np.inf:
        raise ValueError(f"log weights must be numbers or minus infinity; one is {greatest}")
    if greatest == -np.inf:
        return np.full(log_weights.size, 1.0 / log_weights.size)
    with np.errstate(over="ignore"):  # differences beyond the range of a double are as good as minus infinity
        weights = np.exp(log_weights - greatest)
    return weights / np.sum(weights)


def entropy(weights: np.ndarray) -> float:
    """Bits of entropy of the weights: H = -sum w log2 w, from 0 to log2 N (Crunch thesis, 2.7)."""
    carried = weights[weights > 0.0]
    return max(0.0, -float(np.sum(carried * np.log2(carried))))


def effective_particles(weights: np.ndarray) -> float:
    """2^H: how many equal weights would have the same entropy, from 1 to N (Crunch thesis, 2.7)."""
    return 2.0 ** entropy(weights)


def effective_sample_size(weights: np.ndarray) -> float:
    """1 / sum w^2, the other measure of degeneracy (Kong, Liu and Wong 1994); never more than effective_particles."""
    return 1.0 / float(np.sum(np.square(weights)))


BLOCK = 4096  # weights that are summed together, so that sums do not depend on who does which part


@njit(cache=True, nogil=True)
def exponentials(log_weights, greatest, weights, sums, low, high):
    """exp(log_weights - greatest) for the blocks low..high of 4096 weights, and each block's two sums (blocks, 2).

    The sums are of the weights w and of w log w, whose entropy is log W - (sum w log w) / W with W their sum.
    """
    for block in range(low, high):
        total, weighted = 0.0, 0.0
        for p in range(block * BLOCK, min((block + 1) * BLOCK, log_weights.size)):
            below = log_weights[p] - greatest
            weight = math.exp(below)
            weights[p] = weight
            total += weight
            if weight > 0.0:
                weighted += weight * below
        sums[block, 0], sums[block, 1] = total, weighted


@njit(cache=True)
def systematic(weights, offset, n_children=-1):
    """Ancestor of each child, ascending; as many children as weights unless told otherwise.

    `offset` in [0, 1) is the only random input. Of M children a particle of weight w gets floor(M w) or ceil(M w), up
    to the round-off of the running sum, and one of weight zero gets none.
    """
    n = weights.size
    if n_children < 0:
        n_children = n
    last = n - 1
    while last > 0 and weights[last] <= 0.0:  # the last parent that can have children takes round-off
        last -= 1
    ancestors = np.empty(n_children, np.int32)
    parent = 0
    covered = weights[0]
    for child in range(n_children):
        pointer = (child + offset) / n_children
        while pointer >= covered and parent < last:
            parent += 1
            covered += weights[parent]
        ancestors[child] = parent
    return ancestors
