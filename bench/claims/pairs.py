"""Affinities of two vertices at chosen poses, by what the library shows of itself: observations and the local search.

A search that tries nothing and compares two vertices is their affinity.
"""

from __future__ import annotations

import time
from typing import Literal, NamedTuple

import numpy as np

from slam.affinity import AffinityParams, gaussian_points
from slam.comparison import ComparisonParams, Observations
from slam.local_search import LocalSearch, LocalSearchParams
from slam.pose import between, compose, inverse, transform
from slam.walls import Walls

Kind = Literal["segments", "points, 2 states", "points, 3 states"]
KINDS: tuple[Kind, ...] = ("segments", "points, 2 states", "points, 3 states")
ROUNDS = 60  # of which the fastest is a time


class Pairs(NamedTuple):
    """Label rasters (k, size, size) of pairs of vertices, and the second's pose (k, 3) in the first's frame."""

    labels_a: np.ndarray
    labels_b: np.ndarray
    motions: np.ndarray


def params_of(kind: Kind) -> AffinityParams:
    """The default's parameters, but for the kind; two states count agreement and disagreement as the thesis does."""
    if kind == "segments":
        return AffinityParams(kind="segments")
    if kind == "points, 2 states":
        return AffinityParams(states=2, both_free=1.0, both_wall=1.0, differ=-1.0)
    return AffinityParams()


def path_of(poses: np.ndarray, walls: list[Walls], comparison: ComparisonParams, reach: float) -> LocalSearch:
    """A path that stays as it is, and knows its affinity."""
    search = LocalSearch(LocalSearchParams(perturbations=0, reach=reach, comparison=comparison))
    for pose, seen in zip(poses, walls, strict=True):
        search.extend(pose, seen)
    return search


def affinity(params: AffinityParams, walls_a: Walls, walls_b: Walls, motion: np.ndarray, reach: float) -> float:
    """Affinity of two vertices when b stands at `motion` (3,) in a's frame, without the tempering."""
    gain = params.gain if params.kind == "points" else params.segment_gain
    comparison = ComparisonParams(neighbours=1, range=100.0, gap=1, affinity=params)
    poses = np.stack([motion, np.zeros(3)])  # a is the newer one, with which the test points turn
    return path_of(poses, [walls_b, walls_a], comparison, reach).affinity() / gain


def paired(seen: list[tuple[Walls, Walls, np.ndarray, np.ndarray]], params: AffinityParams, reach: float) -> Pairs:
    """Rasters of pairs (walls, walls, pose, pose)."""
    observations = Observations(ComparisonParams(affinity=params), reach)
    for one, other, _, _ in seen:
        observations.add(one)
        observations.add(other)
    labels = observations.labels[: 2 * len(seen)]
    poses_a, poses_b = (np.stack([np.asarray(pair[side], float) for pair in seen]) for side in (2, 3))
    return Pairs(labels[0::2].copy(), labels[1::2].copy(), between(poses_a, poses_b))


def points_of(params: AffinityParams, reach: float, n_points: int = 0) -> np.ndarray:
    """The first test points (m, 2), in m."""
    return gaussian_points(n_points or params.n_points, params.spread * reach)


def point_scores(pairs: Pairs, points: np.ndarray, params: AffinityParams) -> np.ndarray:
    """(k, m) scores of each of `points` (m, 2) alone, which fall around the middle of the two vertices."""
    scores = np.zeros((len(pairs.motions), len(points)))
    for k, motion in enumerate(pairs.motions):
        at_a = 0.5 * motion[:2] + points
        at_b = transform(inverse(motion), at_a)
        a, b = (looked_up(labels[k], at, params) for labels, at in ((pairs.labels_a, at_a), (pairs.labels_b, at_b)))
        is_known = (a != 0) & (b != 0)
        agreed = np.where(a < 0, params.both_free, params.both_wall)
        scores[k] = np.where(is_known, np.where(a == b, agreed, params.differ), 0.0)
    return scores


def looked_up(labels: np.ndarray, points: np.ndarray, params: AffinityParams) -> np.ndarray:
    """Labels (m,) at points (m, 2) of the vertex's frame; unknown beyond the raster."""
    size = len(labels)
    columns, rows = np.floor(points / params.label_cell + 0.5 * size).astype(int).T
    inside = (rows >= 0) & (columns >= 0) & (rows < size) & (columns < size)
    return np.where(inside, labels[rows.clip(0, size - 1), columns.clip(0, size - 1)], 0)


def nanoseconds(poses: np.ndarray, walls: list[Walls], params: AffinityParams, reach: float) -> float:
    """Time for a pair in the affinity of a whole path (n, 3), beyond what it takes to find that no pair is near."""
    near = ComparisonParams(affinity=params)
    none = near.model_copy(update={"range": 1e-6})
    least = [fastest(path_of(poses, walls, comparison, reach)) for comparison in (near, none)]
    return 1e9 * (least[0] - least[1]) / max(1, n_pairs(poses, near))


def fastest(search: LocalSearch) -> float:
    """Seconds that the affinity of a path takes when nothing disturbs it."""
    times = []
    for _ in range(ROUNDS):
        started = time.thread_time()
        search.affinity()
        times.append(time.thread_time() - started)
    return min(times)


def n_pairs(poses: np.ndarray, comparison: ComparisonParams) -> int:
    """How many pairs a path's affinity is the sum of."""
    apart = np.hypot(*(poses[:, None, :2] - poses[None, :, :2]).transpose(2, 0, 1))
    ago = np.subtract.outer(np.arange(len(poses)), np.arange(len(poses)))
    near = (apart < comparison.range) & (ago >= comparison.gap)
    return int(np.minimum(near.sum(axis=1), comparison.neighbours).sum())


def turned_about(pivot: np.ndarray, angle: float) -> np.ndarray:
    """Motion (3,) of a vertex at the origin when it turns about a place (2,)."""
    return compose(np.array([*pivot, angle]), inverse(np.array([*pivot, 0.0])))
