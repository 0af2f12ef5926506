"""Bundling: echoes gathered along a drifting drive fall back onto the walls they came from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.bundle import BundleParams, bundle
from slam.echo_matching import EchoMatches, choose_partners, count_like, sort_cells, wall_normals
from slam.echoes import EchoLog, EchoParams, Sweep, ends_of
from slam.motion import MotionParams
from slam.odometry_chain import Chain
from slam.pose import between, compose, transform
from slam.rangefinder import RingParams
from tests.naive import echo_matching as naive
from tests.server.logs import cast, drive

RING = RingParams(model="beam", bearings_deg=tuple(float(b) for b in range(-90, 91, 18)), max_range=5.0)


def drifting(turn_bias: float = 0.02, noise: float = 0.01, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """True poses (n, 3) of laps in a room, and the same by an odometry that errs."""
    truth = drive(laps=2)
    rng = np.random.default_rng(seed)
    odometry = [truth[0]]
    for motion in between(truth[:-1], truth[1:]):
        error = [0.0, 0.0, turn_bias * math.hypot(*motion[:2]) + noise * rng.normal() * math.hypot(*motion[:2]) ** 0.5]
        odometry.append(compose(odometry[-1], motion + error))
    return truth, np.array(odometry)


def gathered(truth: np.ndarray, odometry: np.ndarray, params: EchoParams):
    """What eleven beams met, hung on the odometry."""
    log = EchoLog(params)
    for row, (true, pose) in enumerate(zip(truth, odometry, strict=True)):
        log.look(row, pose, Sweep("laser", RING, cast(true, RING.bearings), pose))
    return log.echoes()


def worst(poses: np.ndarray, truth: np.ndarray) -> float:
    """Greatest distance (m) from the truth, the first poses being laid over each other."""
    moved = compose(truth[0], between(poses[0], poses))
    return float(np.hypot(*(moved - truth)[:, :2].T).max())


def test_echoes_stand_where_the_walls_are():
    truth = drive(laps=1)
    echoes = gathered(truth, truth, EchoParams())
    points = transform(truth[echoes.rows][echoes.nodes], echoes.points)
    off = np.minimum(abs(abs(points[:, 0]) - 3.0), abs(abs(points[:, 1]) - 2.0))
    assert len(points) > 1000
    assert off.max() < 1e-9
    np.testing.assert_allclose(np.hypot(*echoes.views.T), 1.0)
    assert np.all(np.diff(echoes.nodes) >= 0)


def test_standing_still_counts_once():
    log = EchoLog(EchoParams())
    for row in range(100):
        log.look(row, np.zeros(3), Sweep("laser", RING, np.ones(11), np.zeros(3)))
    assert len(log.echoes().points) == 11
    assert len(log.echoes().rows) == 1


def test_turning_on_the_spot_makes_nodes():
    log = EchoLog(EchoParams())
    for row in range(40):
        pose = np.array([0.0, 0.0, 0.16 * row])
        log.look(row, pose, Sweep("laser", RING, np.ones(11), pose))
    assert len(log.echoes().rows) == 20, "every second sweep, 0.32 rad on"


def test_what_is_no_echo_is_left_out():
    ranges = np.array([np.inf, np.nan, 0.01, 6.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert len(ends_of(Sweep("laser", RING, ranges, np.zeros(3)))[0]) == 7
    leaning = ends_of(Sweep("laser", RING, np.full(11, 1.0), np.zeros(3), tilt=math.radians(12.0)))[0]
    assert len(leaning) < 11, "0.15 m up, a beam that leans by 12 degrees meets the floor before 1 m"


def test_cones_are_not_gathered():
    sonar = RingParams(model="sonar", bearings_deg=(0.0,), half_angle_deg=20.0)
    log = EchoLog(EchoParams())
    log.look(0, np.zeros(3), Sweep("sonar", sonar, np.ones(1), np.zeros(3)))
    assert len(log.echoes().points) == len(log.echoes().rows) == 0


def scattered(seed: int):
    """Echoes of two walls, noisy, some of nothing, with negative coordinates among them."""
    rng = np.random.default_rng(seed)
    wall = np.column_stack([rng.uniform(-2.0, 2.0, 80), 1.0 + rng.normal(0.0, 0.02, 80)])
    other = np.column_stack([-1.0 + rng.normal(0.0, 0.02, 60), rng.uniform(-2.0, 1.0, 60)])
    points = np.concatenate([wall, other, rng.uniform(-2.0, 2.0, (20, 2))])
    views = points / np.hypot(*points.T)[:, None]
    return points, views, np.sort(rng.integers(0, 12, len(points)))


@pytest.mark.parametrize("seed", range(3))
def test_walls_and_partners_agree_with_a_look_at_every_pair(seed):
    points, views, nodes = scattered(seed)
    cells = sort_cells(points, 0.4)
    for window in (3, 100):
        normals = wall_normals(points, views, nodes, cells, 0.35, window)
        np.testing.assert_allclose(normals, naive.wall_normals(points, views, nodes, 0.35, window), atol=1e-9)
    counts, found = np.empty(len(points), np.int64), np.empty((len(points), 200), np.int64)
    count_like(points, normals, nodes, cells, 0.4, 0.9, counts)
    choose_partners(points, normals, nodes, cells, 0.4, 0.9, counts, found)
    expected = naive.partners(points, normals, nodes, 0.4, 0.9)
    assert [set(row[row >= 0].tolist()) for row in found] == expected
    few = np.empty((len(points), 4), np.int64)
    choose_partners(points, normals, nodes, cells, 0.4, 0.9, counts, few)
    for row, all_of_them in zip(few, expected, strict=True):
        chosen = row[row >= 0].tolist()
        assert len(chosen) == len(set(chosen)) == min(4, len(all_of_them))
        assert set(chosen) <= all_of_them


def test_derivatives_are_those_of_the_cost():
    truth, odometry = drifting()
    echoes = gathered(truth, odometry, EchoParams())
    poses = odometry[echoes.rows]
    matches = EchoMatches(echoes, 0.15, 8)
    matches.associate(poses, radius=0.35, window=len(poses), gate=0.4, like=0.9, kernel=1e3)  # nearly squares
    _, terms = matches.terms(poses)
    pair = int(np.argmax(terms.hessians[:, 2, 2]))
    others = np.flatnonzero((matches.first == matches.second[pair]) & (matches.second == matches.first[pair]))
    assert others.size <= 1
    slot = matches.slots == pair
    for attribute in ("matched", "partners"):
        setattr(matches, attribute, getattr(matches, attribute)[slot])
    matches.slots = np.zeros(int(slot.sum()), np.int64)
    matches.first, matches.second = matches.first[[pair]], matches.second[[pair]]
    first, second = int(matches.first[0]), int(matches.second[0])
    relative = between(poses[first], poses[second])
    step = 1e-5
    for axis in range(3):
        costs = []
        for side in (-step, step):
            moved = poses.copy()
            moved[second] = compose(poses[first], relative + side * np.eye(3)[axis])
            costs.append(matches.terms(moved)[0])
        assert terms.gradients[pair, axis] == pytest.approx((costs[1] - costs[0]) / (2 * step), rel=1e-3, abs=1e-3)


def test_a_bent_drive_is_straightened():
    truth, odometry = drifting()
    params = BundleParams(rounds=7)
    echoes = gathered(truth, odometry, params.echoes)
    poses = odometry[echoes.rows]
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(odometry[:, :2], axis=0).T))])[echoes.rows]
    chain = Chain.along(poses, np.diff(way, prepend=0.0))
    # a start as the filter would leave it: half of the drift taken back
    start = compose(truth[echoes.rows], 0.5 * between(truth[echoes.rows], poses))
    assert worst(start, truth[echoes.rows]) > 0.2
    found = bundle(start, chain, echoes, MotionParams(), params)
    assert worst(found.path, truth[echoes.rows]) < 0.06
    assert found.shared[0] == pytest.approx(-0.02, abs=0.01), "the odometry's bias is found on the way"
    again = bundle(start, chain, echoes, MotionParams(), params)
    assert np.array_equal(found.path, again.path)


@pytest.mark.parametrize("seed", range(3))
def test_the_right_path_costs_less_than_one_whose_second_lap_went_elsewhere(seed):
    """Though fewer of the wrong one's echoes match; too few rounds are left for it to come back."""
    truth, odometry = drifting(seed=seed)
    params = BundleParams(rounds=3)
    echoes = gathered(truth, odometry, params.echoes)
    right, half = truth[echoes.rows], len(echoes.rows) // 2
    astray = right.copy()
    astray[half:] = compose(np.array([1.3, 0.9, math.radians(25.0)]), right[half:])
    chain = Chain.along(odometry[echoes.rows])
    found, lost = (bundle(start, chain, echoes, MotionParams(), params) for start in (right, astray))
    assert worst(found.path, right) < 0.1 < 0.3 < worst(lost.path, right)
    assert found.cost < lost.cost - 50.0


def test_nothing_to_bundle_changes_nothing():
    truth, odometry = drifting()
    echoes = gathered(truth, odometry, EchoParams())
    poses = odometry[echoes.rows]
    still = bundle(poses, Chain.along(poses), echoes, MotionParams(), BundleParams(rounds=0))
    assert np.array_equal(still.path, poses)
    one = gathered(truth[:1], odometry[:1], EchoParams())
    assert np.array_equal(
        bundle(poses[:1], Chain.along(poses[:1]), one, MotionParams(), BundleParams()).path, poses[:1]
    )
