"""Scans are drawn as their beams one by one would be, into each particle's own map."""

import math

import numpy as np
import pytest

from slam.laser_maps import COARSEST, LaserMapParams, LaserMaps
from slam.pose import transform
from slam.tree_map import MASK, NONE, Rule, patch_at
from tests.naive.tree_map import NaiveMap
from tests.slam.laser_world import ring, scan_at


def twin_of(params):
    return NaiveMap(params.resolution, Rule(params.free, params.occupied, params.most, params.memory))


def draw_slowly(twin, scan, pose, clears):
    """Every beam: the k-th clears from where as many cells part it from the next that clears as well."""
    if clears:
        for k, end in enumerate(transform(pose, scan.swept)):
            fellows = 1
            while k % (2 * fellows) == 0 and fellows < COARSEST:
                fellows *= 2
            begin = 0.0 if fellows == COARSEST else 0.5 * twin.resolution / (scan.spacing * fellows)
            twin.clear(pose[:2], end, begin)
    turn = pose * [0.0, 0.0, 1.0]
    for end, normal in zip(transform(pose, scan.points), transform(turn, scan.normals), strict=True):
        twin.hit(end, normal)


@pytest.mark.parametrize("clears", [True, False])
def test_a_scan_is_drawn_beam_by_beam(clears):
    params, rng = LaserMapParams(), np.random.default_rng(3)
    maps, twins = LaserMaps(3, params), [twin_of(params) for _ in range(3)]
    for step in range(3):
        scan = scan_at(np.array([2.0 + 0.3 * step, 1.0, 0.1 * step]), ring(), step)
        poses = rng.uniform([-0.5, -0.5, -math.pi], [0.5, 0.5, math.pi], (3, 3))
        maps.draw(scan, poses, clears)
        for pose, twin in zip(poses, twins, strict=True):
            draw_slowly(twin, scan, pose, clears)
    differ, n_cells = 0, 0
    for particle, twin in enumerate(twins):
        for cell, odds in twin.odds.items():
            patch = patch_at(maps.cells, particle, *cell)
            assert patch != NONE
            at = (cell[0] - maps.cells.row) & MASK, (cell[1] - maps.cells.column) & MASK
            n_cells += 1
            differ += abs(float(maps.cells.odds[patch, *at]) - odds) > 1e-4
    assert n_cells > 3000 if clears else n_cells > 300
    assert differ <= 0.002 * n_cells  # a point on the border of two cells may be rounded into either


def test_threads_may_share_the_particles_out():
    scan, poses = scan_at(np.array([2.0, 1.0, 0.1]), ring()), np.zeros((5, 3))
    alone, shared = LaserMaps(5, LaserMapParams()), LaserMaps(5, LaserMapParams())
    alone.draw(scan, poses)
    shared.draw(scan, poses, run=lambda task: [task(0, 2), task(2, 5)])
    for particle in range(5):
        assert alone.grid(particle).cells.tobytes() == shared.grid(particle).cells.tobytes()
