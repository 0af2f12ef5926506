"""Buildings made of shapes: walls stand where the shapes end, drives keep clear of them and come back, seeds differ."""

import math

import numpy as np
import pytest

from firmware.virtual import VirtualCrunch
from firmware.virtual.buildings import round_corridor, slanted_wings
from firmware.virtual.floorplan import Box, Disc, Floor, Ring
from firmware.virtual.lanes import parallel_corridors
from firmware.virtual.museum import museum
from firmware.virtual.plans import Plan
from slam.evaluate import revisit_pairs

BUILDINGS = {"slanted": slanted_wings, "round": round_corridor, "museum": museum, "parallel": parallel_corridors}
PLACES = [(name, seed) for name in BUILDINGS for seed in range(6)]
BODY = 0.13  # m, of the decks
SHAPES = [Box(0.4, -0.2, 0.7, 2.0, 1.0), Disc(0.3, 0.1, 0.8), Ring(-0.2, 0.3, 1.2, 0.5)]


def lengths_and_angles(world):
    """Of all walls."""
    along = world.segments[:, 2:] - world.segments[:, :2]
    return np.hypot(*along.T), np.arctan2(along[:, 1], along[:, 0])


def regularity(world):
    """Resultant of the wall directions modulo 90 degrees: 1 when all are parallel or at right angles, 0 when any."""
    lengths, angles = lengths_and_angles(world)
    return abs(np.sum(lengths * np.exp(4j * angles))) / np.sum(lengths)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_a_shapes_distance_is_that_of_its_traced_wall(shape):
    """Where the border is near, on either side of it."""
    floor = Floor()
    floor.carve(shape)
    world = floor.world(Plan.through(np.array([[0.0, 0.0], [1.0, 0.0]])), "shape")
    rng = np.random.default_rng(1)
    points = rng.uniform(-2.0, 2.0, (2000, 2))
    distances = np.abs(shape.distances(points[:, 0], points[:, 1]))
    near = distances < 0.15
    assert near.sum() > 100
    assert world.clearances(points[near], 1.0) == pytest.approx(distances[near], abs=0.02)


def test_what_is_built_after_carving_is_solid_again():
    floor = Floor()
    floor.carve(Box(0.0, 0.0, 0.0, 4.0, 4.0))
    floor.build(Disc(1.0, 0.0, 0.3))
    floor.carve(Box(0.0, 2.5, 0.0, 1.0, 1.2))
    world = floor.world(Plan.through(np.array([[0.0, 0.0], [1.0, 0.0]])), "hall")
    assert world.cast(0.0, 0.0, np.array([0.0, math.pi / 2, math.pi])) == pytest.approx([0.7, 3.1, 2.0], abs=0.02)


@pytest.mark.parametrize(("name", "seed"), PLACES)
def test_the_drive_keeps_clear_of_the_walls_and_comes_back(name, seed):
    world, plan = BUILDINGS[name](seed)
    assert world.clearances(plan.points, 2.0).min() > BODY + 0.04
    steps = np.diff(plan.points, axis=0)
    room = world.cast(plan.points[:-1, 0], plan.points[:-1, 1], np.arctan2(steps[:, 1], steps[:, 0]))
    assert np.all(room > np.hypot(*steps.T)), "a wall is crossed"
    assert 90.0 < plan.length < 200.0
    poses = np.column_stack([plan.points, np.zeros(len(plan.points))])
    later, _ = revisit_pairs(poses, 0.5, 20.0)
    assert len(later) * 0.25 > 0.25 * plan.length


@pytest.mark.parametrize("name", BUILDINGS)
def test_a_seed_is_one_building_and_another_seed_another(name):
    one, again, other = (BUILDINGS[name](seed) for seed in (4, 4, 6))
    np.testing.assert_array_equal(one.world.segments, again.world.segments)
    np.testing.assert_array_equal(one.plan.points, again.plan.points)
    assert other.world.segments.shape != one.world.segments.shape
    assert not np.array_equal(other.plan.points[:50], one.plan.points[:50])


def test_walls_have_the_directions_that_the_names_promise():
    for seed in range(6):
        assert regularity(slanted_wings(seed).world) < 0.6
        assert regularity(round_corridor(seed).world) < 0.35
        assert regularity(museum(seed).world) < 0.5
        assert regularity(parallel_corridors(seed).world) > 0.9


@pytest.mark.parametrize("seed", range(4))
def test_slanted_wings_have_two_pairs_of_directions(seed):
    lengths, angles = lengths_and_angles(slanted_wings(seed).world)
    shares, edges = np.histogram(np.degrees(angles) % 90.0, 18, (-2.5, 87.5), weights=lengths)
    first, second = np.sort(np.argsort(shares)[-2:])
    assert shares[[first, second]].sum() > 0.7 * lengths.sum()
    assert 25.0 <= edges[second] - edges[first] <= 55.0


@pytest.mark.parametrize("seed", range(4))
def test_parallel_corridors_are_driven_less_than_two_metres_apart_with_a_wall_between(seed):
    world, plan = parallel_corridors(seed)
    points = plan.points[::5]
    apart = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    toward = points[None] - points[:, None]
    bearings = np.arctan2(toward[..., 1], toward[..., 0])
    behind = world.cast(points[:, None, 0], points[:, None, 1], bearings, 3.0) < apart
    assert np.mean(np.any(behind & (apart < 1.9), axis=1)) > 0.5


def test_the_virtual_robot_drives_the_narrowest_of_them_to_the_end():
    """From its start, as far as two minutes go, without a fall and never far from the plan."""
    world, plan = parallel_corridors(0)
    robot = VirtualCrunch(world, seed=1, drift="high", plan=plan)
    robot.advance(120.0)
    assert robot.state == "armed"
    _, poses = robot.truth()
    off = np.min(np.hypot(*(poses[::50, None, :2] - plan.points[None, ::2]).transpose(2, 0, 1)), axis=1)
    assert off.max() < 0.2
    assert np.sum(np.hypot(*np.diff(poses[:, :2], axis=0).T)) > 25.0
