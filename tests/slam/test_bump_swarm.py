"""Kernels of the map from bumps: what a bumper reaches, what a bump teaches of a wall, what drives rule out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.bump_mapper import BumpMapper, BumpMapperParams
from slam.bump_swarm import (
    BEYOND,
    COLUMNS,
    HIGH,
    HITS,
    LOW,
    PHI,
    VAR_PHI,
    advance,
    begin_line,
    chord_pieces,
    innovation,
    learn,
    moved,
    passed,
    sided,
    support,
    was_free,
)  # fmt: skip
from slam.cart_odometry import DRIVE, TURN, CartParams, arc, bumper_points
from slam.counter_random import vertex_key
from slam.pose import compose
from tests.naive import bumps_felt as naive

CART = CartParams()
MODEL = BumpMapperParams().model(CART)


@pytest.mark.parametrize("delta", [-1.2, -0.3, -1e-3, 1e-3, 0.2, 0.9, 7.0])
def test_the_bumpers_reach_is_that_of_its_farther_end(delta):
    reach, slope = support(delta, MODEL)
    assert reach == pytest.approx(naive.support(delta, MODEL.half_width, MODEL.ahead), abs=1e-12)
    ahead, behind = (naive.support(delta + off, MODEL.half_width, MODEL.ahead) for off in (1e-6, -1e-6))
    if abs(math.sin(delta)) > 1e-2:
        assert slope == pytest.approx((ahead - behind) / 2e-6, abs=1e-5)


def bump_at(phi: float, beyond: float, along: float, heading: float) -> np.ndarray:
    """A cart that touches the wall n(phi) . x = beyond with an end of its bumper."""
    outward, side = np.array([math.cos(phi), math.sin(phi)]), np.array([-math.sin(phi), math.cos(phi)])
    place = outward * (beyond - support(heading - phi, MODEL)[0]) + side * along
    return np.array([*place, heading])


@pytest.mark.parametrize("phi", [0.0, 1.0, -2.5])
def test_bumps_teach_a_walls_direction_and_place(phi):
    rng = np.random.default_rng(3)
    line = np.zeros(COLUMNS)
    begin_line(line, bump_at(phi, 1.3, 0.4, phi + 0.5), MODEL)
    for _ in range(30):
        learn(line, bump_at(phi, 1.3, rng.uniform(-0.6, 0.6), phi + rng.uniform(-0.9, 0.9)), MODEL)
    assert line[PHI] == pytest.approx(phi, abs=4.0 * math.sqrt(line[VAR_PHI]) + 0.005)
    assert math.sqrt(line[VAR_PHI]) < 0.01
    assert line[HITS] == 31
    for along in (-0.5, 0.0, 0.5):
        off = innovation(line, bump_at(phi, 1.3, along, phi + 0.3), MODEL)[0]
        assert abs(off) < 0.006
    assert 1.0 < line[HIGH] - line[LOW] < 1.3


def test_what_a_bump_is_off_depends_on_a_walls_direction_as_told():
    line = np.zeros(COLUMNS)
    begin_line(line, bump_at(0.3, 1.0, 0.0, 0.5), MODEL)
    pose = bump_at(0.3, 1.1, 0.4, 0.1)
    before, by_phi, _, _ = innovation(line, pose, MODEL)
    line[PHI] += 1e-6
    assert (innovation(line, pose, MODEL)[0] - before) / 1e-6 == pytest.approx(by_phi, abs=1e-5)
    line[BEYOND] += 0.01
    assert innovation(line, pose, MODEL)[0] == pytest.approx(before - 0.01, abs=1e-5)


@pytest.mark.parametrize(("phi", "beyond"), [(0.0, 1.0), (2.0, 0.5)])
def test_only_drives_through_the_felt_part_of_a_wall_are_ruled_out(phi, beyond):
    line = np.zeros(COLUMNS)
    begin_line(line, bump_at(phi, beyond, 0.0, phi), MODEL)
    for along in (-0.2, 0.0, 0.2) * 3:
        learn(line, bump_at(phi, beyond, along, phi + 0.2), MODEL)
    outward, side = np.array([math.cos(phi), math.sin(phi)]), np.array([-math.sin(phi), math.cos(phi)])
    through = np.array([*(outward * (beyond - 0.3)), *(outward * (beyond + 0.2))])
    assert passed(line, through)
    assert not passed(line, through[[2, 3, 0, 1]]), "inward it is another wall"
    assert not passed(line, through + np.tile(0.6 * side, 2)), "where nothing was felt there may be a door"
    assert not passed(line, np.array([*(outward * (beyond - 0.3)), *(outward * (beyond - 0.01))]))


def test_free_is_what_drives_passed_well_over():
    rng = np.random.default_rng(5)
    pieces = rng.uniform(-0.5, 0.5, (6, 4))
    answers = []
    for spot in rng.uniform(-0.6, 0.6, (60, 2)):
        is_free = bool(was_free(pieces, len(pieces), spot[0], spot[1], MODEL))
        assert is_free == naive.was_free(pieces, spot, MODEL.half_width, MODEL.contact), spot
        answers.append(is_free)
    assert 0 < sum(answers) < 60


def test_chords_lie_along_the_bumpers_way():
    start, end = np.array([0.2, -0.1, 0.5]), np.array([0.2, -0.1, 0.5])
    end = compose(start, arc(400, 450, CART))
    pieces = np.zeros((2, 4))
    chord_pieces(start, end, pieces, 0, MODEL)
    halfway = compose(start, arc(200, 225, CART))
    middles = bumper_points(np.array([start, halfway, end]), CART)[:, 1]
    np.testing.assert_allclose(pieces, [[*middles[0], *middles[1]], [*middles[1], *middles[2]]], atol=1e-9)


def test_motion_is_the_arc_with_noise_about_it():
    """Of 4,000 particles the mean is the arc, but for turns that a wall hindered, whose weights make up for them."""
    ends, weights = np.empty((4000, 3)), np.empty(4000)
    for p in range(len(ends)):
        weights[p] = math.exp(moved(np.zeros(3), np.zeros(2), np.array([TURN, -30.0, 30.0]), False,
                                    vertex_key(1, 2), p, 8, MODEL, ends[p])[0])  # fmt: skip
    assert weights.mean() == pytest.approx(1.0, abs=0.05)
    turn = arc(-30, 30, CART)[2]
    usual = weights > 1.0
    assert np.mean(usual) == pytest.approx(1.0 - MODEL.stuck_tried, abs=0.03)
    assert ends[usual, 2].mean() == pytest.approx(turn, abs=0.01)
    assert ends[~usual, 2].mean() == pytest.approx(0.5 * turn, abs=0.07)
    told = arc(500, 520, CART)
    for veer in (0.0, -0.3):
        for p in range(len(ends)):
            moved(np.zeros(3), np.array([0.1, 0.2]), np.array([DRIVE, 500.0, 520.0]), False, vertex_key(1, 2), p, 8,
                  MODEL._replace(veer=veer), ends[p])  # fmt: skip
        assert ends[:, 2].mean() == pytest.approx(1.1 * told[2] + (0.2 + veer) * 510 * CART.tick, abs=0.01)


def test_a_bump_that_is_not_felt_at_once_drags_the_cart():
    """As many try it as shall, weights make up for it, and they went less far and turned more than was counted."""
    n, stage = 4000, np.array([DRIVE, 500.0, 500.0])
    ends, weights, dragged = np.empty((n, 3)), np.empty(n), np.empty(n, bool)
    for p in range(n):
        gained, dragged[p] = moved(np.zeros(3), np.zeros(2), stage, True, vertex_key(1, 2), p, 8, MODEL, ends[p])
        weights[p] = math.exp(gained)
    assert weights.mean() == pytest.approx(1.0, abs=0.05)
    assert dragged.mean() == pytest.approx(MODEL.drag_tried, abs=0.03)
    assert np.sum(weights[dragged]) / np.sum(weights) == pytest.approx(MODEL.drag_share, abs=0.02)
    way = 500.0 * CART.tick
    assert np.all(ends[dragged, 0] < way + 0.05)
    assert np.mean(ends[dragged, 0] < way - 0.5 * MODEL.drag_distance) > 0.4
    assert np.std(ends[dragged, 2]) == pytest.approx(MODEL.drag_turn, rel=0.1)
    assert np.std(ends[~dragged, 2]) < 0.15
    aside = (
        ends[dragged, 1] * ends[dragged, 2]
    )  # it slides to the side that the wall leads to, away from where it turns
    assert np.mean(aside < 0.0) > 0.6
    free = [moved(np.zeros(3), np.zeros(2), stage, False, vertex_key(1, 2), p, 8, MODEL, ends[p]) for p in range(200)]
    assert free == [(0.0, False)] * 200


def test_switches_tell_the_side_of_a_wall():
    assert sided(0.5, 2) == 1.0
    assert sided(-0.5, 1) > 0.99 > 0.01 > sided(0.5, 1)
    assert sided(0.5, 4) > 0.99 > 0.01 > sided(-0.5 + 2.0 * math.pi, 4)


def after_a_bump(tries: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights (n,) and poses (n, 3) of particles that knew the wall x = 0.5 well, and bumped where it is."""
    mapper = BumpMapper(CART, BumpMapperParams(n_particles=20_000, n_islands=1, tries=tries), seed=5)
    line = np.zeros(COLUMNS)
    begin_line(line, bump_at(0.0, 0.5, 0.0, 0.2), MODEL)
    for along in np.linspace(-0.4, 0.4, 20):
        learn(line, bump_at(0.0, 0.5, along, 0.5 * along), MODEL)
    mapper.swarm.lines[:, 0], mapper.swarm.n_lines[:] = line, 1
    count = (0.5 - MODEL.ahead) / MODEL.tick
    advance(mapper.swarm, np.array([[DRIVE, count, count]]), 2, 0, 5, 0, mapper.model)
    return np.exp(mapper.swarm.log_weights), mapper.swarm.poses


def test_more_tries_estimate_the_same_with_less_spread():
    (one, poses), (many, others) = after_a_bump(1), after_a_bump(8)
    error = math.hypot(*(np.std(weights) / math.sqrt(len(weights)) for weights in (one, many)))
    assert abs(np.mean(one) - np.mean(many)) < 4.0 * error
    first, second = (np.average(at, axis=0, weights=weights) for at, weights in ((poses, one), (others, many)))
    assert first == pytest.approx(second, abs=2e-3)
    assert np.var(many) < 0.25 * np.var(one)
