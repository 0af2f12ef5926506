"""A scan is laid where a particle's map has its walls, and its misfit is told."""

import numpy as np
import pytest

from slam.map_matching import LayParams, is_free, lay, wall_near
from slam.pose import between, compose, transform
from slam.tree_map import MASK, TreeMaps, clear, hit
from slam.tree_map import Rule as MapRule
from tests.naive import map_matching as naive
from tests.slam.laser_world import blind, ring, scan_at

MAP = MapRule(0.4, 0.9, 4.0, 500.0)
RULE = LayParams().rule()
FREE = np.diag([1e-3, 1e-3, 1e-3])


def drawn():
    """A map of what was seen on a few steps."""
    maps = TreeMaps(1, 0.05)
    for step in range(8):
        pose = np.array([1.0 + 0.2 * step, 1.0, 0.02 * step])
        scan = scan_at(pose, ring(), step)
        ends = transform(pose, scan.points)
        maps.prepare(pose[None, :2], ends[None], ends[None])
        for end, normal in zip(ends, transform(pose * [0.0, 0.0, 1.0], scan.normals), strict=True):
            clear(maps.cells, 0, pose[0], pose[1], end[0], end[1], 0.0, MAP)
            hit(maps.cells, 0, end[0], end[1], normal[0], normal[1], MAP)
    return maps


def test_the_wall_near_a_point_is_that_of_all_surfels_around():
    maps, rng = drawn(), np.random.default_rng(2)
    cells = maps.cells
    surfels = cells.surfels[np.unique(cells.table[cells.table >= 0])].reshape(-1, 5)
    surfels = surfels[surfels[:, 0] > 0.0].astype(float)
    found = 0
    for _ in range(600):
        x, y = surfels[rng.integers(len(surfels)), 1:3] + 0.08 * rng.standard_normal(2)
        angle, reach = rng.uniform(-np.pi, np.pi), rng.uniform(1.0, 4.0)
        normal = np.array([np.cos(angle), np.sin(angle)]) * rng.integers(0, 2)
        wall = np.empty(3)
        is_there = wall_near(cells, 0, x, y, normal[0], normal[1], reach, wall)
        twin = naive.wall_near(surfels, x, y, normal, 0.05 * reach)
        assert is_there == (twin is not None)
        if twin is not None:
            assert wall == pytest.approx(twin, abs=1e-5)
            found += 1
    assert found > 200


@pytest.mark.parametrize("seed", range(8))
def test_a_scan_is_laid_where_it_was_taken(seed):
    rng = np.random.default_rng(seed)
    maps, pose = drawn(), np.array([1.9, 1.05, 0.1])
    scan = scan_at(pose, ring(), 100 + seed)
    off = rng.uniform([-0.1, -0.1, -0.06], [0.1, 0.1, 0.06])
    there, hessian = compose(pose, off), np.empty((3, 3))
    cost = lay(maps.cells, 0, scan, there, FREE, RULE, hessian)
    error = between(pose, there)
    assert np.hypot(*error[:2]) < 0.02
    assert abs(error[2]) < 0.005
    elsewhere = compose(pose, np.array([0.0, 0.6, 0.4]))
    assert cost < 0.5 * lay(maps.cells, 0, scan, elsewhere, 1e6 * np.eye(3), RULE, np.empty((3, 3)))
    assert np.all(np.linalg.eigvalsh(hessian) > 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_scan_is_laid_as_matrices_have_it(seed):
    rng = np.random.default_rng(seed)
    cells = drawn().cells
    surfels = cells.surfels[np.unique(cells.table[cells.table >= 0])].reshape(-1, 5)
    surfels = surfels[surfels[:, 0] > 0.0].astype(float)
    whole = scan_at(np.array([1.9, 1.05, 0.1]), ring(), 100 + seed)
    some = np.sort(rng.choice(len(whole.points), 40, replace=False))
    scan = whole._replace(points=whole.points[some], normals=whole.normals[some])
    guess = np.array([1.9, 1.05, 0.1]) + rng.uniform([-0.1, -0.1, -0.06], [0.1, 0.1, 0.06])
    prior = np.diag(rng.uniform(1.0, 1e3, 3)) + 0.5
    pose, hessian = guess.copy(), np.empty((3, 3))
    cost = lay(cells, 0, scan, pose, prior, RULE, hessian)
    told = naive.lay(surfels, lambda x, y: is_free(cells, 0, x, y), scan, guess, prior, RULE)
    assert pose == pytest.approx(told[0], abs=1e-5)
    assert hessian == pytest.approx(told[1], rel=1e-3)
    assert cost == pytest.approx(told[2], rel=1e-4)


def test_the_cost_tells_walls_missing_in_free_space_from_those_in_the_unknown():
    maps = drawn()
    scan = scan_at(np.array([1.6, 1.0, 0.1]), ring(), 5)
    tight, hessian = 1e9 * np.eye(3), np.empty((3, 3))
    unknown = lay(maps.cells, 0, scan, np.array([100.0, 100.0, 0.0]), tight, RULE, hessian)
    assert unknown == pytest.approx(RULE.unknown * len(scan.points))
    most = 0.5 * (RULE.kernel / RULE.sigma) ** 2
    cells = maps.cells
    for patch in np.unique(cells.table[cells.table >= 0]):  # as if all had been free
        cells.surfels[patch] = 0.0
        cells.odds[patch] = -1.0
    ends = transform(np.array([1.6, 1.0, 0.1]), scan.points)
    rows, columns = np.floor(ends[:, ::-1] / 0.05).astype(int).T
    inside = [
        cells.table[0, (r - cells.row) >> 5, (c - cells.column) >> 5] >= 0 for r, c in zip(rows, columns, strict=True)
    ]
    expected = most * np.sum(inside) + RULE.unknown * np.sum(~np.array(inside))
    assert lay(cells, 0, scan, np.array([1.6, 1.0, 0.1]), tight, RULE, hessian) == pytest.approx(expected)
    assert MASK == 31


def test_an_empty_scan_stays_where_it_is_thought_to_be():
    pose, hessian = np.array([1.0, 2.0, 0.3]), np.empty((3, 3))
    nothing = blind()
    assert lay(drawn().cells, 0, nothing, pose, FREE, RULE, hessian) == 0.0
    assert np.array_equal(pose, [1.0, 2.0, 0.3])
    assert np.array_equal(hessian, FREE)
