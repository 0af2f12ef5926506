"""Scans are drawn as their beams one by one would be, into each particle's own map."""

import math

import numpy as np
import pytest

from slam.laser_maps import LaserMapParams, LaserMaps, draw_scan
from slam.pose import transform
from slam.tree_map import MASK, NONE, Rule, patch_at
from tests.naive import laser_maps as naive
from tests.naive.tree_map import NaiveMap
from tests.slam.laser_world import ring, scan_at


def twin_of(params):
    return NaiveMap(params.resolution, Rule(params.free, params.occupied, params.most, params.memory))


def read(maps, particle, cell):
    """What a map has in a cell: log odds and surfel (6,)."""
    patch = patch_at(maps.cells, particle, *cell)
    assert patch != NONE
    at = (cell[0] - maps.cells.row) & MASK, (cell[1] - maps.cells.column) & MASK
    return np.array([maps.cells.odds[patch, *at], *maps.cells.surfels[patch, *at]])


@pytest.mark.parametrize("clears", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_a_scan_is_drawn_beam_by_beam(seed, clears):
    params, rng = LaserMapParams(), np.random.default_rng(seed)
    maps, twins = LaserMaps(3, params), [twin_of(params) for _ in range(3)]
    for step in range(3):
        scan = scan_at(np.array([2.0 + 0.3 * step, 1.0, 0.1 * step]), ring(), 10 * seed + step)
        poses = rng.uniform([-0.5, -0.5, -math.pi], [0.5, 0.5, math.pi], (3, 3))
        maps.draw(scan, poses, clears)
        for pose, twin in zip(poses, twins, strict=True):
            naive.draw_scan(twin, scan, pose, clears)
    assert sum(len(twin.odds) for twin in twins) > (3000 if clears else 300)
    for particle, twin in enumerate(twins):
        found = [read(maps, particle, cell) for cell in twin.odds]
        expected = [[odds, *twin.surfels.get(cell, np.zeros(5))] for cell, odds in twin.odds.items()]
        np.testing.assert_allclose(found, expected, atol=1e-4)
        written = np.count_nonzero(np.abs(maps.grid(particle).cells) > 1e-5)
        assert written == np.count_nonzero(np.abs(list(twin.odds.values())) > 1e-5)  # and nowhere else


@pytest.mark.parametrize("seed", range(3))
def test_only_the_particles_that_are_asked_for_are_drawn(seed):
    params, rng = LaserMapParams(), np.random.default_rng(seed)
    scan, poses = scan_at(np.array([2.0, 1.0, 0.1]), ring(), seed), rng.uniform(-0.5, 0.5, (5, 3))
    first, end = sorted(int(each) for each in rng.choice(6, 2, replace=False))
    maps, all_drawn = LaserMaps(5, params), LaserMaps(5, params)
    all_drawn.draw(scan, poses)
    maps.prepare(poses[:, :2], transform(poses[:, None], scan.swept), transform(poses[:, None], scan.points))
    draw_scan(maps.cells, scan, True, poses, maps.rule, first, end)
    for particle in range(5):
        cells = maps.grid(particle).cells
        assert np.array_equal(cells, all_drawn.grid(particle).cells) if first <= particle < end else not np.any(cells)


def test_threads_may_share_the_particles_out():
    scan, poses = scan_at(np.array([2.0, 1.0, 0.1]), ring()), np.zeros((5, 3))
    alone, shared = LaserMaps(5, LaserMapParams()), LaserMaps(5, LaserMapParams())
    alone.draw(scan, poses)
    shared.draw(scan, poses, run=lambda task: [task(0, 2), task(2, 5)])
    for particle in range(5):
        assert alone.grid(particle).cells.tobytes() == shared.grid(particle).cells.tobytes()
