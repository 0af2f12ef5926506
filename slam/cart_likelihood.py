"""How likely a cart's bumps, and what a camera above saw of it, are with given parameters: a sum of Gaussian filters.

What a bump was is not known, so that each hypothesis goes on as several: with an end of the bumper at a wall that is
near, in each of the ways in which one may bump; or as a bump of which nothing is believed, behind which the filter
begins anew where it was told. A turn may have been hindered. None is decided for good, and what is told does not depend
on a first guess: decisions that leave errors out which look large make those that remain look small. Uses its siblings
`cart_hypothesis` and `cart_odometry`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from slam.bump_particles import wrapped
from slam.cart_hypothesis import (
    FLAT,
    IS_BUMP,
    KIND,
    OWN,
    SLIPPED,
    STEEPEST,
    alike,
    begin_at,
    look,
    meet,
    roll,
    settle,
    slip_density,
)  # fmt: skip
from slam.cart_odometry import TURN

MOST = 16  # hypotheses that go on from a bump,
ROOM = 6000  # among so many
FAINTEST = 1e-3  # share of the likeliest one below which one is given up,
PALE = 0.05  # and where a camera has made them much the same
ANEW = 0.03  # share of bumps of which nothing is believed,
EVENLY = 1.0  # per m
WILD = np.array([0.05, 0.005])  # shares of stages that go wrong, and altogether
FLATTENS = 0.15  # m of going on that make a cart stand square, in the mean:
PRESSED = 0.002  # of at least so many, for wheels go on a little at any bump


@njit(cache=True)
def bump(means, covariances, weights, n, told, evidence, values):
    """The hypotheses after a bump, from the first n before it; their number and the bump's density, counted in ticks.

    They replace the first rows; their weights add up to one.
    """
    d, n_walls = means.shape[1], evidence.lines.shape[0]
    slip_share, slip_distance = values[10], values[11]
    n_features = 2 * n_walls + evidence.corners.shape[0]
    found = np.zeros((ROOM, 3), np.int64)  # parent, feature, kind
    densities = np.zeros(ROOM)
    count = 0
    slope = np.empty(d)
    for parent in range(n):
        for feature in range(n_features):
            off, cosine, variance, likely = meet(means[parent], covariances[parent], evidence, feature, values, slope)
            if cosine < STEEPEST or likely < 1e-6 or count + 3 > ROOM - 1:
                continue
            size = slip_distance / cosine
            ordinary = math.exp(-0.5 * off * off / variance) / math.sqrt(2.0 * math.pi * variance) * cosine
            slipped = slip_density(off / cosine, math.sqrt(variance) / cosine, size)
            flattens = 1.0 - math.exp(-max(off / cosine, PRESSED) / FLATTENS) if feature < 2 * n_walls else 0.0
            for kind in range(3):
                share = (1.0 - slip_share) * ordinary
                if kind == SLIPPED:
                    share = slip_share * (1.0 - flattens) * slipped
                elif kind == FLAT:
                    share = slip_share * flattens * slipped
                found[count, 0], found[count, 1], found[count, 2] = parent, feature, kind
                densities[count] = (1.0 - ANEW) * weights[parent] * likely * share
                count += 1
    found[count, 0], found[count, 1] = 0, -1  # of which nothing is believed
    densities[count] = ANEW * EVENLY
    count += 1
    total = np.sum(densities[:count])
    order = np.argsort(-densities[:count], kind="mergesort")
    kept = 0
    outcomes, shares = np.empty((MOST, 2), np.int64), np.zeros(MOST)
    middles, offs, squares = np.empty((MOST, d)), np.zeros((MOST, d)), np.zeros((MOST, d, d))
    spreads = np.empty((MOST, 3, 3))
    mean, covariance = np.empty(d), np.empty((d, d))
    for row in order:
        if densities[row] < FAINTEST * densities[order[0]]:
            break
        parent, feature, kind = found[row]
        mean[:], covariance[:] = means[parent], covariances[parent]
        if feature < 0:
            begin_at(mean, covariance, told)
        else:
            settle(mean, covariance, evidence, feature, kind, values, slope)
        own = 0
        while own < kept and not (
            outcomes[own, 0] == feature and outcomes[own, 1] == kind and alike(mean, middles[own], spreads[own])
        ):
            own += 1
        if own == MOST:
            continue
        if own == kept:
            kept += 1
            outcomes[own, 0], outcomes[own, 1] = feature, kind
            middles[own], spreads[own] = mean, covariance[:3, :3]
        off = mean - middles[own]
        off[2] = wrapped(off[2])
        shares[own] += densities[row]
        offs[own] += densities[row] * off
        squares[own] += densities[row] * (covariance + np.outer(off, off))
    for own in range(kept):  # what ended alike, and near, goes on as one, with the spread of all
        off = offs[own] / shares[own]
        means[own] = middles[own] + off
        covariances[own] = squares[own] / shares[own] - np.outer(off, off)
    weights[:kept] = shares[:kept] / np.sum(shares[:kept])
    return kept, total * values[1]


@njit(cache=True)
def run_costs(values, evidence):
    """Less the log likelihood of each stage (n,) of a run, an `Evidence`, with `values` (16,) of `NAMES`."""
    d = evidence.state.size
    means, covariances, weights = np.zeros((3 * MOST, d)), np.zeros((3 * MOST, d, d)), np.zeros(3 * MOST)
    means[0], covariances[0], weights[0] = evidence.state, evidence.covariance, 1.0
    n, costs = 1, np.zeros(evidence.stages.shape[0])
    for own in range(3, OWN):
        covariances[0, own, own] = values[1] ** 2 / 12.0
    if not math.isnan(evidence.first[0]):
        look(means[0], covariances[0], evidence.first, values, evidence.has_frame)
    for row in range(evidence.stages.shape[0]):
        stage = evidence.stages[row]
        is_seen = not math.isnan(evidence.seen[row, 0])
        ways = 3 if is_seen or stage[KIND] == TURN else 1
        if ways == 3 and n > MOST:  # a turn after a drive that met nothing
            n = keep(means, covariances, weights, weights[:n].copy())
        for wildness in range(ways - 1, -1, -1):
            share = WILD[wildness - 1] if wildness else 1.0 - np.sum(WILD)
            for h in range(n):
                row_of = wildness * n + h
                means[row_of], covariances[row_of] = means[h], covariances[h]
                weights[row_of] = (share if ways > 1 else 1.0) * weights[h]
                roll(means[row_of], covariances[row_of], stage, values, wildness)
        n *= ways
        if stage[IS_BUMP] > 0.0 and evidence.lines.shape[0] > 0:
            n, density = bump(means, covariances, weights, n, evidence.told[row], evidence, values)
            costs[row] -= math.log(max(density, 1e-300))
        if is_seen:
            logs = np.empty(n)
            for h in range(n):
                logs[h] = math.log(max(weights[h], 1e-300))
                logs[h] += look(means[h], covariances[h], evidence.seen[row], values, evidence.has_frame)
            top = np.max(logs)
            shares = np.exp(logs - top)
            costs[row] -= top + math.log(np.sum(shares))
            n = keep(means, covariances, weights, shares)
    return costs


@njit(cache=True)
def keep(means, covariances, weights, shares):
    """The likeliest hypotheses go on, with weights that add up to one; their number."""
    order = np.argsort(-shares, kind="mergesort")[:MOST]
    kept = 0
    while kept < order.size and shares[order[kept]] > PALE * shares[order[0]]:
        kept += 1
    order = order[:kept]
    means[:kept], covariances[:kept], weights[:kept] = means[order], covariances[order], shares[order]
    weights[:kept] /= np.sum(weights[:kept])
    return kept
