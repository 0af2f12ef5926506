"""Least squares over the runs of many carts that share their walls, and nothing else.

Given the walls the carts know nothing of each other, so that each one's poses and biases are summed out by itself
(Schur's complement; along a chain of poses in linear time): what is left of a cart is what its run tells of the walls,
and of these the sum is solved. Time and memory grow as the number of carts. Uses its siblings `bump_bundle` for what a
run costs, `bump_refinement` for telling which wall was met, `bump_swarm`, `pose` and `pose_graph`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.bump_bundle import BumpBundle, Legs
from slam.bump_refinement import legs_of
from slam.bump_swarm import BEYOND, HIGH, HITS, LOW, PHI, Model, innovation
from slam.cart_odometry import Stage
from slam.pose import wrap
from slam.pose_graph import Terms, assemble

LEAST_GAIN = 1e-4  # of the cost; a step that gains less is the last one of its descent
OUTERMOST = 0.01  # of a wall's contacts, which do not say how far it reaches: with many some are another wall's
APART = 0.15  # m without a contact that may part two walls on one line,
RARE = 7.0  # if it is so many times the mean way between contacts; by chance e^-7 of all gaps are


class Member(NamedTuple):
    """A cart's run: legs and switches (t,) of t drives, what its kernels go by, and the biases' standard deviations."""

    legs: Legs
    bumpers: np.ndarray
    model: Model
    spreads: tuple[float, float]

    @classmethod
    def of(cls, stages: Sequence[Stage], model: Model, spreads: tuple[float, float]) -> Member:
        """The member that a run's stages make."""
        return cls(*legs_of(stages), model, spreads)


class Track(NamedTuple):
    """Where a cart went: poses `nodes` (2 t, 3), the wall `felt` (t,) after each drive or -1, and its `biases` (2,)."""

    nodes: np.ndarray
    felt: np.ndarray
    biases: np.ndarray


class Told(NamedTuple):
    """What one run says, its poses (n, 3) and biases summed out: normal equations of the walls, and the way back.

    `by_poses` (3 n, 3 + 2 m) are the chain's solutions for gradient, biases and walls; `complement` and `gradient` are
    of biases and walls.
    """

    by_poses: np.ndarray
    complement: np.ndarray
    gradient: np.ndarray

    def of_walls(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrix (2 m, 2 m) and gradient (2 m,)."""
        across = np.linalg.solve(self.complement[:2, :2], np.column_stack([self.complement[:2, 2:], self.gradient[:2]]))
        mixed = self.complement[2:, :2]
        return self.complement[2:, 2:] - mixed @ across[:, :-1], self.gradient[2:] - mixed @ across[:, -1]

    def back(self, walls: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Changes of poses (n, 3) and biases (2,) where the walls change so (2 m,)."""
        biases = -np.linalg.solve(self.complement[:2, :2], self.gradient[:2] + self.complement[:2, 2:] @ walls)
        moved = -self.by_poses[:, 0] - self.by_poses[:, 1:] @ np.concatenate([biases, walls])
        return moved.reshape(-1, 3), biases


@njit(cache=True)
def solve_chain(diagonal, off_diagonal, right):
    """Solve a symmetric system of blocks (n, 3, 3) and their followers (n - 1, 3, 3) in place of `right` (n, 3, w)."""
    n = diagonal.shape[0]
    inverse = np.empty((n, 3, 3))
    pivot = diagonal[0].copy()
    for i in range(n):
        if i > 0:
            carried = np.ascontiguousarray(off_diagonal[i - 1].T) @ inverse[i - 1]
            pivot = diagonal[i] - carried @ off_diagonal[i - 1]
            right[i] -= carried @ right[i - 1]
        inverse[i] = np.linalg.inv(pivot)
    right[n - 1] = inverse[n - 1] @ right[n - 1]
    for i in range(n - 2, -1, -1):
        right[i] = inverse[i] @ (right[i] - off_diagonal[i] @ right[i + 1])


def told_by(poses: np.ndarray, terms: Terms, border, damping: float) -> Told:
    """A run's normal equations at poses (n, 3), reduced to biases and walls; the diagonals grow by a share."""
    diagonal, off_diagonal = border.pose_hessians.copy(), np.empty((len(terms.first), 3, 3))
    gradient = border.pose_gradients.copy()
    assemble(poses, terms.first, terms.second, terms.gradients, terms.hessians, diagonal, off_diagonal, gradient)
    diagonal[:, range(3), range(3)] += damping * diagonal[:, range(3), range(3)] + 1e-9
    right = np.ascontiguousarray(np.concatenate([gradient[:, :, None], border.mixed], axis=2))
    solve_chain(diagonal, off_diagonal, right)
    right, mixed = right.reshape(3 * len(poses), -1), border.mixed.reshape(3 * len(poses), -1)
    return Told(right, border.hessian - mixed.T @ right[:, 1:], border.gradient - mixed.T @ right[:, 0])


def bundles_of(members: Sequence[Member], tracks: Sequence[Track], lines: np.ndarray) -> list[BumpBundle]:
    """The costs of all runs for one telling."""
    found = []
    for member, track in zip(members, tracks, strict=True):
        at_nodes = np.full(len(track.nodes), -1)
        at_nodes[1::2] = track.felt
        found.append(BumpBundle(member.legs, at_nodes, lines, member.model, member.spreads))
    return found


def descend_together(
    members: Sequence[Member], tracks: Sequence[Track], lines: np.ndarray, steps: int, is_fixed: bool = False
) -> tuple[list[Track], np.ndarray, float]:
    """Tracks, lines (m, 10) and cost after at most `steps` of Levenberg and Marquardt; the cost never rises.

    Lines that are fixed stay where they are.
    """
    bundles = bundles_of(members, tracks, lines)
    states = [(track.nodes, track.biases) for track in tracks]
    walls = lines[:, [PHI, BEYOND]].reshape(-1)

    def linearize(states, walls):
        return [
            bundle.linearize(nodes, np.concatenate([biases, walls]))
            for bundle, (nodes, biases) in zip(bundles, states, strict=True)
        ]

    parts = linearize(states, walls)
    cost, damping = sum(part[0] for part in parts), 1e-6
    for _ in range(steps):
        told = [
            told_by(nodes, terms, border, damping) for (nodes, _), (_, terms, border) in zip(states, parts, strict=True)
        ]
        reduced = [each.of_walls() for each in told]
        matrix = np.sum([each for each, _ in reduced], axis=0)
        matrix[np.diag_indices_from(matrix)] *= 1.0 + damping
        change = -np.linalg.solve(matrix, np.sum([each for _, each in reduced], axis=0))
        change *= not is_fixed
        trial = []
        for (nodes, biases), each in zip(states, told, strict=True):
            moved, biases_change = each.back(change)
            nodes = nodes + moved
            nodes[:, 2] = wrap(nodes[:, 2])
            trial.append((nodes, biases + biases_change))
        parts_there = linearize(trial, walls + change)
        found = sum(part[0] for part in parts_there)
        if not found < cost:
            damping = max(1e-3, damping) * 10.0
            continue
        gain = cost - found
        states, walls, cost, parts = trial, walls + change, found, parts_there
        damping *= 0.1
        if gain < LEAST_GAIN * abs(cost):
            break
    lines = lines.copy()
    lines[:, PHI], lines[:, BEYOND] = walls[0::2], walls[1::2]
    tracks = [track._replace(nodes=nodes, biases=biases) for track, (nodes, biases) in zip(tracks, states, strict=True)]
    return tracks, lines, cost


def places_felt(
    lines: np.ndarray, members: Sequence[Member], tracks: Sequence[Track]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """For each of lines (m, 10) where along it bumps felt it (k,), and how far beyond it they were (k,), in m."""
    places: list[list[float]] = [[] for _ in lines]
    beyond: list[list[float]] = [[] for _ in lines]
    for member, track in zip(members, tracks, strict=True):
        for pose, j in zip(track.nodes[1::2], track.felt, strict=True):
            if j >= 0:
                off, _, _, place = innovation(lines[j], pose, member.model)
                places[j].append(place)
                beyond[j].append(off)
    return [np.array(each) for each in places], [np.array(each) for each in beyond]


def felt_extents(lines: np.ndarray, members: Sequence[Member], tracks: Sequence[Track]) -> np.ndarray:
    """Lines (m, 10) with where they were felt, and how often; contacts that lie apart from the others do not count."""
    lines = lines.copy()
    for line, places in zip(lines, places_felt(lines, members, tracks)[0], strict=True):
        line[HITS] = len(places)
        if len(places):
            own = together(np.sort(places))
            outer = int(OUTERMOST * len(own))
            line[LOW], line[HIGH] = own[[outer, len(own) - 1 - outer]]
    return lines


def together(places: np.ndarray) -> np.ndarray:
    """Of sorted places (n,) the most that have no gap between them, as they hardly would if they were one wall's."""
    low, high = np.quantile(places, [0.1, 0.9])
    gap = max(APART, RARE * float(high - low) / (0.8 * len(places)))
    pieces = np.split(places, np.flatnonzero(np.diff(places) > gap) + 1)
    return max(pieces, key=len)
