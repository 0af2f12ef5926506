"""What is suggested is to go back to where it began, by the short way, and nothing where all is certain."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.path_filter import PathFilter, PathFilterParams
from slam.pose import between, compose, wrap
from slam.suggestions import SuggestionParams, gains, sampled_paths, suggest
from slam.uncertainty import Branches
from slam.wall_direction import DirectionParams
from tests.slam.drives import REACH, laps

PARAMS = SuggestionParams()
NOISE = (0.1, 0.1, 0.1)


def horseshoe(n_paths=200, side=8.0, seed=0):
    """Paths (m, v, 3) along three sides of a square with drifting headings; they end 8 m from where they began."""
    rng = np.random.default_rng(seed)
    truth = []
    for heading, start in ((0.0, (0.0, 0.0)), (0.5 * math.pi, (side, 0.0)), (math.pi, (side, side))):
        steps = np.arange(0.0, side, 0.5)
        truth += [(start[0] + s * math.cos(heading), start[1] + s * math.sin(heading), heading) for s in steps]
    poses = np.repeat(np.array(truth[:1]), n_paths, axis=0)
    paths = [poses]
    for a, b in zip(np.array(truth[:-1]), np.array(truth[1:]), strict=True):
        motions = np.repeat(between(a, b)[None], n_paths, axis=0) + rng.normal(0.0, [0.01, 0.0, 0.03], (n_paths, 3))
        paths.append(compose(paths[-1], motions))
    return np.stack(paths, axis=1)


def branches_of(paths):
    """Branches that share nothing but the root."""
    n, v = paths.shape[:2]
    rows = np.arange(n * (v - 1)).reshape(n, v - 1) + 1
    parents = np.column_stack([np.zeros(n, int), rows[:, :-1]])
    return Branches(
        np.vstack([paths[:1, 0], paths[:, 1:].reshape(-1, 3)]),
        np.concatenate([[-1], parents.ravel()]),
        np.concatenate([[0], np.tile(np.arange(1, v), n)]),
    )


def test_branches_give_back_the_paths():
    paths = horseshoe(5)
    np.testing.assert_allclose(sampled_paths(branches_of(paths)), paths)


def test_the_start_settles_most_and_the_newest_vertex_nothing():
    gained = gains(horseshoe(), NOISE)
    assert gained[0] > 0.9 * gained.max() > 0.2
    assert gained[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.all(gained >= -1e-9)


def test_gains_are_what_conditioning_on_the_place_leaves():
    """Of many paths, those that agree with one another about the start's place differ by what the gain promises."""
    paths = horseshoe(40_000)
    promised = gains(paths, NOISE)[0]
    seen = between(paths[:, -1], paths[:, 0])
    seen[:, 2] = wrap(seen[:, 2] - math.pi)  # it ends turned about
    weights = np.exp(-0.5 * np.sum(((seen - seen.mean(axis=0)) / NOISE) ** 2, axis=1))
    weights /= weights.sum()
    places = paths[..., :2]
    before = np.sqrt(np.var(places, axis=0).sum(axis=1))
    mean = np.einsum("m,mvk->vk", weights, places)
    after = np.sqrt(np.einsum("m,mvk->v", weights, (places - mean) ** 2))
    is_uncertain = before >= 0.5 * before.max()
    assert promised == pytest.approx(np.mean((before - after)[is_uncertain]), rel=0.15)


def test_a_near_start_is_suggested_and_a_far_one_is_not():
    paths = horseshoe()
    path = paths.mean(axis=0)
    near = suggest(path, branches_of(paths), np.hypot(*(path[:, :2] - path[-1, :2]).T), PARAMS)
    assert near[0].vertex <= 4
    assert near[0].gain > 0.2
    assert [place.gain / (place.drive + PARAMS.fixed_way) for place in near] == sorted(
        (place.gain / (place.drive + PARAMS.fixed_way) for place in near), reverse=True
    )
    far = np.full(len(path), PARAMS.farthest + 1.0)
    assert suggest(path, branches_of(paths), far, PARAMS) == []


def test_places_that_are_named_stand_apart():
    paths = horseshoe()
    path = paths.mean(axis=0)
    named = suggest(path, branches_of(paths), np.ones(len(path)), PARAMS)
    assert 2 <= len(named) <= PARAMS.most
    for k, one in enumerate(named):
        assert all(math.dist(one.place, other.place) >= PARAMS.apart for other in named[:k])


def test_a_certain_path_needs_nothing():
    path = horseshoe(1)[0]
    same = np.repeat(path[None], 4, axis=0)
    assert suggest(path, branches_of(same), np.ones(len(path)), PARAMS) == []


def test_a_closed_lap_is_worth_less_than_an_open_one():
    drive = laps(n_laps=1.2, turn_bias=0.01, seed=4)
    path_filter = PathFilter(PathFilterParams(particles=400, reach=REACH, direction=DirectionParams(gain=0.0)), seed=2)
    greatest = []
    for pose, walls, travelled in zip(drive.odometry, drive.walls, drive.travelled, strict=True):
        path_filter.extend(pose, walls, travelled)
        branches = path_filter.uncertainty(64).branches
        assert branches is not None
        greatest.append(gains(sampled_paths(branches), NOISE).max())
    assert greatest[drive.lap - 4] > 2.0 * greatest[-1]
