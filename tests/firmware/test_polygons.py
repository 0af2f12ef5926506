"""Rooms that are polygons: each seed has its own, with room for a cart, and walls are outlines that close."""

from __future__ import annotations

import numpy as np
import pytest

from firmware.virtual import World, WorldError, load_world, run_cart
from firmware.virtual.bumper_cart import random_start
from firmware.virtual.polygons import LEAST_WALL, SIDE, area, inside, turns

SEEDS = range(20)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_polygon_is_as_large_as_told_and_convex_for_even_seeds_only(seed):
    room = load_world(f"polygon:{seed}")
    [outline] = room.walls
    assert np.ptp(outline, axis=0).max() == pytest.approx(SIDE)
    assert np.hypot(*(np.roll(outline, -1, axis=0) - outline).T).min() >= LEAST_WALL
    assert area(outline) > 0.8
    turned = turns(outline)
    assert turned.sum() == pytest.approx(2 * np.pi)
    assert bool(turned.min() > 0.0) == (seed % 2 == 0)
    assert inside(room.segments, room.start[None, :2])[0]


def test_the_same_seed_is_the_same_room_and_no_two_are_alike():
    assert np.array_equal(load_world("polygon:5").segments, load_world("polygon:5").segments)
    assert len({load_world(f"polygon:{seed}").segments.tobytes() for seed in SEEDS}) == len(SEEDS)


@pytest.mark.parametrize("seed", range(10))
def test_a_cart_gets_around_in_each(seed):
    room = load_world(f"polygon:{seed}")
    stages, truth = run_cart(room, seed, 40)
    assert sum(stage.kind == 0 and stage.bumper != 0 for stage in stages) == 40
    assert np.all(inside(room.segments, truth[:, :2]))
    assert np.all(np.ptp(truth[:, :2], axis=0) > 0.4)


def test_a_cart_begins_anywhere_with_room_to_turn():
    room = load_world("cut-rectangle")
    starts = np.array([random_start(room, seed) for seed in range(300)])
    assert room.clearances(np.ascontiguousarray(starts[:, :2]), 1.0).min() > 0.1
    assert np.all(np.ptp(starts, axis=0) > [1.1, 0.75, 6.0])
    assert np.array_equal(random_start(room, 7), starts[7])


@pytest.mark.parametrize("name", ["polygon:", "polygon:x", "polygon:-1", "polygon:1:2"])
def test_a_name_of_no_polygon_is_told(name):
    with pytest.raises(WorldError, match=f"{name}: names no polygon; write polygon:3"):
        load_world(name)


def test_walls_are_joined_to_outlines_the_largest_first_whichever_way_they_are_given():
    square = np.array([[0, 0], [2, 0], [2, 2], [0, 2]], float)
    pillar = 0.5 + 0.25 * square[::-1]
    rows = np.concatenate([np.column_stack([c, np.roll(c, -1, axis=0)]) for c in (pillar, square)])
    rows[2] = rows[2, [2, 3, 0, 1]]
    rng = np.random.default_rng(1)
    outlines = World(rows[rng.permutation(len(rows))]).walls
    assert [abs(area(outline)) for outline in outlines] == pytest.approx([4.0, 0.25])
    assert {tuple(corner) for corner in outlines[1]} == {tuple(corner) for corner in pillar}


def test_walls_with_an_open_end_are_told_where():
    with pytest.raises(WorldError, match=r"gap: 0 walls go on at \(2\.000, 2\.000\)"):
        _ = World(np.array([[0, 0, 2, 0], [2, 0, 2, 2]], float), name="gap").walls


def test_a_rectangle_is_itself_when_it_is_turned_by_half_a_turn_and_the_cut_one_is_not():
    for name, same in (("rectangle", True), ("cut-rectangle", False)):
        [outline] = load_world(name).walls
        turned = outline.min(axis=0) + outline.max(axis=0) - outline
        assert ({tuple(c) for c in turned.round(6)} == {tuple(c) for c in outline.round(6)}) == same
