"""A cart's parameters are learned from runs whose truth is known, and the intervals hold it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware.virtual.bumper_cart import VirtualCart, run_cart
from firmware.virtual.polygons import closed_outlines
from firmware.virtual.worlds import load_world
from slam import posterior
from slam.area import area_of
from slam.cart_calibration import (
    FIRST_GUESS,
    NO_CORNERS,
    frame_of,
    learn_alone,
    learn_from_camera,
    learn_from_map,
    lines_of,
    on_map,
    table_of,
)
from slam.cart_hypothesis import NAMES, OWN, TOLD, meet, slip_density, square
from slam.cart_likelihood import run_costs
from slam.cart_odometry import BACK, DRIVE, MIDDLE, TURN, CartParams, Stage, turn_variance, way_variance
from slam.pose import compose
from slam.posterior import Unknown, fitted

TRUE = CartParams(wheelbase=0.0655, distance_noise=0.01, turn_noise=0.06, rotation_noise=0.03)
CAMERA = np.array([0.001, 0.005])
FEW = 60  # draws where bumps are the evidence, each of which takes long; the wheelbase is told well enough by them


def run_of(true, seed, bumps=100):
    """Stages and poses of a cart whose errors are those of the model, its counters cut off to whole ticks."""
    rng = np.random.default_rng(seed)
    ways, turns, kinds = [], [], []
    for _ in range(bumps):
        ways += [rng.uniform(0.3, 1.0), -0.085, 0.0]
        turns += [rng.normal(0.0, 0.3), rng.normal(0.0, 0.04), rng.choice([-1, 1]) * rng.uniform(0.6, 3.0)]
        kinds += [DRIVE, BACK, TURN]
    ways, turns = np.array(ways), np.array(turns)
    told_ways = ways + np.sqrt([way_variance(way, true) for way in ways]) * rng.standard_normal(len(ways))
    spread = np.sqrt([turn_variance(way, turn, true) for way, turn in zip(ways, turns, strict=True)])
    told_turns = turns + spread * rng.standard_normal(len(turns))
    half = 0.5 * true.wheelbase * told_turns
    counters = np.floor(np.cumsum(np.column_stack([told_ways - half, told_ways + half]), axis=0) / true.tick)
    ticks = np.diff(np.vstack([[0.0, 0.0], counters]), axis=0).astype(int)
    path = [np.zeros(3)]
    for way, turn in zip(ways, turns, strict=True):
        chord = way * np.sinc(turn / (2.0 * math.pi))
        path.append(compose(path[-1], np.array([chord * math.cos(turn / 2), chord * math.sin(turn / 2), turn])))
    stages = [Stage(k, int(a), int(b), MIDDLE * (k == DRIVE)) for k, (a, b) in zip(kinds, ticks, strict=True)]
    return stages, np.array(path) + rng.standard_normal((len(path), 3)) * CAMERA[[0, 0, 1]]


def test_a_camera_tells_wheelbase_and_noise_and_how_sure_they_are():
    off, held = [], []
    for seed in range(6):
        stages, path = run_of(TRUE, seed)
        found = learn_from_camera([stages], [path], CartParams())
        names = ("wheelbase", "distance_noise", "turn_noise", "rotation_noise")
        off.append([abs(found.value(name) / getattr(TRUE, name) - 1.0) for name in names])
        rows = [found.names.index(name) for name in names]
        held += [
            found.intervals[row, 0] < getattr(TRUE, name) < found.intervals[row, 1]
            for row, name in zip(rows, names, strict=True)
        ]
        assert found.gain > 0.0
    median = np.median(off, axis=0)
    assert median[0] < 0.01
    assert np.all(median[1:] < 0.15)  # a noise is told to a tenth by a hundred stages
    assert np.mean(held) > 0.7


def test_more_runs_tell_more():
    runs = [run_of(TRUE, seed, 40) for seed in range(4)]
    one = learn_from_camera([runs[0][0]], [runs[0][1]], CartParams())
    all_ = learn_from_camera([stages for stages, _ in runs], [path for _, path in runs], CartParams())
    assert np.ptp(all_.intervals[0]) < 0.7 * np.ptp(one.intervals[0])


def test_the_virtual_carts_wheelbase_is_found_from_above():
    stages, truth = run_cart(load_world("cut-rectangle"), 3001, 60)
    found = learn_from_camera([[Stage(*stage) for stage in stages]], [truth], CartParams())
    assert found.value("wheelbase") == pytest.approx(
        VirtualCart(load_world("cut-rectangle"), seed=3001).build.wheelbase, rel=0.015
    )


def test_the_virtual_carts_wheelbase_is_found_by_the_map(monkeypatch):
    monkeypatch.setattr(posterior, "SAMPLES", FEW)
    world = load_world("cut-rectangle")
    stages, _ = run_cart(world, 3005, 80)
    area = area_of(closed_outlines(world.segments, world.name))
    found = learn_from_map([[Stage(*stage) for stage in stages]], area, CartParams())
    assert found.value("wheelbase") == pytest.approx(VirtualCart(world, seed=3005).build.wheelbase, rel=0.02)


def test_wheels_that_turn_round_are_noticed():
    stages = [Stage(DRIVE, 100, 90, MIDDLE), Stage(BACK, -30, -31), Stage(TURN, -20, 21), Stage(DRIVE, 0, 50, MIDDLE)]
    expected = [[0, 100, 90, 0, 0, 1], [1, -30, -31, -1, -1, 0], [2, -20, 21, 0, 1, 0], [0, 0, 50, 0, 0, 1]]
    np.testing.assert_array_equal(table_of(stages), expected)


def test_a_bump_on_the_map_is_as_likely_as_its_gaussian():
    room = area_of([np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 0.775], [0.0, 0.775]])])
    tick, half, tolerance = 0.0017, 0.0381, 0.003
    named = {
        "wheelbase": 0.064, "tick": tick, "distance_noise": 0.01, "bumper_width": 2.0 * half, "bumper_ahead": 0.09,
        "tolerance": tolerance, "slip_distance": 0.06, "camera_place": 1.0, "camera_turn": 1.0,
    }  # fmt: skip
    values = np.array([named.get(name, 0.0) for name in NAMES])
    stages = [Stage(DRIVE, 100, 100, MIDDLE)] * 2
    told = np.array([[0.5, 0.5, 0.5 * math.pi], [np.nan, np.nan, np.nan]])
    evidence = on_map(stages, told, np.full((3, 3), np.nan), room)
    [cost] = run_costs(values, evidence)
    off, way = 0.5 + 0.17 + 0.09 - 0.775, 0.17
    by_ticks = tick**2 / 12.0
    variance = TOLD[1] ** 2 + (TOLD[2] * half) ** 2 + 0.01**2 * way + tolerance**2 + 0.0005**2
    variance += by_ticks + 4.0 * by_ticks / 0.064**2 * half**2  # both ends of the stage, of two counters
    density = math.exp(-0.5 * off**2 / variance) / math.sqrt(2.0 * math.pi * variance)
    expected = -math.log(tick * (0.97 * density + 0.03))
    assert cost == pytest.approx(expected, abs=1e-3)


def unsure_evidence(spread):
    """A run in a rectangle whose walls are off by nothing, with a doubt (m and rad, one sigma) of them."""
    room = area_of([np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])])
    stages = [
        Stage(DRIVE, 200, 190, MIDDLE),
        Stage(BACK, -50, -50),
        Stage(TURN, -40, 40),
        Stage(DRIVE, 300, 310, MIDDLE),
    ]
    told = np.array([[0.5, 0.5, 0.7], [np.nan] * 3, [np.nan] * 3, [np.nan] * 3])
    sure = on_map(stages, told, np.full((5, 3), np.nan), room)._replace(corners=NO_CORNERS)
    more = 2 * len(sure.lines)
    covariance = np.zeros((len(sure.state) + more,) * 2)
    covariance[: len(sure.state), : len(sure.state)] = sure.covariance
    covariance[len(sure.state) :, len(sure.state) :] = spread**2 * np.eye(more)
    state = np.concatenate([sure.state, np.zeros(more)])
    return sure, sure._replace(state=state, covariance=covariance, unsure=True)


def test_turn_after_turn_leaves_room_for_hypotheses():
    stages, path = run_of(TRUE, 5, 30)
    world = load_world("rectangle")
    missed = [
        stage if row < 15 or stage.kind != DRIVE else stage._replace(bumper=0) for row, stage in enumerate(stages)
    ]
    told = np.full((len(missed), 3), math.nan)
    told[0] = path[1]
    evidence = on_map(
        missed, told, np.full((len(missed) + 1, 3), math.nan), area_of(closed_outlines(world.segments, world.name))
    )
    guess = CartParams()._asdict() | FIRST_GUESS
    assert np.all(np.isfinite(run_costs(np.array([guess[name] for name in NAMES]), evidence)))


@pytest.mark.parametrize("sigma", [0.0003, 0.002, 0.02, 0.3])
def test_a_slips_density_is_an_exponential_smeared_by_what_is_not_known(sigma):
    size = 0.05
    ways = np.linspace(0.0, 40.0 * size, 400_001)
    for off in (-3.0 * sigma, -sigma, 0.0, sigma, 0.02, 0.1):
        smeared = np.exp(-ways / size - 0.5 * ((off - ways) / sigma) ** 2) / (size * sigma * math.sqrt(2.0 * math.pi))
        assert slip_density(off, sigma, size) == pytest.approx(np.trapezoid(smeared, ways), rel=1e-3)
    assert slip_density(-30.0 * sigma, sigma, size) < 1e-100


def test_one_that_stands_square_to_a_wall_has_its_heading():
    sure, unsure = unsure_evidence(0.1)
    for evidence in (sure, unsure):
        d, phi = len(evidence.state), evidence.lines[1, 2]
        mean, covariance = evidence.state.copy(), evidence.covariance + 1e-6 * np.eye(d)
        mean[2], covariance[2, 2] = phi + 2.0 * math.pi - 0.4, 0.5
        square(mean, covariance, evidence, 1, np.zeros(d))
        wall = mean[OWN + 2] if evidence.unsure else 0.0
        assert math.remainder(mean[2] - phi - wall, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-3)


def test_walls_that_may_be_off_by_nothing_are_walls_that_are_known():
    values = np.array([getattr(CartParams(), name, 0.01) for name in NAMES])
    sure, unsure = unsure_evidence(0.0)
    np.testing.assert_allclose(run_costs(values, unsure), run_costs(values, sure), rtol=1e-9)
    assert np.any(np.abs(run_costs(values, unsure_evidence(0.05)[1]) - run_costs(values, sure)) > 0.1)


def test_a_walls_slopes_are_its_derivatives():
    values = np.array([getattr(CartParams(), name, 0.01) for name in NAMES])
    _, evidence = unsure_evidence(0.02)
    rng = np.random.default_rng(3)
    for feature in range(2 * len(evidence.lines)):
        mean = np.concatenate([[0.7, 0.5, 0.4], 0.05 * rng.standard_normal(len(evidence.state) - 3)])
        slope, spare = np.zeros(len(mean)), np.zeros(len(mean))
        meet(mean, evidence.covariance, evidence, feature, values, slope)
        for row in range(len(mean)):
            nudge = 1e-6 * np.eye(len(mean))[row]
            ahead, behind = (
                meet(mean + side * nudge, evidence.covariance, evidence, feature, values, spare)[0] for side in (1, -1)
            )
            assert (ahead - behind) / 2e-6 == pytest.approx(slope[row], abs=1e-6)


def test_the_virtual_carts_wheelbase_is_found_by_its_own_bumps(monkeypatch):
    monkeypatch.setattr(posterior, "SAMPLES", FEW)
    world = load_world("cut-rectangle")
    stages, _ = run_cart(world, 3005, 100)
    guess = CartParams()._replace(wheelbase=1.03 * CartParams().wheelbase)
    found = learn_alone([[Stage(*stage) for stage in stages]], guess)
    assert "tick" not in found.names
    assert found.value("wheelbase") == pytest.approx(VirtualCart(world, seed=3005).build.wheelbase, rel=0.015)


def test_too_few_bumps_tell_nothing_alone():
    stages, _ = run_of(TRUE, 1, 30)
    with pytest.raises(ValueError, match="50 bumps"):
        learn_alone([stages], CartParams())


def test_corners_that_point_into_the_floor_are_found():
    room = area_of([np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]])])
    lines, corners = lines_of(room)
    np.testing.assert_allclose(corners, [[1.0, 1.0]])
    for (x1, y1, x2, y2), (_, _, phi, _, _) in zip(room.walls, lines, strict=True):
        assert math.cos(phi) * (x2 - x1) + math.sin(phi) * (y2 - y1) == pytest.approx(0.0, abs=1e-9)


def test_a_cameras_frame_is_found_beside_places_that_are_wrong():
    rng = np.random.default_rng(4)
    told = np.column_stack([rng.uniform(0.0, 2.0, (40, 2)), rng.uniform(-3.0, 3.0, 40)])
    frame = np.array([5.0, -3.0, 2.5])
    seen = compose(frame, told)
    seen[:8, :2] += 0.5
    np.testing.assert_allclose(frame_of(told, seen), frame, atol=1e-6)


def test_the_middle_and_the_ends_of_what_is_likely_are_found():
    rng = np.random.default_rng(1)
    samples = rng.normal(1.5, 0.5, 400)

    def costs(values):
        return 0.5 * ((samples - values[0]) / values[1]) ** 2 + math.log(values[1])

    unknowns = [Unknown("mean", 0.0, 10.0, is_share=False), Unknown("sigma", 1.0, 3.0)]
    found = fitted(costs, unknowns, ["mean", "sigma"], 1)
    assert found.value("mean") == pytest.approx(samples.mean(), abs=2e-3)
    assert found.value("sigma") == pytest.approx(samples.std(), rel=5e-3)
    low, high = found.interval("mean")
    assert high - low == pytest.approx(2.0 * 1.645 * samples.std() / 20.0, rel=0.06)


def test_what_errs_more_than_the_model_has_it_widens_the_interval():
    rng = np.random.default_rng(2)
    samples = np.repeat(rng.normal(0.0, 1.0, 100), 4)  # each four of them are one

    def costs(values):
        return 0.5 * (samples - values[0]) ** 2

    blind, aware = (fitted(costs, [Unknown("mean", 0.0, 10.0, False)], ["mean"], block) for block in (1, 4))
    assert np.ptp(aware.intervals) == pytest.approx(2.0 * np.ptp(blind.intervals), rel=0.1)


def test_too_little_is_refused():
    stages, path = run_of(TRUE, 0, 3)
    with pytest.raises(ValueError, match="are needed"):
        learn_from_camera([stages], [path], CartParams())
    with pytest.raises(ValueError, match="one more"):
        learn_from_camera([stages], [path[1:]], CartParams())
    world = load_world("rectangle")
    with pytest.raises(ValueError, match="sure place"):
        learn_from_map([stages], area_of(closed_outlines(world.segments, world.name)), CartParams())
