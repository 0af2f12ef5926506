"""A cart's parameters are learned from runs whose truth is known, and the intervals hold it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware.virtual.bumper_cart import VirtualCart, run_cart
from firmware.virtual.polygons import closed_outlines
from firmware.virtual.worlds import load_world
from slam.area import area_of
from slam.cart_calibration import counts, curvature, learn_from_camera, learn_from_map, map_cost
from slam.cart_odometry import BACK, DRIVE, MIDDLE, TURN, CartParams, Stage
from slam.pose import compose

TRUE = CartParams(wheelbase=0.0655, distance_noise=0.01, turn_noise=0.06, rotation_noise=0.03)
CAMERA = np.array([0.001, 0.005])


def run_of(true, seed, bumps=100):
    """Stages and poses of a cart whose errors are those of the model, its counters cut off to whole ticks."""
    rng = np.random.default_rng(seed)
    ways, turns, kinds = [], [], []
    for _ in range(bumps):
        ways += [rng.uniform(0.3, 1.0), -0.085, 0.0]
        turns += [rng.normal(0.0, 0.3), rng.normal(0.0, 0.04), rng.choice([-1, 1]) * rng.uniform(0.6, 3.0)]
        kinds += [DRIVE, BACK, TURN]
    ways, turns = np.array(ways), np.array(turns)
    told_ways = ways + true.distance_noise * np.sqrt(np.abs(ways)) * rng.standard_normal(len(ways))
    spread = np.hypot(true.turn_noise * np.sqrt(np.abs(ways)), true.rotation_noise * np.abs(turns))
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
        found = learn_from_camera([stages], [path], CartParams(), CAMERA)
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
    assert np.all(median[1:] < 0.15)
    assert np.mean(held) > 0.7


def test_more_runs_tell_more():
    runs = [run_of(TRUE, seed, 40) for seed in range(4)]
    one = learn_from_camera([runs[0][0]], [runs[0][1]], CartParams(), CAMERA)
    all_ = learn_from_camera([stages for stages, _ in runs], [path for _, path in runs], CartParams(), CAMERA)
    assert np.ptp(all_.intervals[0]) < 0.7 * np.ptp(one.intervals[0])


def test_the_virtual_carts_wheelbase_is_found_from_above():
    stages, truth = run_cart(load_world("cut-rectangle"), 3001, 60)
    found = learn_from_camera([[Stage(*stage) for stage in stages]], [truth], CartParams(), np.array([1e-4, 1e-3]))
    assert found.value("wheelbase") == pytest.approx(
        VirtualCart(load_world("cut-rectangle"), seed=3001).build.wheelbase, rel=0.015
    )


def test_the_virtual_carts_wheelbase_is_found_by_the_map():
    world = load_world("cut-rectangle")
    stages, _ = run_cart(world, 3005, 80)
    area = area_of(closed_outlines(world.segments, world.name))
    found = learn_from_map([[Stage(*stage) for stage in stages]], area, CartParams())
    assert found.value("wheelbase") == pytest.approx(VirtualCart(world, seed=3005).build.wheelbase, rel=0.02)


def test_wheels_that_turn_round_are_noticed():
    stages = [Stage(DRIVE, 100, 90, MIDDLE), Stage(BACK, -30, -31), Stage(TURN, -20, 21), Stage(DRIVE, 0, 50, MIDDLE)]
    expected = [[100, 90, 0, 0], [-30, -31, -1, -1], [-20, 21, 0, 1], [0, 50, 0, 0]]
    np.testing.assert_array_equal(counts(stages), expected)


def test_a_bump_on_the_map_is_as_likely_as_its_gaussian():
    values = np.array([0.064, 0.0017, 0.01, 0.0, 0.0, 0.0762, 0.09, 0.003, 0.0])
    slips = np.array([0.0, 0.06])
    table = np.full((2, 15), np.nan)
    table[:, 1:6] = [[100, 100, 0, 0, 1], [100, 100, 0, 0, 1]]
    table[:, 0] = 1.0
    table[0, 6:13] = [0.5, 0.5, 0.0, 1.0, 0.0, 0.0, 1.0]
    table[1, 6:13] = [0.67, 0.5, 0.0, 1.0, 0.0, 0.775, 1.0]
    off = 0.5 + 0.17 + 0.09 - 0.775
    half = 0.0381
    variance = 0.03**2 + (0.1 * half) ** 2 + 0.01**2 * 0.17 + 0.0017**2 / 12.0 + 0.003**2
    variance += 0.0017**2 / (3.0 * 0.064**2) * half**2  # ticks turn the bumper's end
    expected = 0.5 * off**2 / variance + 0.5 * math.log(2.0 * math.pi * variance)
    assert map_cost(values, slips, table, True) == pytest.approx(expected, abs=1e-3)


def test_curvature_is_the_quadratics():
    square = np.array([[400.0, 30.0], [30.0, 9.0]])
    np.testing.assert_allclose(
        curvature(lambda place: 0.5 * float(place @ square @ place), np.zeros(2)), square, rtol=1e-6
    )


def test_too_little_is_refused():
    stages, path = run_of(TRUE, 0, 3)
    with pytest.raises(ValueError, match="are needed"):
        learn_from_camera([stages], [path], CartParams())
    with pytest.raises(ValueError, match="one more"):
        learn_from_camera([stages], [path[1:]], CartParams())
    world = load_world("rectangle")
    with pytest.raises(ValueError, match="sure place"):
        learn_from_map([stages], area_of(closed_outlines(world.segments, world.name)), CartParams())
