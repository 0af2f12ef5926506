"""Walls: rays end where walls are and no farther than was seen; curves are joined, filtered and smoothed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from slam.grid import Grid
from slam.local_map import LocalMap, LocalMapParams
from slam.rangefinder import RingParams
from slam.walls import (
    Tracing,
    WallParams,
    Walls,
    curves,
    extract,
    join_gaps,
    label_curves,
    smooth_curves,
    trace_rays,
)
from tests.naive import walls as naive

RESOLUTION = 0.025
TRACING = Tracing(reach=1.0, occupied=0.6, free=-0.3, thickness=0.16, unseen_gap=0.08)
JUMP = 0.15
DISTANCES = arrays.arrays(
    float, st.integers(8, 40), elements=st.sampled_from([math.inf, 0.5, 0.6, 0.64, 0.74, 0.85, 1.05, 1.9])
)


def grid_of(log_odds, n=100):
    """Grid around the origin whose cells hold log_odds(x, y)."""
    centres = (np.arange(n) + 0.5 - n / 2) * RESOLUTION
    x, y = np.meshgrid(centres, centres)
    return Grid(log_odds(x, y).astype(np.float32), RESOLUTION, -0.5 * n * RESOLUTION, -0.5 * n * RESOLUTION)


def noisy(seed, n=40):
    """Patches of wall, free and unknown cells."""
    rng = np.random.default_rng(seed)
    cells = np.kron(rng.uniform(-2.5, 1.2, (n // 4, n // 4)), np.ones((4, 4)))
    return Grid((cells + rng.uniform(-0.3, 0.3, (n, n))).astype(np.float32), 0.05, -0.05 * n / 2, -0.05 * n / 2)


def random_rays(seed, n=60):
    """Distances (n,) with curves, jumps and gaps."""
    rng = np.random.default_rng(seed)
    distances = 0.8 + 0.02 * rng.normal(size=n).cumsum() + np.repeat(rng.choice([0.0, 0.3], n // 6), 6)
    for start in rng.integers(0, n, rng.integers(0, 6)):
        distances[(start + np.arange(rng.integers(1, 8))) % n] = math.inf
    return distances


# Rays


@pytest.mark.parametrize("seed", range(8))
def test_rays_agree_with_sample_by_sample(seed):
    rng = np.random.default_rng(100 + seed)
    grid, pose = noisy(seed), rng.uniform(-0.3, 0.3, 3) * [1.0, 1.0, 10.0]
    expected = naive.trace_rays(grid, pose, 72, TRACING)
    distances, free = trace_rays(grid, tuple(pose), 72, TRACING)
    np.testing.assert_allclose(distances, expected[0], atol=1e-9)
    np.testing.assert_allclose(free, expected[1], atol=1e-9)


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.0])
@pytest.mark.parametrize("thickness", [1, 2, 4])
def test_a_ring_of_wall_is_found_within_half_a_cell(heading, thickness):
    for radius in (0.3, 0.503, 0.9):
        half = 0.5 * thickness * RESOLUTION
        grid = grid_of(lambda x, y, r=radius, h=half: np.where(np.abs(np.hypot(x, y) - r) <= h, 2.0, -2.0))
        distances, free = trace_rays(grid, (0.003, -0.004, heading), 120, TRACING)
        expected = np.hypot(radius, 0.0) - 0.005 * np.cos(
            heading + 2 * np.pi * np.arange(120) / 120 - math.atan2(-4, 3)
        )
        assert np.isfinite(distances).all() or thickness == 1  # a ring one cell thin has holes at its corners
        seen = np.isfinite(distances)
        assert seen.mean() > 0.8
        np.testing.assert_allclose(np.mean(distances[seen] - expected[seen]), 0.0, atol=0.25 * RESOLUTION)
        np.testing.assert_allclose(distances[seen], expected[seen], atol=1.25 * RESOLUTION)
        assert np.all(free[seen] > expected[seen] - half - 2.5 * RESOLUTION)


@pytest.mark.parametrize("distance", [0.2, 0.5, 0.8375])
def test_a_straight_wall_ahead_is_found_within_half_a_cell(distance):
    """The wall is the middle of what is occupied, not its front edge."""
    grid = grid_of(lambda x, y: np.where(np.abs(x - distance) < 0.04, 2.0, -2.0))
    columns = np.flatnonzero(grid.cells[0] > 0.0)
    middle = grid.x + (columns.mean() + 0.5) * RESOLUTION
    distances, _ = trace_rays(grid, (0.0, 0.001, 0.0), 120, TRACING)
    for ray in (-10, -3, 0, 5, 10):
        bearing = 2.0 * math.pi * ray / 120
        if middle / math.cos(bearing) < 0.9:
            assert distances[ray] * math.cos(bearing) == pytest.approx(middle, abs=0.5 * RESOLUTION)


def test_the_centroid_leans_to_the_surer_side():
    grids = [
        grid_of(lambda x, y, s=s: np.where((x > 0.5) & (x < 0.6), 1.5 + s * (x - 0.55) / 0.1, -2.0)) for s in (-1, 1)
    ]
    near, far = (trace_rays(grid, (0.0, 0.001, 0.0), 120, TRACING)[0][0] for grid in grids)
    assert 0.5 < near < 0.55 < far < 0.6


def test_a_thick_block_is_a_wall_near_its_face():
    grid = grid_of(lambda x, y: np.where(x > 0.5, 2.0, -2.0))
    distances, _ = trace_rays(grid, (0.0, 0.001, 0.0), 120, TRACING)
    assert distances[0] == pytest.approx(0.5 + 0.5 * TRACING.thickness, abs=RESOLUTION)


def test_a_ray_crosses_only_a_little_that_was_not_seen():
    for gap, is_crossed in ((0.05, True), (0.07, True), (0.15, False)):
        grid = grid_of(lambda x, y, g=gap: np.where((x > 0.3) & (x < 0.3 + g), 0.0, -2.0))
        _, free = trace_rays(grid, (0.0, 0.001, 0.0), 120, TRACING)
        assert (free[0] > 0.9) == is_crossed
        if not is_crossed:
            assert free[0] == pytest.approx(0.3, abs=RESOLUTION)


def test_nothing_is_known_of_an_unknown_map():
    distances, free = trace_rays(grid_of(lambda x, y: 0.0 * x), (0.0, 0.0, 0.0), 120, TRACING)
    assert np.isinf(distances).all()
    assert not free.any()


def test_rays_end_at_the_reach_and_at_the_border():
    free_everywhere = grid_of(lambda x, y: -2.0 + 0.0 * x, n=60)
    for reach, expected in ((0.5, 0.5), (3.0, 0.75)):
        distances, free = trace_rays(free_everywhere, (0.0, 0.0, 0.001), 8, TRACING._replace(reach=reach))
        assert np.isinf(distances).all()
        assert free[0] == pytest.approx(expected, abs=RESOLUTION)
    outside, free = trace_rays(free_everywhere, (9.0, 9.0, 0.0), 8, TRACING)
    assert np.isinf(outside).all()
    assert not free.any()


@pytest.mark.parametrize("seed", range(8))
def test_no_ray_is_free_beyond_its_wall(seed):
    distances, free = trace_rays(noisy(seed), (0.01, 0.02, 0.3), 120, TRACING)
    assert np.all(free <= distances)
    assert np.all(free >= 0.0)
    assert np.all(free < TRACING.reach)


def test_turning_the_robot_turns_the_rays():
    grid = noisy(3)
    distances, free = trace_rays(grid, (0.01, 0.02, 0.3), 120, TRACING)
    turned = trace_rays(grid, (0.01, 0.02, 0.3 + 2.0 * math.pi * 7 / 120), 120, TRACING)
    np.testing.assert_allclose(turned[0], np.roll(distances, -7), atol=1e-9)
    np.testing.assert_allclose(turned[1], np.roll(free, -7), atol=1e-9)


# Curves


@settings(max_examples=200)
@given(DISTANCES, st.integers(0, 5))
def test_joining_agrees_with_pair_by_pair(distances, join_rays):
    expected = naive.join_gaps(distances, join_rays, JUMP)
    np.testing.assert_allclose(join_gaps(distances, join_rays, JUMP), expected, atol=1e-12)


@pytest.mark.parametrize("shift", [0, 3, 9])
def test_gaps_are_bridged_only_where_the_ends_agree(shift):
    distances = np.roll([1.0, math.inf, math.inf, 1.09, 1.0, math.inf, 1.3, 1.3, math.inf, 1.3, 1.3, math.inf], shift)
    joined = np.roll(join_gaps(distances, 4, JUMP), -shift)
    np.testing.assert_allclose(joined[:4], [1.0, 1.03, 1.06, 1.09])
    assert math.isinf(joined[5])  # the ends differ by 0.3 m
    assert joined[8] == 1.3
    assert math.isinf(joined[11])


def test_wide_gaps_stay_open():
    distances = np.ones(20)
    distances[5:10] = math.inf
    np.testing.assert_array_equal(join_gaps(distances, 4, JUMP), distances)
    assert np.isfinite(join_gaps(distances, 5, JUMP)).all()
    np.testing.assert_array_equal(join_gaps(np.full(20, math.inf), 4, JUMP), math.inf)


@settings(max_examples=200)
@given(DISTANCES)
def test_labels_part_the_rays_as_links_do(distances):
    labels = label_curves(distances, JUMP)
    np.testing.assert_array_equal(labels > 0, np.isfinite(distances))
    found = [set(np.flatnonzero(labels == label)) for label in range(1, labels.max() + 1)]
    assert sorted(map(sorted, found)) == sorted(map(sorted, naive.curves_of(distances, JUMP)))


@pytest.mark.parametrize("shift", range(0, 60, 7))
def test_labels_do_not_depend_on_where_the_circle_is_cut(shift):
    distances = random_rays(11)
    here, there = label_curves(distances, JUMP), np.roll(label_curves(np.roll(distances, shift), JUMP), -shift)
    assert here.max() == there.max()
    assert len(set(zip(here, there, strict=True))) == len(set(here))


@settings(max_examples=100)
@given(DISTANCES, st.integers(1, 5), st.sampled_from([0.0, 0.7, 1.5, 4.0]))
def test_smoothing_agrees_with_walking_along_each_curve(distances, shortest, sigma):
    labels = label_curves(distances, JUMP)
    found = smooth_curves(distances, labels, JUMP, shortest, sigma)
    np.testing.assert_allclose(found, naive.smooth_curves(distances, JUMP, shortest, sigma), atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_smoothing_agrees_on_long_curves(seed):
    distances = random_rays(seed)
    found = smooth_curves(distances, label_curves(distances, JUMP), JUMP, 4, 1.5)
    np.testing.assert_allclose(found, naive.smooth_curves(distances, JUMP, 4, 1.5), atol=1e-12)


def smooth(distances, shortest=4, sigma=1.5):
    return smooth_curves(distances, label_curves(distances, JUMP), JUMP, shortest, sigma)


def test_short_curves_are_dropped():
    distances = np.full(40, math.inf)
    distances[2:5], distances[10:14], distances[38:], distances[0] = 1.0, 1.0, 1.0, 1.0
    kept = np.isfinite(smooth(distances))
    np.testing.assert_array_equal(np.flatnonzero(kept), np.arange(10, 14))
    np.testing.assert_array_equal(np.isfinite(smooth(distances, shortest=3)), np.isfinite(distances))


def test_smoothing_keeps_what_is_smooth():
    circle = np.full(120, 0.7)
    np.testing.assert_allclose(smooth(circle), circle, atol=1e-12)
    line = np.full(120, math.inf)
    line[30:70] = 0.5 + 0.01 * np.arange(40)
    np.testing.assert_allclose(smooth(line)[36:64], line[36:64], atol=1e-12)


def test_smoothing_takes_noise_away():
    rng = np.random.default_rng(12)
    circle = 0.7 + rng.uniform(-0.05, 0.05, 1200)
    expected = 1.0 / math.sqrt(2.0 * math.sqrt(math.pi) * 1.5)  # of a Gaussian's weights
    assert np.std(smooth(circle)) / np.std(circle) == pytest.approx(expected, rel=0.1)


def test_smoothing_does_not_cross_a_jump():
    for shift in range(0, 40, 3):
        step = np.roll(np.repeat([0.5, 0.9], 20), shift)
        np.testing.assert_allclose(smooth(step), step, atol=1e-12)
        spiral = np.roll(np.linspace(0.5, 1.5, 40), shift)  # one curve whose ends lie side by side
        smoothed = smooth(spiral)
        assert smoothed.min() >= 0.5
        np.testing.assert_allclose(smoothed, spiral, atol=0.06)


# The whole


def test_extracted_walls_are_those_of_the_room():
    """A laser in a rectangular room, fused and extracted, against exact intersection."""
    room, pose = naive.rectangle(0.1, 0.05, 1.5, 1.1), np.array([0.02, -0.03, 0.4])
    bearings = np.arange(0.0, 360.0, 1.5)
    local_map = LocalMap(
        LocalMapParams(reach=1.0, footprint=0.1),
        {"laser": RingParams(model="beam", bearings_deg=tuple(bearings), max_range=4.0)},
    )
    ranges = naive.cast(pose, room, 240, 4.0).distances
    for _ in range(4):
        local_map.fuse("laser", ranges, pose)
    walls = extract(local_map, pose, WallParams(n_rays=120))
    exact = naive.cast(pose, room, 120, 1.0)
    seen = np.isfinite(walls.distances) & np.isfinite(exact.distances)
    assert seen.sum() > 0.95 * np.isfinite(exact.distances).sum()
    assert np.median(np.abs(walls.distances - exact.distances)[seen]) < 0.5 * RESOLUTION
    assert np.quantile(np.abs(walls.distances - exact.distances)[seen], 0.95) < 2.0 * RESOLUTION
    assert np.all(walls.free <= exact.free + RESOLUTION)
    assert np.median(exact.free - walls.free) < 3.0 * RESOLUTION


def test_a_vertex_is_looked_at_from_where_it_was():
    room = naive.rectangle(0.0, 0.0, 1.2, 1.2)
    local_map = LocalMap(
        LocalMapParams(reach=0.8, footprint=0.1),
        {"laser": RingParams(model="beam", bearings_deg=tuple(np.arange(0.0, 360.0, 3.0)), max_range=4.0)},
        border=0.5,
    )
    for x in np.linspace(0.0, 0.4, 9):
        pose = np.array([x, 0.0, 0.0])
        local_map.move(pose)
        local_map.fuse("laser", naive.cast(pose, room, 120, 4.0).distances, pose)
    walls = extract(local_map, np.zeros(3), WallParams(n_rays=120))
    for ray in (0, 30, 60, 90):
        assert walls.distances[ray] == pytest.approx(0.6, abs=1.5 * RESOLUTION)


@settings(max_examples=100)
@given(DISTANCES)
def test_curves_hold_every_wall_once_and_turn_counter_clockwise(distances):
    found = curves(Walls(distances, np.zeros(distances.size)), JUMP)
    assert sum(len(curve) for curve in found) == np.isfinite(distances).sum()
    n, seen = distances.size, []
    for curve in found:
        rays = np.round(np.arctan2(curve[:, 1], curve[:, 0]) / (2.0 * math.pi) * n).astype(int) % n
        np.testing.assert_allclose(np.hypot(*curve.T), distances[rays], atol=1e-12)
        np.testing.assert_array_equal(np.diff(rays) % n, 1)
        assert np.all(np.abs(np.diff(distances[rays])) <= JUMP)
        seen += rays.tolist()
    assert sorted(seen) == np.flatnonzero(np.isfinite(distances)).tolist()


@pytest.mark.parametrize("shift", range(0, 40, 3))
def test_a_curve_all_round_starts_at_its_break(shift):
    spiral = np.roll(np.linspace(0.5, 1.5, 40), shift)
    (curve,) = curves(Walls(spiral, np.zeros(40)), JUMP)
    np.testing.assert_allclose(np.hypot(*curve.T), np.linspace(0.5, 1.5, 40))


def test_nothing_seen_is_no_curve():
    assert curves(Walls(np.full(120, math.inf), np.zeros(120))) == []
