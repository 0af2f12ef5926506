"""Least squares over a run of bumps: poses before and after each drive, the lines of walls, and two biases.

What odometry errs by between two poses is one of four: as a rule little; more, where a bump slipped or turned the
cart; much, where its bumper did not feel the wall at once; or anything, where a wall hindered a turn. A bump lies on
its wall, or is a stray. Costs are the logs of these mixtures; gradients are exact, second derivatives those of the
mixtures' quadratic majorants.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.bump_swarm import Model, support
from slam.cart_odometry import TURN, turn_variance, way_variance
from slam.pose_graph import Border, Terms, relative_jacobians

NUDGE = 1e-5  # m or rad by which derivatives are found
SIDEWAYS = 0.002  # m that wheels slide sideways
KINDS = 4  # of errors: little, a slip, a turn that was hindered, a drive that went on at a wall
FLATNESS = 0.02  # rad that a bumper flat against a wall is off it
UNKNOWN = 1e-3  # inverse variance of how far a wall is that nothing is known of
STRAY_SHARE = 5e-4  # of a bump's greatest likelihood at a wall, that a stray has


class Legs(NamedTuple):
    """Stages (s, 3) of kind and ticks; leg l between nodes l and l + 1 is stages `bounds[l]` to `bounds[l + 1]`.

    Legs are drives and what lies between them, in turn; `slips_last` (legs,) tells which ended at a wall.
    """

    stages: np.ndarray
    bounds: np.ndarray
    slips_last: np.ndarray


@njit(cache=True)
def composed(stages, biases, model, way_off, turn_off, at, out):
    """Fill `out` (3,) with the motion of stages one after the other, of which stage `at` is off by so much."""
    out[:] = 0.0
    for s in range(stages.shape[0]):
        left, right = model.tick * stages[s, 1], model.tick * stages[s, 2]
        way = 0.5 * (left + right)
        turn = (right - left) / model.wheelbase * (1.0 + biases[0]) + (model.veer + biases[1]) * way
        if s == at:
            way += way_off
            turn += turn_off
        chord = way * (math.sin(0.5 * turn) / (0.5 * turn) if abs(turn) > 1e-9 else 1.0)
        out[0] += chord * math.cos(out[2] + 0.5 * turn)
        out[1] += chord * math.sin(out[2] + 0.5 * turn)
        out[2] += turn


@njit(cache=True)
def motions_of(legs, biases, model, motions, by_biases):
    """Fill the legs' motions (l, 3) and their derivatives (l, 3, 2) by the biases."""
    moved, off = np.empty(3), np.empty(2)
    for leg in range(legs.bounds.size - 1):
        part = legs.stages[legs.bounds[leg] : legs.bounds[leg + 1]]
        composed(part, biases, model, 0.0, 0.0, -1, motions[leg])
        for b in range(2):
            off[:] = biases
            off[b] += NUDGE
            composed(part, off, model, 0.0, 0.0, -1, moved)
            for axis in range(3):
                by_biases[leg, axis, b] = (moved[axis] - motions[leg, axis]) / NUDGE


@njit(cache=True)
def covariances_of(legs, model, covariances):
    """Fill the covariances (3, l, 3, 3) of the legs' motions for each kind of error."""
    moved, base, none = np.empty(3), np.empty(3), np.zeros(2)
    jacobian = np.empty((3, 2))
    covariances[:] = 0.0
    blur = 0.4 * model.tick  # of counts of whole ticks
    for leg in range(legs.bounds.size - 1):
        part = legs.stages[legs.bounds[leg] : legs.bounds[leg + 1]]
        composed(part, none, model, 0.0, 0.0, -1, base)
        for s in range(part.shape[0]):
            left, right = model.tick * part[s, 1], model.tick * part[s, 2]
            way, turn = 0.5 * (left + right), (right - left) / model.wheelbase
            composed(part, none, model, NUDGE, 0.0, s, moved)
            jacobian[:, 0] = (moved - base) / NUDGE
            composed(part, none, model, 0.0, NUDGE, s, moved)
            jacobian[:, 1] = (moved - base) / NUDGE
            for kind in range(KINDS):
                by_way = way_variance(way, model) + blur**2
                by_turn = turn_variance(way, turn, model) + 2.0 * (blur / model.wheelbase) ** 2
                if kind == 2 and part[s, 0] == TURN:
                    by_way += model.slip_distance**2
                    by_turn += turn * turn / 3.0  # of what is evenly between nothing and all of it
                for r in range(3):
                    for c in range(3):
                        covariances[kind, leg, r, c] += by_way * jacobian[r, 0] * jacobian[c, 0]
                        covariances[kind, leg, r, c] += by_turn * jacobian[r, 1] * jacobian[c, 1]
        for kind in range(KINDS):
            covariances[kind, leg, 0, 0] += SIDEWAYS**2
            covariances[kind, leg, 1, 1] += SIDEWAYS**2
            covariances[kind, leg, 2, 2] += SIDEWAYS**2
            if kind > 0 and legs.slips_last[leg]:
                distance, turn = model.slip_distance, model.slip_turn
                if kind == 3:
                    distance, turn = model.drag_distance, model.drag_turn
                covariances[kind, leg, 0, 0] += distance**2
                covariances[kind, leg, 1, 1] += distance**2
                covariances[kind, leg, 2, 2] += turn**2


@njit(cache=True)
def motion_terms(poses, motions, by_biases, precisions, log_shares, terms, border):
    """Cost of the legs between poses (n, 3); adds its derivatives by relative poses and by both biases."""
    cost = 0.0
    by_a, by_b = np.empty((3, 3)), np.empty((3, 3))
    error, logs = np.empty(3), np.empty(KINDS)
    for leg in range(poses.shape[0] - 1):
        a, b = poses[leg], poses[leg + 1]
        relative_jacobians(a, b, by_a, by_b)
        cos, sin = math.cos(a[2]), math.sin(a[2])
        dx, dy = b[0] - a[0], b[1] - a[1]
        error[0] = cos * dx + sin * dy - motions[leg, 0]
        error[1] = -sin * dx + cos * dy - motions[leg, 1]
        error[2] = b[2] - a[2] - motions[leg, 2]
        error[2] -= 2.0 * math.pi * math.floor(error[2] / (2.0 * math.pi) + 0.5)
        top = -np.inf
        for kind in range(KINDS):
            logs[kind] = log_shares[kind, leg] - 0.5 * np.sum(error * (precisions[kind, leg] @ error))
            top = max(top, logs[kind])
        total = np.sum(np.exp(logs - top))
        cost -= top + math.log(total)
        held = np.zeros((3, 3))
        for kind in range(KINDS):
            held += math.exp(logs[kind] - top) / total * precisions[kind, leg]
        pull = held @ error
        terms.hessians[leg] = held
        terms.gradients[leg] = pull
        moved = held @ by_biases[leg]
        border.gradient[:2] -= by_biases[leg].T @ pull
        border.hessian[:2, :2] += by_biases[leg].T @ moved
        border.mixed[leg, :, :2] -= by_a.T @ moved
        border.mixed[leg + 1, :, :2] -= by_b.T @ moved
    return cost


@njit(cache=True)
def contact_terms(poses, felt, anchors, shared, model, border):
    """Cost of the bumps at the walls that were felt at nodes (n,), -1 for none; adds its derivatives.

    Of `shared`, 2 + 2 j is the direction of wall j and 3 + 2 j how far beyond its anchor it is.
    """
    cost = 0.0
    by = np.empty(5)  # derivatives by x, y and heading of the pose, by direction and distance of the wall
    for k in range(poses.shape[0]):
        j = felt[k]
        if j < 0:
            continue
        phi = shared[2 + 2 * j]
        cos, sin = math.cos(phi), math.sin(phi)
        dx, dy = poses[k, 0] - anchors[j, 0], poses[k, 1] - anchors[j, 1]
        delta = poses[k, 2] - phi
        reach, slope = support(delta, model)
        off = cos * dx + sin * dy + reach - shared[3 + 2 * j]
        density = math.exp(-0.5 * (off / model.contact) ** 2)
        cost -= math.log(density + STRAY_SHARE)
        weight = density / (density + STRAY_SHARE) / model.contact**2
        by[0], by[1], by[2], by[3], by[4] = cos, sin, slope, -sin * dx + cos * dy - slope, -1.0
        add(k, j, by, weight, off, border)
        delta -= 2.0 * math.pi * math.floor(delta / (2.0 * math.pi) + 0.5)
        if abs(delta) < 3.0 * model.flat and model.flat_share > 0.0:  # it may have turned the cart square to the wall
            density = model.flat_share * math.exp(-0.5 * (delta / FLATNESS) ** 2)
            rest = (1.0 - model.flat_share) * FLATNESS / model.flat
            cost -= math.log(density / rest + 1.0)
            by[0], by[1], by[2], by[3], by[4] = 0.0, 0.0, 1.0, -1.0, 0.0
            add(k, j, by, density / (density + rest) / FLATNESS**2, delta, border)
    return cost


@njit(cache=True)
def add(k, j, by, weight, off, border):
    """Add the square of what is `off`, with derivatives (5,) by pose k and wall j."""
    for r in range(3):
        border.pose_gradients[k, r] += weight * by[r] * off
        for c in range(3):
            border.pose_hessians[k, r, c] += weight * by[r] * by[c]
        for w in range(2):
            border.mixed[k, r, 2 + 2 * j + w] += weight * by[r] * by[3 + w]
    for w in range(2):
        border.gradient[2 + 2 * j + w] += weight * by[3 + w] * off
        for v in range(2):
            border.hessian[2 + 2 * j + w, 2 + 2 * j + v] += weight * by[3 + w] * by[3 + v]


class BumpBundle:
    """What `slam.pose_graph.descend` makes less, for one telling of which wall each node's bump felt.

    `felt` (n,) are rows of `lines` (m, 10), or -1; the lines' directions are a prior of their own. `spreads` are the
    standard deviations of the biases. Lines that are `held` (m,) stay where they are.
    """

    def __init__(
        self, legs: Legs, felt: np.ndarray, lines: np.ndarray, model: Model, spreads: tuple[float, float],
        held: np.ndarray | None = None,
    ):  # fmt: skip
        self.legs, self.felt, self.model = legs, felt, model
        self.held = np.zeros(0, np.int64) if held is None else 2 + np.flatnonzero(np.repeat(held, 2))
        self.anchors, self.directions = np.ascontiguousarray(lines[:, :2]), lines[:, 2].copy()
        n_legs = len(legs.bounds) - 1
        covariances = np.empty((KINDS, n_legs, 3, 3))
        covariances_of(legs, model, covariances)
        self.precisions = np.linalg.inv(covariances)
        shares = np.array([0.0, model.slip_share, model.stuck_share, model.drag_share])
        shares[0] = 1.0 - np.sum(shares)
        log_shares = np.log(shares)[:, None] + 0.5 * np.linalg.slogdet(self.precisions)[1]
        self.log_shares = log_shares - np.logaddexp.reduce(log_shares, axis=0)  # a motion without error costs nothing
        self.spreads = np.array(spreads)

    def linearize(self, poses: np.ndarray, shared: np.ndarray) -> tuple[float, Terms, Border]:
        """Cost at poses (n, 3) and `shared`, the biases and each wall's direction and distance, and its derivatives."""
        n_legs, n_walls = len(poses) - 1, len(self.anchors)
        border = Border.zeros(len(poses), len(shared))
        motions, by_biases = np.empty((n_legs, 3)), np.empty((n_legs, 3, 2))
        motions_of(self.legs, shared[:2], self.model, motions, by_biases)
        rows = np.arange(n_legs)
        terms = Terms(rows, rows + 1, np.zeros((n_legs, 3)), np.zeros((n_legs, 3, 3)))
        cost = motion_terms(poses, motions, by_biases, self.precisions, self.log_shares, terms, border)
        cost += contact_terms(poses, self.felt, self.anchors, shared, self.model, border)
        off = np.concatenate([shared[:2], shared[2::2] - self.directions])
        weights = np.concatenate([self.spreads**-2.0, np.full(n_walls, self.model.direction**-2.0)])
        at = np.concatenate([[0, 1], 2 + 2 * np.arange(n_walls)])
        border.gradient[at] += weights * off
        border.hessian[at, at] += weights
        border.hessian[3::2, 3::2] += UNKNOWN * np.eye(n_walls)
        border.gradient[self.held] = border.mixed[:, :, self.held] = 0.0
        border.hessian[self.held] = border.hessian[:, self.held] = 0.0
        border.hessian[self.held, self.held] = 1.0
        return cost + 0.5 * float(np.sum(weights * off**2)), terms, border
