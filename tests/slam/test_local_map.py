"""The local map: kernels are their twins', evidence turns and moves with the robot, and nothing passes the clamp."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.grid import Grid
from slam.local_map import (
    BEAM,
    INFRARED,
    SONAR,
    Beam,
    Evidence,
    Ring,
    clear_disc,
    fuse_beam,
    fuse_cone,
    fuse_ring,
)
from tests.naive import local_map as naive

RESOLUTION = 0.025
EVIDENCE = Evidence(
    clamp=2.5,
    beam_hit=0.9,
    beam_miss=0.35,
    sonar_hit=0.1,
    sonar_miss=0.12,
    sonar_silent_miss=0.4,
    sonar_silent_reach=0.33,
    silent_reach=0.875,
    sonar_arc=0.04,
    sonar_margin=0.06,
)
BEARINGS = np.radians([0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0])
RINGS = {
    SONAR: Ring(SONAR, BEARINGS, 0.07, 0.152, math.radians(22.5), 0.03, 3.0),
    INFRARED: Ring(INFRARED, BEARINGS, 0.05, 0.203, 0.0, 0.10, 0.80),
    BEAM: Ring(BEAM, BEARINGS, 0.0, 0.2, 0.0, 0.05, 4.0),
}


def empty(n=48, x=-0.6, y=-0.6):
    """An unknown grid of n x n cells."""
    return Grid(np.zeros((n, n), np.float32), RESOLUTION, x, y)


def noisy(seed, n=48):
    """A grid of random log odds within the clamp."""
    cells = np.random.default_rng(seed).uniform(-2.5, 2.5, (n, n)).astype(np.float32)
    return Grid(cells, RESOLUTION, -0.5 * n * RESOLUTION, -0.5 * n * RESOLUTION)


def both(grid):
    """The grid twice, for a kernel and for its twin."""
    return grid._replace(cells=grid.cells.copy()), grid._replace(cells=grid.cells.copy())


def turned(grid):
    """The grid a right angle further counter-clockwise about its middle; rows are y."""
    return grid._replace(cells=np.ascontiguousarray(np.rot90(grid.cells, -1)))


def beam_from(rng, free, echo):
    """A beam from anywhere near the middle to anywhere."""
    return Beam(rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), rng.uniform(-9.0, 9.0), free, echo)


def value_at(grid, x, y):
    place = naive.cell_of(grid, x, y)
    assert place is not None
    return float(grid.cells[place])


# Fusing one reading


@pytest.mark.parametrize("seed", range(25))
def test_a_beam_agrees_with_point_by_point(seed):
    rng = np.random.default_rng(seed)
    grid, twin = both(noisy(seed, 30))
    echo = math.inf if seed % 5 == 0 else rng.uniform(0.05, 0.9)
    free = rng.uniform(-0.1, 0.8) if math.isinf(echo) else echo - 0.1
    beam, sigma = beam_from(rng, free, echo), rng.uniform(0.01, 0.1)
    fuse_beam(grid, beam, sigma, EVIDENCE)
    naive.fuse_beam(twin, beam, sigma, EVIDENCE)
    np.testing.assert_allclose(grid.cells, twin.cells, atol=1e-6)


@pytest.mark.parametrize("seed", range(25))
def test_a_cone_agrees_with_cell_by_cell(seed):
    rng = np.random.default_rng(seed)
    grid, twin = both(noisy(seed, 30))
    echo = math.inf if seed % 5 == 0 else rng.uniform(0.05, 0.9)
    free = rng.uniform(0.0, 0.8) if math.isinf(echo) else echo - 0.06
    beam, half_angle = beam_from(rng, free, echo), rng.uniform(0.1, 0.8)
    fuse_cone(grid, beam, half_angle, 0.12, EVIDENCE)
    naive.fuse_cone(twin, beam, half_angle, 0.12, EVIDENCE)
    np.testing.assert_allclose(grid.cells, twin.cells, atol=1e-6)


@pytest.mark.parametrize("eighth", range(16))
def test_a_cone_whose_edges_lie_along_the_cells_agrees_with_cell_by_cell(eighth):
    grid, twin = both(noisy(eighth, 30))
    beam = Beam(0.0213, 0.0057, eighth * math.pi / 8, 0.4, 0.5)
    fuse_cone(grid, beam, math.pi / 8, 0.12, EVIDENCE)
    naive.fuse_cone(twin, beam, math.pi / 8, 0.12, EVIDENCE)
    np.testing.assert_allclose(grid.cells, twin.cells, atol=1e-6)


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.211, -0.107), (0.59, 0.59), (-0.9, 0.0)])
def test_the_footprint_agrees_with_cell_by_cell(place):
    grid, twin = both(noisy(6))
    clear_disc(grid, place[0], place[1], 0.12, 2.5)
    naive.clear_disc(twin, place[0], place[1], 0.12, 2.5)
    np.testing.assert_array_equal(grid.cells, twin.cells)


def test_readings_that_leave_the_grid_are_cut_there():
    for model, ring in RINGS.items():
        grid = empty(16, -0.2, -0.2)
        fuse_ring(grid, (0.15, 0.15, 0.3), 0.0, ring, np.full(8, 0.7), EVIDENCE)
        assert grid.cells.any(), model
        fuse_ring(grid, (5.0, -7.0, 0.3), 0.0, ring, np.full(8, 0.7), EVIDENCE)


# Fusing sweeps


@pytest.mark.parametrize("model", [SONAR, INFRARED, BEAM])
def test_an_upright_ring_is_its_readings(model):
    ring, pose = RINGS[model], (0.013, -0.021, 0.4)
    ranges = np.array([0.5, math.inf, 0.7, math.nan, 0.02, 0.35, 5.0, 0.6])
    grid, twin = both(empty(80, -1.0, -1.0))
    fuse_ring(grid, pose, 0.0, ring, ranges, EVIDENCE)
    for i, reading in enumerate(ranges):
        echo = naive.trusted(ring, reading)
        if echo is None:
            continue
        bearing = pose[2] + BEARINGS[i]
        x, y = pose[0] + ring.offset * math.cos(bearing), pose[1] + ring.offset * math.sin(bearing)
        free = naive.free_upright(ring, echo, EVIDENCE)
        if model == SONAR:
            miss = EVIDENCE.sonar_miss * (EVIDENCE.sonar_silent_miss if math.isinf(echo) else 1.0)
            naive.fuse_cone(twin, Beam(x, y, bearing, free, echo), ring.half_angle, miss, EVIDENCE)
        else:
            beam = Beam(x, y, bearing, free - RESOLUTION, echo)
            naive.fuse_beam(twin, beam, naive.sigma_of(ring, echo), EVIDENCE)
    np.testing.assert_allclose(grid.cells, twin.cells, atol=1e-6)


@pytest.mark.parametrize("model", [SONAR, INFRARED, BEAM])
@pytest.mark.parametrize("tilt", [-0.25, -0.1, 0.1, 0.25])
def test_a_leaning_beam_ends_where_geometry_in_space_says(model, tilt):
    """A body leans about the axle; places on the floor are right within a cell."""
    ring, echo = RINGS[model], 0.6 if abs(tilt) < 0.2 else 0.4
    for i in range(8):
        foot, direction = naive.beam_in_space(tilt, ring, i)
        end = foot + echo * direction
        grid = empty(64, -0.8, -0.8)
        ranges = np.full(8, math.nan)
        ranges[i] = echo
        fuse_ring(grid, (0.0, 0.0, 0.0), tilt, ring, ranges, EVIDENCE)
        if end[2] < 0.1 * ring.height:
            assert not (grid.cells > 0.0).any()
            continue
        rows, columns = np.nonzero(grid.cells > 0.0)
        walls = np.stack([grid.x + (columns + 0.5) * RESOLUTION, grid.y + (rows + 0.5) * RESOLUTION], axis=1)
        weights = grid.cells[rows, columns] ** 2
        off = np.average(walls, axis=0, weights=weights) - end[:2]
        bearing = direction[:2] / np.hypot(*direction[:2])
        assert abs(off @ bearing) < 1.2 * RESOLUTION
        assert abs(off @ [-bearing[1], bearing[0]]) < 1.2 * RESOLUTION


@pytest.mark.parametrize("model", [SONAR, INFRARED, BEAM])
def test_an_echo_from_the_floor_is_no_wall(model):
    ring, tilt = RINGS[model], 0.35
    floor = ring.height / math.sin(tilt)
    ranges = np.full(8, math.nan)
    ranges[0] = floor
    assert ring.min_range < floor < ring.max_range
    grid = empty(80, -1.0, -1.0)
    fuse_ring(grid, (0.0, 0.0, 0.0), tilt, ring, ranges, EVIDENCE)
    assert not (grid.cells > 0.0).any()
    rows, columns = np.nonzero(grid.cells < 0.0)
    freed = np.hypot(grid.x + (columns + 0.5) * RESOLUTION, grid.y + (rows + 0.5) * RESOLUTION)
    assert 0.0 < freed.max() <= floor + ring.offset + ring.height * math.sin(tilt)
    ranges[0], ranges[4] = math.nan, floor  # the beam behind looks up
    fuse_ring(grid, (0.0, 0.0, 0.0), tilt, ring, ranges, EVIDENCE)
    assert (grid.cells > 0.0).any()


@pytest.mark.parametrize("model", [SONAR, INFRARED, BEAM])
def test_what_was_not_measured_or_is_too_near_says_nothing(model):
    grid = empty()
    for reading in (math.nan, 0.0, 0.99 * RINGS[model].min_range, -1.0, -math.inf):
        fuse_ring(grid, (0.0, 0.0, 0.0), 0.0, RINGS[model], np.full(8, reading), EVIDENCE)
    assert not grid.cells.any()


@pytest.mark.parametrize("model", [SONAR, INFRARED, BEAM])
@pytest.mark.parametrize("reading", [math.inf, 5.0])
def test_no_return_frees_a_part_of_the_range_and_makes_no_wall(model, reading):
    ring = RINGS[model]
    grid = empty(360, -4.5, -4.5)
    fuse_ring(grid, (0.0, 0.0, 0.0), 0.0, ring, np.full(8, reading), EVIDENCE)
    rows, columns = np.nonzero(grid.cells)
    reach = np.hypot(grid.x + (columns + 0.5) * RESOLUTION, grid.y + (rows + 0.5) * RESOLUTION).max()
    share = EVIDENCE.sonar_silent_reach if model == SONAR else EVIDENCE.silent_reach
    assert reach == pytest.approx(ring.offset + share * ring.max_range, abs=2.0 * RESOLUTION)
    assert (grid.cells <= 0.0).all()


def test_a_silent_sonar_says_less_than_an_echo_beyond():
    cells = []
    for reading in (math.inf, 2.9):
        grid = empty()
        fuse_ring(grid, (0.0, 0.0, 0.0), 0.0, RINGS[SONAR], np.full(8, reading), EVIDENCE)
        cells.append(value_at(grid, 0.3, 0.0))
    assert cells[1] < cells[0] < 0.0


def test_infrared_makes_sharper_walls_than_sonar():
    peaks = {}
    for model in (SONAR, INFRARED):
        grid = empty(80, -1.0, -1.0)
        for _ in range(5):
            fuse_ring(grid, (0.0, 0.0, 0.0), 0.0, RINGS[model], np.full(8, 0.5), EVIDENCE)
        peaks[model] = grid.cells.max()
        assert value_at(grid, 0.3, 0.0) < -0.2
    assert peaks[INFRARED] > 2.0 * peaks[SONAR]


@settings(max_examples=60)
@given(
    st.sampled_from([SONAR, INFRARED, BEAM]),
    st.lists(st.lists(st.floats(0.0, 4.0) | st.just(math.inf), min_size=8, max_size=8), min_size=1, max_size=12),
    st.floats(-0.5, 0.5),
)
def test_no_reading_passes_the_clamp(model, sweeps, tilt):
    grid = noisy(7)
    for k, sweep in enumerate(sweeps):
        fuse_ring(grid, (0.1, -0.1, 0.5 * k), tilt, RINGS[model], np.array(sweep), EVIDENCE)
    assert np.all(np.abs(grid.cells) <= 2.5)
    assert np.all(np.isfinite(grid.cells))


def test_new_readings_soon_overrule_the_clamp():
    """Pseudo-Bayes (thesis, 2.1): a cell that is as free as can be turns into a wall after a few hits, and back."""
    grid = empty()
    grid.cells[:] = -EVIDENCE.clamp
    ranges = np.full(8, math.nan)
    ranges[0] = 0.4
    for _ in range(4):
        fuse_ring(grid, (0.0, 0.0, 0.0), 0.0, RINGS[INFRARED], ranges, EVIDENCE)
    assert value_at(grid, 0.45, 0.0) > 0.6
    ranges[0] = math.inf
    for _ in range(10):
        fuse_ring(grid, (0.0, 0.0, 0.0), 0.0, RINGS[INFRARED], ranges, EVIDENCE)
    assert value_at(grid, 0.45, 0.0) < -0.3


@pytest.mark.parametrize("model", [SONAR, INFRARED, BEAM])
@pytest.mark.parametrize("tilt", [0.0, 0.1])
def test_turning_robot_and_grid_by_a_right_angle_turns_the_evidence(model, tilt):
    ranges = np.random.default_rng(8).uniform(0.2, 0.9, 8)
    grid, world = both(noisy(8))
    x, y, theta = 0.0131, -0.0417, 0.37
    world = turned(world)
    fuse_ring(grid, (x, y, theta), tilt, RINGS[model], ranges, EVIDENCE)
    fuse_ring(world, (-y, x, theta + math.pi / 2), tilt, RINGS[model], ranges, EVIDENCE)
    np.testing.assert_allclose(turned(grid).cells, world.cells, atol=1e-6)


def test_moving_robot_and_grid_together_changes_nothing():
    ranges = np.random.default_rng(9).uniform(0.2, 0.9, 8)
    for ring in RINGS.values():
        here, there = empty(), empty(48, 31.4, -64.6)
        fuse_ring(here, (0.011, 0.007, 0.2), 0.0, ring, ranges, EVIDENCE)
        fuse_ring(there, (32.011, -63.993, 0.2), 0.0, ring, ranges, EVIDENCE)
        np.testing.assert_allclose(there.cells, here.cells, atol=1e-5)
