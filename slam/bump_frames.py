"""Where one map of bumps lies in another, by the walls' shape.

Two walls of one laid on two of the other that meet at a like angle give a pose, which is judged by how contacts lie on
each other's walls. Where a second pose, unlike the first, does nearly as well, the map is ambiguous, as that of a
rectangle is. `agreed` is the largest set of maps whose frames agree with each other. Uses its siblings `bump_swarm`,
`bump_walls` and `pose`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit
from pydantic import Field

from slam.bump_swarm import HITS, PHI, X, Y
from slam.bump_walls import stretches
from slam.params import Params
from slam.pose import compose, inverse, transform, wrap


class Felt(Protocol):
    """What is known of an area: lines (m, 10) as in `slam.bump_swarm`, and points (n, 2) where a bumper touched."""

    @property
    def lines(self) -> np.ndarray: ...
    @property
    def contacts(self) -> np.ndarray: ...


class BumpFrameParams(Params):
    """How frames are found."""

    angle: float = Field(default=0.2, gt=0.0)  # rad by which two walls' angle may differ in two maps
    near: float = Field(default=0.04, gt=0.0)  # m from a wall at which a contact counts half
    unlike_turn: float = Field(default=0.35, gt=0.0)  # rad, and
    unlike_way: float = Field(default=0.15, gt=0.0)  # m by which a second pose differs from the first
    doubtful: float = Field(default=0.95, gt=0.0, le=1.0)  # of the first's score, from which the second makes doubt
    n_judged: int = Field(default=15, ge=1)  # poses that are judged in full
    least_shared: float = Field(default=0.7, gt=0.0, le=1.0)  # of the contacts that must lie on the other's walls
    agreeing_turn: float = Field(default=0.1, gt=0.0)  # rad, and
    agreeing_way: float = Field(default=0.08, gt=0.0)  # m by which frames may differ around a loop of three maps


class Frame(NamedTuple):
    """Where a map lies in another: pose (3,), share of contacts on each other's walls, and the next unlike pose's."""

    pose: np.ndarray
    score: float
    second: float


@njit(cache=True)
def near_share(points, segments, pose, near):
    """Mean of 1 / (1 + (d / near)^2) over points (n, 2) at a pose, d their distance from segments (m, 4)."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    total = 0.0
    for k in range(points.shape[0]):
        x = pose[0] + cos * points[k, 0] - sin * points[k, 1]
        y = pose[1] + sin * points[k, 0] + cos * points[k, 1]
        least = np.inf
        for j in range(segments.shape[0]):
            ux, uy = segments[j, 2] - segments[j, 0], segments[j, 3] - segments[j, 1]
            px, py = x - segments[j, 0], y - segments[j, 1]
            at = (ux * px + uy * py) / max(ux * ux + uy * uy, 1e-12)
            at = min(max(at, 0.0), 1.0)
            least = min(least, (px - at * ux) ** 2 + (py - at * uy) ** 2)
        total += 1.0 / (1.0 + least / near**2)
    return total / points.shape[0]


def candidates(one: Felt, other: Felt, params: BumpFrameParams) -> np.ndarray:
    """Poses (n, 3) of the other map in the first that lay two walls of it on two of the first."""
    poses = [np.zeros((0, 3))]
    pairs = pairs_of(other)
    for phi_1, phi_2, corner in pairs_of(one):
        for own_1, own_2, own_corner in pairs:
            turn_1, turn_2 = float(wrap(phi_1 - own_1)), float(wrap(phi_2 - own_2))
            if abs(float(wrap(turn_1 - turn_2))) < params.angle:
                heading = turn_1 + 0.5 * float(wrap(turn_2 - turn_1))
                turned = transform(np.array([0.0, 0.0, heading]), own_corner)
                poses.append(np.array([[*(corner - turned), heading]]))
    return np.concatenate(poses)


def pairs_of(area: Felt) -> list[tuple[float, float, np.ndarray]]:
    """Pairs of walls that are not parallel: their outward directions, and where their lines cross."""
    lines = area.lines[area.lines[:, HITS] > 1.0]
    outward = np.column_stack([np.cos(lines[:, PHI]), np.sin(lines[:, PHI])])
    beyond = np.sum(outward * lines[:, [X, Y]], axis=1) + lines[:, 3]
    found = []
    for i in range(len(lines)):
        for j in range(len(lines)):
            if i != j and abs(math.sin(lines[i, PHI] - lines[j, PHI])) > 0.3:
                corner = np.linalg.solve(outward[[i, j]], beyond[[i, j]])
                found.append((float(lines[i, PHI]), float(lines[j, PHI]), corner))
    return found


def frame_of(one: Felt, other: Felt, params: BumpFrameParams) -> Frame:
    """Where the other map lies in the first; a score of 0 where nothing fits."""
    walls, own = stretches(one.lines), stretches(other.lines)
    if not len(walls) or not len(own) or not len(one.contacts) or not len(other.contacts):
        return Frame(np.zeros(3), 0.0, 0.0)

    def score(pose: np.ndarray) -> float:
        back = np.array([*transform(np.array([0.0, 0.0, -pose[2]]), -pose[:2]), -pose[2]])
        there = near_share(other.contacts, walls, pose, params.near)
        return 0.5 * (there + near_share(one.contacts, own, back, params.near))

    poses = candidates(one, other, params)
    if not len(poses):
        return Frame(np.zeros(3), 0.0, 0.0)
    scores = np.array([score(pose) for pose in poses])
    judged: list[tuple[float, np.ndarray]] = []
    for row in np.argsort(-scores, kind="stable"):
        if any(is_like(poses[row], pose, params, 0.3) for _, pose in judged):
            continue
        judged.append((float(scores[row]), poses[row]))
        if len(judged) == params.n_judged:
            break
    polished = sorted((polish(pose, score) for _, pose in judged), key=lambda each: -each[0])
    best, pose = polished[0]
    second = max((each for each, at in polished if not is_like(at, pose, params, 1.0)), default=0.0)
    return Frame(pose, best, second)


def is_like(one: np.ndarray, other: np.ndarray, params: BumpFrameParams, share: float) -> bool:
    """Whether two poses are as good as the same, to a share of what makes them unlike."""
    turn = abs(float(wrap(one[2] - other[2])))
    way = math.hypot(*(one[:2] - other[:2]))
    return turn < share * params.unlike_turn and way < share * params.unlike_way


def polish(pose: np.ndarray, score: Callable[[np.ndarray], float]) -> tuple[float, np.ndarray]:
    """The best pose near one, by steps along each axis that become shorter, and its score."""
    best = score(pose)
    steps = np.array([0.03, 0.03, 0.05])
    while steps[0] > 0.002:
        is_better = False
        for axis in range(3):
            for side in (-1.0, 1.0):
                trial = pose.copy()
                trial[axis] += side * steps[axis]
                found = score(trial)
                if found > best + 1e-9:
                    best, pose, is_better = found, trial, True
        if not is_better:
            steps = 0.5 * steps
    return best, pose


def agreed(areas: Sequence[Felt], params: BumpFrameParams) -> tuple[list[int], list[np.ndarray]]:
    """Rows of the most maps whose frames agree, around every loop of three, and their poses in the first of them.

    Of sets as large the one whose rows come first is taken, so that maps should come best first.
    """
    n = len(areas)
    frames = {(i, j): frame_of(areas[i], areas[j], params) for i in range(n) for j in range(i + 1, n)}
    pairs = {pair for pair, frame in frames.items() if frame.score >= params.least_shared}

    def closes(i: int, j: int, k: int) -> bool:
        around = compose(compose(frames[i, j].pose, frames[j, k].pose), inverse(frames[i, k].pose))
        return abs(float(wrap(around[2]))) < params.agreeing_turn and math.hypot(*around[:2]) < params.agreeing_way

    found = [(row,) for row in range(n)]  # sets of one size, in order; each grows by maps behind its last
    while True:
        larger = [
            (*rows, new)
            for rows in found
            for new in range(rows[-1] + 1, n)
            if all((row, new) in pairs for row in rows)
            and all(closes(i, j, new) for i, j in itertools.combinations(rows, 2))
        ]
        if not larger:
            break
        found = larger
    best = list(found[0])
    return best, [np.zeros(3), *(frames[best[0], row].pose for row in best[1:])]
