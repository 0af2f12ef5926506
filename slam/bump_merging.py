"""One map of several carts' recordings of an area, none of which knew where it began.

A map's frame in the best one's is found by the walls' shape: two walls of one laid on two of the other that meet at a
like angle give a pose, which is judged by how the carts' contacts lie on each other's walls. Where a second pose,
unlike the first, does nearly as well, the map is ambiguous, as that of a rectangle is, and it says so. Then all runs
are refined as one: their poses, and the walls that they share.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.bump_bundle import Legs
from slam.bump_mapper import BumpMap
from slam.bump_refinement import BumpRefinementParams, Refined, legs_of, refine, tell
from slam.bump_swarm import HITS, PHI, Model, X, Y
from slam.bump_walls import stretches, walls_of
from slam.cart_odometry import Stage
from slam.params import Params
from slam.pose import compose, transform, wrap

LEAST_SHARED = 0.7  # of the contacts that must lie on the other's walls
LEAST_FELT = 0.02  # of all bumps that make a wall of the merged map


class BumpMergingParams(Params):
    """How frames are found."""

    angle: float = Field(default=0.2, gt=0.0)  # rad by which two walls' angle may differ in two maps
    near: float = Field(default=0.04, gt=0.0)  # m from a wall at which a contact counts half
    unlike_turn: float = Field(default=0.35, gt=0.0)  # rad, and
    unlike_way: float = Field(default=0.15, gt=0.0)  # m by which a second pose differs from the first
    doubtful: float = Field(default=0.95, gt=0.0, le=1.0)  # of the first's score, from which the second makes doubt
    n_judged: int = Field(default=60, ge=1)  # poses that are judged in full
    refinement: BumpRefinementParams = Field(default_factory=lambda: BumpRefinementParams(steps=20, rounds=4))


class Frame(NamedTuple):
    """Where a map lies in another: pose (3,), share of contacts on each other's walls, and the next unlike pose's."""

    pose: np.ndarray
    score: float
    second: float


class MergedMap(NamedTuple):
    """Walls as curves in the frame of map `reference`; where each cart's map lies there, and what is doubtful.

    `left_out` are the maps that lie nowhere, `doubtful` those that lie as well elsewhere; `nodes` of all other carts'
    runs are in `frames`' order of carts.
    """

    reference: int
    frames: list[Frame]
    left_out: list[int]
    doubtful: list[int]
    walls: list[np.ndarray]
    lines: np.ndarray
    nodes: list[np.ndarray]


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


def candidates(one: BumpMap, other: BumpMap, params: BumpMergingParams) -> np.ndarray:
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


def pairs_of(area: BumpMap) -> list[tuple[float, float, np.ndarray]]:
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


def frame_of(one: BumpMap, other: BumpMap, params: BumpMergingParams) -> Frame:
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
        if len(judged) == params.n_judged // 4:
            break
    polished = sorted((polish(pose, score) for _, pose in judged), key=lambda each: -each[0])
    best, pose = polished[0]
    second = max((each for each, at in polished if not is_like(at, pose, params, 1.0)), default=0.0)
    return Frame(pose, best, second)


def is_like(one: np.ndarray, other: np.ndarray, params: BumpMergingParams, share: float) -> bool:
    """Whether two poses are as good as the same, to a share of what makes them unlike."""
    turn = abs(float(wrap(one[2] - other[2])))
    way = math.hypot(*(one[:2] - other[:2]))
    return turn < share * params.unlike_turn and way < share * params.unlike_way


def polish(pose: np.ndarray, score) -> tuple[float, np.ndarray]:
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


def merge(
    runs: Sequence[Sequence[Stage]],
    maps: Sequence[BumpMap],
    model: Model,
    params: BumpMergingParams | None = None,
) -> MergedMap:
    """One map of runs and what `BumpMapper.refine` made of each; ValueError where there is none."""
    if not runs or len(runs) != len(maps):
        raise ValueError(f"{len(maps)} maps of {len(runs)} runs; give each run its map, and at least one")
    params = params or BumpMergingParams()
    reference = min(range(len(maps)), key=lambda cart: maps[cart].cost / max(1, len(maps[cart].contacts)))
    frames = [
        Frame(np.zeros(3), 1.0, 0.0) if cart == reference else frame_of(maps[reference], area, params)
        for cart, area in enumerate(maps)
    ]
    left_out = [cart for cart, frame in enumerate(frames) if frame.score < LEAST_SHARED]
    doubtful = [
        cart
        for cart, frame in enumerate(frames)
        if cart not in left_out and frame.second > params.doubtful * frame.score
    ]
    carts = [reference, *(cart for cart in range(len(runs)) if cart != reference and cart not in left_out)]
    legs, bumpers, start = together(runs, maps, frames, carts, model)
    state = refine(legs, bumpers, start, model, (1e-6, 1e-6), params.refinement)
    lines = state.lines[state.lines[:, HITS] >= max(2.0, LEAST_FELT * np.sum(bumpers > 0))]
    counts = [len(maps[cart].nodes) for cart in carts]
    nodes = dict(zip(carts, np.split(state.nodes, np.cumsum(counts)[:-1]), strict=True))
    return MergedMap(
        reference, frames, left_out, doubtful, walls_of(lines), lines,
        [nodes.get(cart, np.zeros((0, 3))) for cart in range(len(runs))],
    )  # fmt: skip


def together(
    runs: Sequence[Sequence[Stage]],
    maps: Sequence[BumpMap],
    frames: Sequence[Frame],
    carts: Sequence[int],
    model: Model,
) -> tuple[Legs, np.ndarray, Refined]:
    """Runs one after the other as if of one cart that is lifted in between, and where to begin to refine them.

    Each cart's counts are corrected by its own biases, which stay as they were found. Walls that the bumps of carts so
    far do not tell of are added as the carts come.
    """
    lines = maps[carts[0]].lines
    stages, bounds, lasts, lifted, bumpers, nodes, felt = [], [], [], [], [], [], []
    offset = 0
    for cart in carts:
        area = maps[cart]
        legs, closed = legs_of(runs[cart])
        placed = compose(frames[cart].pose, area.nodes)
        told, lines = told_of(area, placed[1::2], closed, lines, frames[cart].pose, model)
        stages.append(corrected(legs.stages, area.biases, model))
        bounds.append(legs.bounds + offset)
        offset += len(legs.stages)
        lasts += [legs.slips_last, [False]]
        lifted += [np.zeros(len(legs.bounds) - 1, bool), [True]]
        bumpers.append(closed)
        nodes.append(placed)
        felt.append(told)
    return (
        Legs(
            np.concatenate(stages), np.concatenate(bounds), np.concatenate(lasts)[:-1],
            np.concatenate(lifted)[:-1],
        ),
        np.concatenate(bumpers),
        Refined(np.concatenate(nodes), np.concatenate(felt), lines, np.zeros(2), 0.0),
    )  # fmt: skip


def told_of(
    area: BumpMap, bumped: np.ndarray, closed: np.ndarray, lines: np.ndarray, pose: np.ndarray, model: Model
) -> tuple[np.ndarray, np.ndarray]:
    """Which of `lines` (n, 10) the bumps of a map at a pose felt, -1 for none; and the lines, with its own new.

    A wall of the map is the line that most of its bumps would be told of, and if that is not half of them a new one.
    """
    if not np.any(area.felt >= 0) or np.array_equal(lines, area.lines):
        return area.felt.copy(), lines
    near = np.full(len(closed), -1)
    tell(bumped, closed, lines, model._replace(contact=3.0 * model.contact), near)
    told = np.full(len(closed), -1)
    for j in range(len(area.lines)):
        own = area.felt == j
        votes = np.bincount(near[own & (near >= 0)], minlength=1)
        if 2 * votes.max() >= np.sum(own) > 0:
            told[own] = int(np.argmax(votes))
        elif np.sum(own) > 1:
            told[own] = len(lines)
            lines = np.vstack([lines, moved_line(area.lines[j], pose)])
    return told, lines


def corrected(stages: np.ndarray, biases: np.ndarray, model: Model) -> np.ndarray:
    """Stages (s, 3) whose counts, no longer whole, have biases in them."""
    left, right = stages[:, 1], stages[:, 2]
    way = 0.5 * (left + right)
    difference = (right - left) * (1.0 + biases[0]) + biases[1] * way * model.wheelbase
    return np.column_stack([stages[:, 0], way - 0.5 * difference, way + 0.5 * difference])


def moved_line(line: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """A line (10,) of another frame."""
    moved = line.copy()
    moved[[X, Y]] = transform(pose, line[[X, Y]])
    moved[PHI] = line[PHI] + pose[2]
    return moved
