"""Comparison: the nearest earlier vertices are those that sorting finds, and what is kept of a vertex stays."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.comparison import (
    COHORT,
    ComparisonParams,
    Observations,
    keep_nearest,
    pair_affinity,
    path_affinity,
    room_for_cells,
    rule_of,
)
from slam.walls import Walls
from tests.naive import affinity as naive_affinity
from tests.naive import comparison as naive
from tests.naive.walls import cast, rectangle

ROOM = np.vstack([rectangle(0.0, 0.0, 3.2, 2.4), rectangle(0.0, 0.0, 0.8, 0.5)])
REACH, N_RAYS = 1.0, 60


def params_of(kind="points", **changes):
    """Comparison parameters that do not follow the defaults."""
    affinity = {"kind": kind, "states": 3, "n_points": 32, "spread": 0.6, "gain": 3.0, "label_cell": 0.05}
    return ComparisonParams.model_validate({"neighbours": 3, "range": 0.8, "gap": 5, "affinity": affinity} | changes)


def wandering(seed, n=40):
    """A path (n, 3) that keeps coming back."""
    rng = np.random.default_rng(seed)
    turns = rng.uniform(-0.9, 0.9, n).cumsum()
    steps = 0.4 * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return np.column_stack([1.4 * np.sin(steps.cumsum(axis=0)), turns])


def observed(path, params):
    """Walls of each vertex and the observations made of them."""
    walls = [cast(pose, ROOM, N_RAYS, REACH) for pose in path]
    observations = Observations(params, REACH)
    for seen in walls:
        observations.add(seen)
    return walls, observations


@settings(max_examples=200)
@given(st.lists(st.floats(0.0, 10.0), max_size=30), st.integers(1, 6))
def test_keeping_the_nearest_is_sorting(squares, n_kept):
    near, where = np.full((2, n_kept), 8.0), np.full((2, n_kept), -1)
    for item, square in enumerate(squares):
        keep_nearest(near, where, 1, square, item)
    within = [item for item, square in enumerate(squares) if square < 8.0]
    expected = sorted(within, key=lambda item: squares[item])[:n_kept]  # of equals the first come first
    missing = n_kept - len(expected)
    assert where.tolist() == [[-1] * n_kept, expected + [-1] * missing]
    assert near.tolist() == [[8.0] * n_kept, [squares[item] for item in expected] + [8.0] * missing]


@pytest.mark.parametrize("kind", ["points", "segments"])
@pytest.mark.parametrize("seed", range(3))
def test_a_paths_affinity_agrees_with_comparing_everything(kind, seed):
    params, path = params_of(kind), wandering(seed)
    walls, observations = observed(path, params)
    believed = wandering(seed + 10)
    rule = observations.rule

    def score(a, b):
        if kind == "points":
            labels = observations.labels
            mean = naive_affinity.point_affinity(labels[a], labels[b], believed[a], believed[b], rule.pattern)
        else:
            scale = params.affinity.segment_scale
            mean = naive_affinity.segment_affinity(walls[a], walls[b], believed[a], believed[b], scale)
        return rule.gain * mean

    for first in (0, 17):
        expected = naive.path_affinity(believed, first, rule, score)
        found = path_affinity(believed, first, observations.seen, rule)
        assert found == pytest.approx(expected, abs=1e-9)
        assert abs(expected) > 1e-3


@pytest.mark.parametrize("seed", range(3))
def test_affinity_is_additive_over_vertices(seed):
    path = wandering(seed)
    _, observations = observed(path, params_of())
    seen, rule = observations.seen, observations.rule
    whole = path_affinity(path, 0, seen, rule)
    for cut in (3, 11, 30):
        parts = path_affinity(path[:cut], 0, seen, rule) + path_affinity(path, cut, seen, rule)
        assert parts == pytest.approx(whole, abs=1e-9)


def pair_of(observations, a, pose_a, b, pose_b):
    xa, ya, theta_a = pose_a
    xb, yb, theta_b = pose_b
    rule = observations.rule
    return pair_affinity(observations.seen, rule, a, xa, ya, theta_a, b, xb, yb, theta_b, room_for_cells(rule))


@pytest.mark.parametrize(("vertices", "is_compared"), [(4, False), (5, False), (6, True), (9, True)])
def test_vertices_too_near_on_the_path_are_not_compared(vertices, is_compared):
    """All vertices stand at one place; with a gap of 5 the sixth is the first to be compared with the first."""
    path = np.zeros((vertices, 3))
    _, observations = observed(path, params_of(gap=5, neighbours=8))
    found = path_affinity(path, 0, observations.seen, observations.rule)
    pairs = sum(max(0, newest - 5 + 1) for newest in range(vertices))
    assert (found != 0.0) == is_compared
    assert found == pytest.approx(pairs * pair_of(observations, 0, (0.0, 0.0, 0.0), 1, (0.0, 0.0, 0.0)))


@pytest.mark.parametrize(("distance", "is_compared"), [(0.0, True), (0.79, True), (0.81, False), (30.0, False)])
def test_vertices_too_far_apart_are_not_compared(distance, is_compared):
    path = np.zeros((6, 3))
    path[1:5, 1] = 50.0
    path[5, 0] = distance
    _, observations = observed(np.zeros((6, 3)), params_of(gap=5, range=0.8))
    found = path_affinity(path, 0, observations.seen, observations.rule)
    assert (found != 0.0) == is_compared


def test_only_the_nearest_few_count():
    path = np.zeros((12, 3))
    path[:7, 0] = 0.1 * np.arange(7)
    path[7:11, 1] = 50.0
    _, observations = observed(np.zeros((12, 3)), params_of(neighbours=3))
    expected = sum(pair_of(observations, 11, path[11], other, path[other]) for other in (0, 1, 2))
    found = path_affinity(path, 11, observations.seen, observations.rule)
    assert found == pytest.approx(expected)


def test_a_greater_gain_is_a_proportional_weight():
    path = wandering(4)
    totals = []
    for gain in (1.0, 4.0):
        affinity = params_of().affinity.model_copy(update={"gain": gain})
        _, observations = observed(path, params_of(affinity=affinity))
        totals.append(path_affinity(path, 0, observations.seen, observations.rule))
    assert totals[1] == pytest.approx(4.0 * totals[0])
    assert totals[0] > 0.0


@pytest.mark.parametrize("kind", ["points", "segments"])
def test_what_was_kept_stays_when_the_store_grows(kind):
    rng = np.random.default_rng(5)
    poses = rng.uniform(-0.2, 0.2, (150, 3)) + [0.0, 0.8, 0.0]
    _, observations = observed(poses[:60], params_of(kind))
    kept = observations.labels if kind == "points" else observations.segments
    before, capacity = kept[:60].copy(), len(kept)
    for pose in poses[60:]:
        observations.add(cast(pose, ROOM, N_RAYS, REACH))
    kept = observations.labels if kind == "points" else observations.segments
    assert observations.n_vertices == 150
    assert len(kept) >= 150 > capacity
    np.testing.assert_array_equal(kept[:60], before)
    _, alone = observed(poses[140:], params_of(kind))
    np.testing.assert_array_equal(kept[140:150], (alone.labels if kind == "points" else alone.segments)[:10])


def test_the_raster_holds_the_reach_and_the_walls_behind_it():
    for reach in (1.0, 2.0, 3.3):
        observations = Observations(params_of(), reach)
        assert observations.size * 0.05 >= 2.0 * (reach + params_of().affinity.wall_thickness)
        sigma = params_of().affinity.spread * reach
        pattern = observations.rule.pattern
        assert math.isclose(np.std([pattern.x, pattern.y]) * pattern.cell, sigma, rel_tol=0.1)


# Chance


@pytest.mark.parametrize("seed", range(3))
def test_what_chance_scores_is_the_median_of_the_best_ways_to_lay_walls_of_elsewhere(seed):
    params = params_of(chance=0.6)
    _, seen = observed(wandering(seed), params)
    plain, cells = rule_of(params_of(), REACH), room_for_cells(seen.rule)

    def score(a, pose_a, b, pose_b):
        xa, ya, theta_a = pose_a
        xb, yb, theta_b = pose_b
        return pair_affinity(seen.seen, plain, a, xa, ya, theta_a, b, xb, yb, theta_b, cells) / plain.gain

    for newest in range(seen.n_vertices):
        n_earlier = newest + 1 - seen.rule.gap
        if n_earlier <= 0:
            assert seen.chances[newest] == 0.0, "there is no elsewhere yet"
            continue
        others = sorted({int(other) for other in np.linspace(0, n_earlier - 1, COHORT)})
        assert seen.chances[newest] == pytest.approx(naive.chance(newest, others, score), abs=1e-6)


def test_a_share_of_chance_is_taken_off_each_pair():
    path = wandering(5)
    _, seen = observed(path, params_of(chance=0.6))
    rules = rule_of(params_of(), REACH), rule_of(params_of(chance=0.6), REACH)
    for newest in range(10, 40, 3):
        xa, ya, theta_a = path[newest]
        xb, yb, theta_b = path[newest - 9]
        plain, wary = (
            pair_affinity(seen.seen, rule, newest, xa, ya, theta_a, newest - 9, xb, yb, theta_b, room_for_cells(rule))
            for rule in rules
        )
        assert plain - wary == pytest.approx(0.6 * rules[0].gain * seen.chances[newest])


def test_like_corridors_score_much_by_chance_and_a_place_of_its_own_little():
    angles = 2.0 * np.pi * np.arange(N_RAYS) / N_RAYS
    sides = 0.6 / np.maximum(1e-3, np.abs(np.sin(angles)))
    corridor = Walls(np.where(sides < REACH, sides, np.inf), np.minimum(sides, REACH))
    niche = cast(np.array([0.1, 0.2, 0.3]), rectangle(0.0, 0.0, 0.9, 0.7), N_RAYS, REACH)
    seen = Observations(params_of(chance=0.6), REACH)
    for walls in [corridor] * 20 + [niche]:
        seen.add(walls)
    assert seen.chances[19] > 0.2
    assert 0.0 <= seen.chances[20] < 0.5 * seen.chances[19]
