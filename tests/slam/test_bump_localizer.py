"""Particles that bump: moved and weighed as their twins say, found again, honest about a room that is symmetric."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware.virtual.bumper_cart import CartBuild, run_cart
from firmware.virtual.polygons import closed_outlines
from firmware.virtual.worlds import load_world
from slam.area import area_of, clearance
from slam.bump_localizer import BumpLocalizer, BumpLocalizerParams
from slam.bump_particles import (
    Leg,
    Touch,
    after_bump,
    drive_free,
    drive_to_wall,
    felt_share,
    move,
    start_anywhere,
    way_density,
)  # fmt: skip
from slam.bump_survivors import Survival, Survivors, noise_of
from slam.bumps import drive_until_contact, in_bump_space
from slam.cart_odometry import BACK, DRIVE, LEFT, MIDDLE, RIGHT, TURN, CartParams, Stage, arc, bumper_points
from slam.counter_random import vertex_key
from slam.pose import wrap
from slam.pose_clusters import bins_of, clusters, enough_particles, within
from tests.naive import bump_particles as naive
from tests.naive import bumps as naive_bumps
from tests.slam.cart_areas import CUT, RECTANGLE

CART = CartParams()
TOUCH = Touch(0.09, 0.0381, 0.2, 0.06, 0.1, 0.15)
SURE = Touch(0.09, 0.0381, 0.0, 0.06, 0.0, 1e9)  # bumps that do nothing
KEY = np.uint64(vertex_key(7, 1))
MIDDLE_OF_ROOM = np.array([0.6, 0.5, 0.2])


def test_particles_without_noise_take_the_arc():
    poses, scales = np.tile(MIDDLE_OF_ROOM, (3, 1)), np.array([1.0, 1.1, 0.0])
    move(area_of(RECTANGLE), poses, scales, Leg(-0.2, 0.5, 0.0, 0.0), TOUCH, KEY)
    true = [naive.moved(MIDDLE_OF_ROOM, -0.2, 0.5 * scale) for scale in scales]
    np.testing.assert_allclose(poses, true, atol=1e-6)


def test_noise_has_the_spread_it_is_told():
    poses, scales = np.tile(MIDDLE_OF_ROOM, (4000, 1)), np.ones(4000)
    move(area_of(RECTANGLE), poses, scales, Leg(0.1, 0.0, 0.01, 0.05), TOUCH, KEY)
    spread = 1.0 / math.sqrt(2 * 4000)
    assert np.std(poses[:, 2]) == pytest.approx(0.05, rel=4 * spread)
    assert np.std(poses[:, 0]) == pytest.approx(0.01 * math.cos(0.2), rel=0.05)


def test_a_wall_within_reach_may_stop_a_turn_and_one_beyond_may_not():
    area, turn = area_of(RECTANGLE), Leg(0.0, 2.0, 0.0, 0.0)
    near, far = np.tile([0.6, 0.05, 0.0], (2000, 1)), np.tile(MIDDLE_OF_ROOM, (2000, 1))
    move(area, near, np.ones(2000), turn, TOUCH, KEY)
    move(area, far, np.ones(2000), turn, TOUCH, KEY)
    assert np.mean(near[:, 2] < 1.999) == pytest.approx(0.5, abs=0.05)
    np.testing.assert_allclose(far[:, 2], 2.2, atol=1e-12)


def test_a_drive_ends_at_the_wall_and_weighs_what_its_way_is_worth():
    area = area_of(CUT)
    poses = np.array([[0.6, 0.5, heading] for heading in np.linspace(-3.0, 3.0, 13)])
    begun, log_weights = poses.copy(), np.zeros(13)
    drive_to_wall(area, poses, np.ones(13), log_weights, Leg(0.5, 0.1, 0.01, 0.0), SURE, KEY)
    for before, after, log_weight in zip(begun, poses, log_weights, strict=True):
        way = naive_bumps.way_until_contact(area.walls, before, 0.2, 0.75, 0.09, 0.0381)
        if way == math.inf:
            assert log_weight < -20.0
            continue
        if way > 0.5:  # wheels that went on may have slid along
            np.testing.assert_allclose(after[:2], naive.moved(before, way, 0.2 * way)[:2], atol=2e-3)
        worth = -0.5 * ((0.5 - way) / 0.01) ** 2 - math.log(0.01 * math.sqrt(2.0 * math.pi))
        assert log_weight == pytest.approx(max(worth, -27.7), abs=0.3 + 0.1 * abs(0.5 - way) / 0.01)


@pytest.mark.parametrize("cosine", [1.0, 0.5, 0.01])
def test_the_density_of_ways_is_one(cosine):
    errors = np.linspace(-2.0, 8.0, 200_001)
    values = [way_density(error, cosine, 0.01, TOUCH) for error in errors]
    assert np.trapezoid(values, errors) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("overrun", [0.0, 0.1, 5.0])
def test_a_bump_keeps_the_bumpers_end_at_its_wall_and_pushing_makes_it_square(overrun):
    area = area_of(RECTANGLE)
    contact = drive_until_contact(area, 0.6, 0.5, 0.3, 0.0, 3.0, 0.09, 0.0381)
    after = np.array([after_bump(area, contact, overrun, TOUCH, KEY, p) for p in range(2000)])
    ends = bumper_points(after, CART)[:, 2]
    np.testing.assert_allclose(ends[:, 0], 1.5, atol=1e-9)
    is_square = np.abs(after[:, 2]) < 1e-9
    assert np.mean(is_square) == pytest.approx(1.0 - math.exp(-overrun / 0.15), abs=0.04)
    assert np.all(ends[:, 1] >= contact.y + 0.09 * math.sin(0.3) - 0.0381 * math.cos(0.3) - 1e-9)  # slides onwards
    assert np.ptp(ends[:, 1]) <= overrun * math.sin(0.3) + 1e-9


def test_a_drive_that_met_nothing_is_not_before_a_wall():
    area = area_of(RECTANGLE)
    poses, log_weights = np.array([[0.3, 0.5, 0.0], [1.2, 0.5, 0.0]]), np.zeros(2)
    drive_free(area, poses, np.ones(2), log_weights, Leg(0.5, 0.0, 0.01, 0.0), SURE, KEY)
    assert log_weights[0] == pytest.approx(0.0, abs=1e-6)
    assert log_weights[1] < -10.0
    assert poses[1, 0] == pytest.approx(1.5 - 0.09, abs=1e-6)  # where the wall is


FELT = {LEFT: {"left"}, MIDDLE: {"middle"}, RIGHT: {"right"}, LEFT | RIGHT: {"left", "right"}}


@pytest.mark.parametrize("off", [-0.5, 0.0, 0.019, 0.021])
@pytest.mark.parametrize("across", [-0.0381, -0.0128, -0.0126, 0.0, 0.0126, 0.0128, 0.0381])
def test_switches_are_as_likely_as_their_twin_says(across, off):
    shares = [felt_share(felt, across, off, TOUCH) for felt in FELT]
    assert sum(shares) == pytest.approx(1.0)
    assert shares == pytest.approx([naive.felt_share(closed, across, off, 0.0381) for closed in FELT.values()])
    assert felt_share(0, across, off, TOUCH) == 1.0


def test_the_end_that_met_the_wall_tells_which_way_a_cart_stood_askew():
    area, weights = area_of(RECTANGLE), {}
    for felt in (0, *FELT):
        poses, weights[felt] = np.array([[0.6, 0.5, 0.3], [0.6, 0.5, -0.3], [0.6, 0.5, 0.0]]), np.zeros(3)
        drive_to_wall(area, poses, np.ones(3), weights[felt], Leg(0.8, 0.0, 0.05, 0.0, felt), SURE, KEY)
    told = {felt: np.exp(weights[felt] - weights[0]) for felt in FELT}
    np.testing.assert_allclose(told[RIGHT][:2], [0.95, 0.05 / 3.0], rtol=1e-6)  # to the left of the wall's normal
    np.testing.assert_allclose(told[LEFT][:2], [0.05 / 3.0, 0.95], rtol=1e-6)
    np.testing.assert_allclose(told[LEFT | RIGHT], [0.05 / 3.0, 0.05 / 3.0, 0.8], rtol=1e-6)


def test_starts_feel_what_was_felt():
    area, density, ends = area_of(CUT), {}, {}
    for felt in (0, *FELT):
        ends[felt] = np.empty((2000, 3))
        leg = Leg(0.5, 0.1, 0.002, 0.0, felt)
        density[felt] = start_anywhere(area, ends[felt], np.ones(2000), leg, SURE, KEY)
    assert sum(density[felt] for felt in FELT) == pytest.approx(density[0], rel=0.1)
    points = bumper_points(ends[LEFT][np.isfinite(ends[LEFT][:, 0])], CART)
    rooms = np.array([[clearance(area, x, y) for x, y in ends] for ends in points])
    assert np.mean(rooms[:, 0] < rooms[:, 2]) > 0.9


def test_three_switches_find_a_cart_earlier():
    shares = []
    for seed in range(700, 708):
        stages, truth = run_cart(load_world("cut-rectangle"), seed, 7, build=CartBuild(switches=3))
        for switches in (1, 3):
            cart = CART._replace(switches=switches)
            localizer = BumpLocalizer(area_in("cut-rectangle"), cart, BumpLocalizerParams(particles=700), seed)
            found = known(drive(localizer, stages)).clusters
            shares.append(sum(one.share for one in found if is_right(one.pose, truth[-1])))
    alone, told = np.mean(np.reshape(shares, (8, 2)), axis=0)
    assert told > alone + 0.1


def test_starts_are_as_frequent_and_where_driving_from_anywhere_ends():
    area, leg = area_of(CUT), Leg(0.5, 0.1, 0.002, 0.0)
    poses = np.empty((3000, 3))
    density = start_anywhere(area, poses, np.ones(3000), leg, SURE, KEY)
    rng = np.random.default_rng(4)
    ends, n = [], 0
    band = 0.02  # m about the way within which a drive from anywhere counts
    for x, y, heading in rng.uniform([0.0, 0.0, -math.pi], [1.5, 1.15, math.pi], (40_000, 3)):
        if clearance(area, x, y) <= 0.0:
            continue
        n += 1
        begun, log_weights = np.array([[x, y, heading]]), np.zeros(1)
        drive_to_wall(area, begun, np.ones(1), log_weights, Leg(0.5, 0.1, band, 0.0), SURE, KEY)
        if log_weights[0] > -0.5 - math.log(band * math.sqrt(2.0 * math.pi)):
            ends.append(begun[0])
    assert density == pytest.approx(len(ends) / n / (2.0 * band), rel=0.1)
    at_cut = [np.mean((part[:, 0] + part[:, 1]) > 1.9) for part in (poses, np.array(ends))]
    assert at_cut[0] == pytest.approx(at_cut[1], abs=0.03)
    assert np.all(in_bump_space(area, poses, CART, 0.01))


def test_clusters_are_told_with_their_shares():
    rng = np.random.default_rng(2)
    one, other = rng.normal([0.2, 0.2, 3.1], 0.02, (700, 3)), rng.normal([1.2, 0.9, 0.0], 0.02, (300, 3))
    found = clusters(np.concatenate([one, other]), np.full(1000, 1e-3), 0.15, math.radians(45.0))
    assert [round(cluster.share, 3) for cluster in found] == [0.7, 0.3]
    np.testing.assert_allclose(found[0].pose, [0.2, 0.2, 3.1], atol=0.01)
    np.testing.assert_allclose(np.sqrt(np.diag(found[0].covariance)), 0.02, rtol=0.1)


def test_a_cluster_may_lie_across_the_turn_of_headings():
    headings = np.linspace(math.pi - 0.1, math.pi + 0.1, 50)
    poses = np.column_stack([np.zeros((50, 2)), wrap(headings)])
    (found,) = clusters(poses, np.full(50, 0.02), 0.15, math.radians(45.0))
    assert abs(wrap(found.pose[2] - math.pi)) < 1e-9
    assert len(np.unique(bins_of(poses, 0.1, 0.1))) <= 4


def test_more_spread_needs_more_particles():
    assert [enough_particles(bins, 0.05, 2.33) for bins in (1, 2, 50, 400)] == [
        naive.enough_particles(bins, 0.05, 2.33) for bins in (1, 2, 50, 400)
    ]


def drive(localizer, stages):
    for stage in stages:
        localizer.step(Stage(*stage))
    return localizer


def area_in(room):
    world = load_world(room)
    return area_of(closed_outlines(world.segments, world.name))


def localizer_in(room, seed=1, particles=3000):
    return BumpLocalizer(area_in(room), CART, BumpLocalizerParams(particles=particles), seed)


def known(localizer):
    estimate = localizer.estimate()
    assert estimate is not None
    return estimate


def is_right(pose, true):
    return bool(within(true[None], pose, 0.15, math.radians(45.0))[0])


def test_carts_are_found():
    right = []
    for seed in range(8):
        stages, truth = run_cart(load_world("cut-rectangle"), 300 + seed, 20, build=CartBuild(drift="low"))
        right.append(is_right(known(drive(localizer_in("cut-rectangle", seed), stages)).pose, truth[-1]))
    assert sum(right) >= 7


def test_a_symmetric_room_is_told_as_two_places():
    both = []
    for seed in range(6):
        stages, truth = run_cart(load_world("rectangle"), 400 + seed, 16, build=CartBuild(drift="low"))
        estimate = known(drive(localizer_in("rectangle", seed), stages))
        x, y, heading = truth[-1]
        twin = np.array([1.5 - x, 1.1 - y, wrap(heading + math.pi)])
        shares = [sum(c.share for c in estimate.clusters if is_right(c.pose, pose)) for pose in (truth[-1], twin)]
        both.append(min(shares) > 0.05)
        assert shares[0] == pytest.approx(shares[1], abs=0.02)
        assert not estimate.is_localized
    assert sum(both) >= 4


def test_a_carried_cart_is_found_again():
    first, _ = run_cart(load_world("cut-rectangle"), 500, 12, build=CartBuild(drift="low"))
    then, truth = run_cart(load_world("cut-rectangle"), 501, 15, build=CartBuild(drift="low"))
    localizer = drive(localizer_in("cut-rectangle"), first)
    restarted = []
    for stage in then:
        localizer.step(Stage(*stage))
        restarted.append(localizer.restarted)
    assert max(restarted) > 0.1
    assert is_right(known(localizer).pose, truth[-1])


def test_others_overrule_a_place_that_is_sure_because_the_true_one_was_lost():
    wrong, untested = 0, 0
    for seed in range(600, 624):
        stages, truth = run_cart(load_world("cut-rectangle"), seed, 12, build=CartBuild(drift="low"))
        for opinions in (0, 5):
            params = BumpLocalizerParams(particles=100, children=1, opinions=opinions)
            localizer = BumpLocalizer(area_in("cut-rectangle"), CART, params, seed)
            for stage, true in zip(stages, truth[1:], strict=True):
                localizer.step(Stage(*stage))
                estimate = localizer.estimate()
                if stage.kind == DRIVE and estimate is not None and estimate.is_localized:
                    is_wrong = not is_right(estimate.pose, true)
                    wrong, untested = wrong + is_wrong * (opinions > 0), untested + is_wrong * (opinions == 0)
                    break
    assert untested >= 4
    assert wrong <= untested // 2


def test_the_same_seed_gives_the_same_bytes_and_another_others():
    stages, _ = run_cart(load_world("cut-rectangle"), 3, 6)
    once, again, other = (drive(localizer_in("cut-rectangle", seed, 400), stages).poses.tobytes() for seed in (1, 1, 2))
    assert once == again
    assert once != other


def test_particles_are_fewer_once_it_is_known():
    stages, _ = run_cart(load_world("cut-rectangle"), 300, 15, build=CartBuild(drift="low"))
    localizer = localizer_in("cut-rectangle")
    counts = []
    for stage in stages:
        localizer.step(Stage(*stage))
        if stage.kind == DRIVE:  # between bumps each has children
            counts.append(len(localizer.poses))
    assert max(counts) == 3000
    assert counts[-1] < 2000


def test_nothing_is_known_before_the_first_bump():
    localizer = localizer_in("cut-rectangle")
    drive(localizer, [Stage(DRIVE, 100, 100, 0), Stage(BACK, -30, -30), Stage(TURN, -20, 20)])
    assert localizer.estimate() is None
    drive(localizer, [Stage(DRIVE, 250, 250, MIDDLE)])
    assert localizer.estimate() is not None


def test_a_way_that_the_room_has_no_place_for_is_survived():
    localizer = localizer_in("cut-rectangle", particles=200)
    drive(localizer, [Stage(DRIVE, 9000, 9000, MIDDLE), Stage(BACK, -30, -30), Stage(DRIVE, 250, 250, MIDDLE)])
    assert localizer.estimate() is not None


def test_survivors_are_all_in_bump_space_and_evenly_doubled():
    stages, _ = run_cart(load_world("cut-rectangle"), 1, 1)
    area = area_in("cut-rectangle")
    filter_ = Survivors(area, CART, Survival(particles=500), seed=1)
    drive(filter_, stages)
    assert 0 < filter_.n_alive < 500
    assert np.all(in_bump_space(area, filter_.poses, CART, filter_.params.tolerance))
    _, copies = np.unique(filter_.poses, axis=0, return_counts=True)
    assert copies.max() - copies.min() <= 1
    assert sum(cluster.share for cluster in filter_.clusters()) <= 1.0 + 1e-9


def test_without_survivors_the_papers_run_is_over():
    filter_ = Survivors(area_of(RECTANGLE), CART, Survival(particles=50), seed=1)
    drive(filter_, [Stage(DRIVE, 9000, 9000, MIDDLE), Stage(DRIVE, 10, 10, MIDDLE)])
    assert filter_.n_alive == 0
    assert filter_.clusters() == []


def test_survivors_errors_have_the_slips_second_moments():
    stage = Stage(DRIVE, 400, 400, MIDDLE)
    quiet = noise_of(stage, arc(400, 400, CART), CART._replace(slip_share=0.0))
    noisy = noise_of(stage, arc(400, 400, CART), CART)
    np.testing.assert_allclose(noisy[[0, 2]] ** 2 - quiet[[0, 2]] ** 2, [0.2 * 2 * 0.06**2, 0.2 * 0.1**2])
