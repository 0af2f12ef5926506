"""Maps that share patches hold what maps of their own would, and share as much as their particles have in common."""

import math

import numpy as np
import pytest

from slam.tree_map import HITS, MASK, NONE, SIDE, Rule, TreeMaps, clear, hit, patch_at
from tests.naive.tree_map import NaiveMap

RULE = Rule(free=0.4, occupied=0.9, most=2.5, memory=3.0)
RESOLUTION = 0.05


def write(maps, starts, cleared, ends, normals):
    """Beams of all particles: starts (n, 2), cleared (n, k, 2), ends and normals (n, m, 2)."""
    maps.prepare(starts, cleared, ends)
    for p in range(len(starts)):
        for end in cleared[p]:
            clear(maps.cells, p, starts[p, 0], starts[p, 1], end[0], end[1], 0.1, RULE)
        for end, normal in zip(ends[p], normals[p], strict=True):
            hit(maps.cells, p, end[0], end[1], normal[0], normal[1], RULE)


def beams(rng, n, middle):
    starts = middle + rng.uniform(-0.5, 0.5, (n, 2))
    angles, lengths = rng.uniform(-math.pi, math.pi, (n, 6)), rng.uniform(0.0, 4.0, (n, 6))
    ends = starts[:, None, :] + lengths[:, :, None] * np.stack([np.cos(angles), np.sin(angles)], axis=2)
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=2) * rng.integers(0, 2, (n, 6, 1))
    return starts, ends, ends, normals


def told(maps, particle, cell):
    patch = patch_at(maps.cells, particle, *cell)
    if patch == NONE:
        return 0.0, np.zeros(5)
    at = (cell[0] - maps.cells.row) & MASK, (cell[1] - maps.cells.column) & MASK
    return float(maps.cells.odds[patch, *at]), maps.cells.surfels[patch, *at]


def is_sound(maps):
    """Every patch is named as often as is counted, and is free if it is not named."""
    named = np.bincount(maps.cells.table[maps.cells.table != NONE], minlength=len(maps.pool.free))
    free = maps.pool.free[: maps.pool.top[0]]
    return (
        np.array_equal(named, maps.pool.references)
        and len(set(free.tolist())) == len(free)
        and set(free.tolist()) == set(np.flatnonzero(named == 0).tolist())
    )


def has_bits_for_surfels(maps):
    named = np.unique(maps.cells.table[maps.cells.table != NONE])
    bits = maps.cells.filled[named][:, :, None] >> np.arange(SIDE, dtype=np.uint32) & 1
    return np.array_equal(bits.astype(bool), maps.cells.surfels[named, :, :, HITS] > 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_all_that_beams_will_write_is_their_own(seed):
    rng = np.random.default_rng(seed)
    maps = TreeMaps(1, RESOLUTION)
    turns = np.concatenate([rng.uniform(-np.pi, np.pi, 200), np.arange(-4, 4) * np.pi / 4])
    ends = rng.uniform(0.0, 30.0, (208, 1)) * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    maps.prepare(np.array([[0.3, -0.2]]), ends[None], ends[None, :0])
    before = maps.n_patches
    for end in ends:
        for share in np.linspace(0.0, 1.0, 4000, endpoint=False):
            x, y = 0.3 + share * (end[0] - 0.3), -0.2 + share * (end[1] + 0.2)
            assert patch_at(maps.cells, 0, math.floor(y / RESOLUTION), math.floor(x / RESOLUTION)) != NONE
    touched = maps.cells.odds[maps.cells.table[maps.cells.table != NONE]]
    for end in ends:
        clear(maps.cells, 0, 0.3, -0.2, end[0], end[1], 0.0, RULE)
    named = maps.cells.table[maps.cells.table != NONE]
    written = np.count_nonzero(np.any(maps.cells.odds[named] != 0.0, axis=(1, 2)))
    assert not np.any(touched)
    assert 0.9 * before < written <= before  # what lies round a corner is taken now and then


@pytest.mark.parametrize("seed", range(4))
def test_a_drive_with_resamplings_leaves_what_whole_copies_hold(seed):
    rng = np.random.default_rng(seed)
    n = 5
    maps, twins = TreeMaps(n, RESOLUTION), [NaiveMap(RESOLUTION, RULE) for _ in range(n)]
    middle = np.zeros(2)
    for _ in range(12):
        middle = middle + rng.uniform(-3.0, 4.0, 2)  # beyond what the tables hold at first
        starts, cleared, ends, normals = beams(rng, n, middle)
        write(maps, starts, cleared, ends, normals)
        for p, twin in enumerate(twins):
            for end in cleared[p]:
                twin.clear(starts[p], end, 0.1)
            for end, normal in zip(ends[p], normals[p], strict=True):
                twin.hit(end, normal)
        if rng.random() < 0.5:
            ancestors = np.sort(rng.integers(0, n, n)).astype(np.int32)
            maps.inherit(ancestors)
            twins = [twins[a].copy() for a in ancestors]
        assert is_sound(maps)
        assert has_bits_for_surfels(maps)
    for p, twin in enumerate(twins):
        assert len(twin.odds) > 300
        for cell, odds in twin.odds.items():
            found, surfel = told(maps, p, cell)
            assert found == pytest.approx(odds, abs=1e-5)
            assert surfel == pytest.approx(twin.surfels.get(cell, np.zeros(5)), abs=1e-4)
        grid = maps.grid(p)
        assert np.count_nonzero(grid.cells) == sum(abs(odds) > 1e-5 for odds in twin.odds.values())
        row, column = next(iter(twin.odds))
        there = round(row - grid.y / RESOLUTION), round(column - grid.x / RESOLUTION)
        assert grid.cells[there] == pytest.approx(twin.odds[row, column], abs=1e-5)


def test_children_share_all_until_they_write_and_what_dies_is_free_again():
    maps = TreeMaps(40, RESOLUTION)
    rng = np.random.default_rng(1)
    start = np.zeros((40, 2))
    there = np.broadcast_to(rng.uniform(-8.0, 8.0, (60, 2)), (40, 60, 2))
    write(maps, start, there, there, np.ones_like(there))
    alone = maps.n_patches // 40
    maps.inherit(np.zeros(40, np.int32))
    assert maps.n_patches == alone
    near = np.full((40, 1, 2), 0.3)
    write(maps, start, near, near, np.ones_like(near))
    assert maps.n_patches == alone + 39  # the patch around the start, once each; the first particle keeps its own
    assert is_sound(maps)


def test_room_grows_and_nothing_is_lost():
    maps = TreeMaps(1, RESOLUTION)
    far = SIDE * RESOLUTION * np.arange(-40, 40)
    for x in far:
        for y in (-20.0, 0.0, 20.0, 40.0, 60.0):
            end = np.array([[[x + 0.5, y + 0.5]]])
            write(maps, end[:, 0], end, end, np.ones_like(end))
    assert maps.n_patches == 80 * 5 > 256
    assert np.count_nonzero(maps.grid(0).cells) == 80 * 5
    assert is_sound(maps)


def test_a_map_of_nothing_is_an_empty_grid():
    assert TreeMaps(2, RESOLUTION).grid(1).cells.size == 0


def test_beams_that_end_nowhere_are_refused():
    with pytest.raises(ValueError, match="begin and end somewhere"):
        TreeMaps(1, RESOLUTION).prepare(np.zeros((1, 2)), np.full((1, 1, 2), np.inf), np.zeros((1, 1, 2)))
