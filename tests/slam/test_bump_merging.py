"""Several carts' maps made one: frames are found by the walls, doubt is told, and more carts make a better map."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.bump_mapper import BumpMap, BumpMapper, BumpMapperParams, segments_of
from slam.bump_merging import LEAST_SHARED, BumpMergingParams, corrected, frame_of, merge, moved_line, near_share
from slam.bump_swarm import BEYOND, COLUMNS, HIGH, HITS, LOW, PHI, X, Y
from slam.bump_walls import map_error, points_on, stretches, walls_of
from slam.cart_odometry import CartParams, bumps_of
from slam.evaluate import alignment
from slam.pose import compose, inverse, transform, wrap
from tests.naive import bumps_felt as naive
from tests.slam.bump_world import AREAS, edges_of, rectangle, run

MODEL = BumpMapperParams().model(CartParams())
MERGING = BumpMergingParams()


def drawn(corners: np.ndarray, pose: np.ndarray) -> BumpMap:
    """A perfect map of a room of corners (n, 2), counter-clockwise, the room being at a pose in the map's frame."""
    corners = transform(pose, corners)
    lines = np.zeros((len(corners), COLUMNS))
    contacts = []
    for row, (start, end) in enumerate(zip(corners, np.roll(corners, -1, axis=0), strict=True)):
        length = math.hypot(*(end - start))
        phi = math.atan2(*(end - start)[::-1]) - 0.5 * math.pi
        lines[row, [X, Y]] = 0.5 * (start + end)
        lines[row, PHI], lines[row, BEYOND], lines[row, HITS] = phi, 0.0, 9.0
        lines[row, LOW], lines[row, HIGH] = 0.05 - 0.5 * length, 0.5 * length - 0.05
        contacts.append(start + np.linspace(0.1, 0.9, 9)[:, None] * (end - start))
    none = np.zeros((0, 3))
    return BumpMap(none, np.zeros(0, bool), np.concatenate(contacts), walls_of(lines), np.zeros(0, int), lines,
                   np.zeros(2), 0.0)  # fmt: skip


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (1.0, -2.0, 2.5), (-0.3, 0.4, -1.3)])
def test_frames_are_found_by_the_walls_shape(pose):
    corners = AREAS["cut rectangle"][0]
    one, other = drawn(corners, np.zeros(3)), drawn(corners, np.array(pose))
    frame = frame_of(one, other, MERGING)
    off = compose(frame.pose, np.array(pose))
    assert np.hypot(*off[:2]) < 0.01
    assert abs(float(wrap(off[2]))) < 0.01
    assert frame.score > 0.95
    assert frame.second < MERGING.doubtful * frame.score


def test_a_rectangle_lies_as_well_the_other_way_round():
    one = drawn(rectangle(1.5, 1.1), np.zeros(3))
    frame = frame_of(one, one, MERGING)
    assert frame.second > MERGING.doubtful * frame.score


def test_other_rooms_fit_badly():
    one, other = drawn(AREAS["triangle"][0], np.zeros(3)), drawn(AREAS["cut rectangle"][0], np.zeros(3))
    assert frame_of(one, other, MERGING).score < LEAST_SHARED


def test_maps_of_nothing_fit_nowhere():
    one = drawn(AREAS["triangle"][0], np.zeros(3))
    bare = one._replace(lines=one.lines[:0], contacts=one.contacts[:0], walls=[])
    assert frame_of(one, bare, MERGING).score == 0.0
    assert frame_of(bare, one, MERGING).score == 0.0


def test_contacts_near_walls_count_as_the_twin_says():
    rng = np.random.default_rng(1)
    points, segments = rng.uniform(-1, 1, (5, 2)), rng.uniform(-1, 1, (3, 4))
    pose = np.array([0.1, -0.2, 0.7])
    assert near_share(points, segments, pose, 0.3) == pytest.approx(naive.near_share(points, segments, pose, 0.3), 1e-3)


def test_lines_move_with_their_frame():
    line, pose = drawn(AREAS["triangle"][0], np.zeros(3)).lines[1], np.array([0.5, -0.4, 1.9])
    ends = stretches(line[None]).reshape(2, 2)
    np.testing.assert_allclose(stretches(moved_line(line, pose)[None]).reshape(2, 2), transform(pose, ends), atol=1e-12)


def test_counts_are_corrected_by_biases():
    stages = np.array([[0.0, 400.0, 420.0], [2.0, -40.0, 40.0]])
    biases = np.array([0.03, -0.05])
    for stage, own in zip(stages, corrected(stages, biases, MODEL), strict=True):
        whole = naive.composed(own[None], np.zeros(2), CartParams())
        np.testing.assert_allclose(whole, naive.composed(stage[None], biases, CartParams()), atol=1e-9)


def test_a_merge_of_nothing_is_refused():
    with pytest.raises(ValueError, match="give each run its map"):
        merge([], [], MODEL)
    with pytest.raises(ValueError, match="1 maps of 0 runs"):
        merge([], [drawn(AREAS["triangle"][0], np.zeros(3))], MODEL)


def test_several_carts_make_one_map():
    """Four carts of 100 bumps: the merged map is right, is in the best cart's frame, and beats the carts' median."""
    area = AREAS["cut rectangle"]
    runs, maps, truths, alone = [], [], [], []
    for seed in range(4):
        stages, truth = run(area, 40 + seed, 100)
        mapper = BumpMapper(CartParams(), BumpMapperParams(n_particles=2000, n_islands=2), seed)
        mapper.extend(stages)
        runs.append(stages)
        maps.append(mapper.refine())
        truths.append(truth[bumps_of(stages) + 1, :2])
        alone.append(off(maps[-1].walls, maps[-1].path[:, :2], truths[-1]))
    whole = merge(runs, maps, MODEL)
    used = [cart for cart in range(4) if cart not in whole.left_out]
    assert whole.reference in used
    assert len(used) >= 3, whole.frames
    places = np.concatenate([whole.nodes[cart][1::2, :2] for cart in used])
    error = off(whole.walls, places, np.concatenate([truths[cart] for cart in used]))
    assert error < max(0.015, float(np.median(alone))), (error, alone)
    again = merge(runs, maps, MODEL)
    assert [nodes.tobytes() for nodes in again.nodes] == [nodes.tobytes() for nodes in whole.nodes]
    for cart in used:
        lay = compose(inverse(whole.frames[cart].pose), whole.nodes[cart])
        assert np.median(np.hypot(*(lay - maps[cart].nodes)[:, :2].T)) < 0.2


def off(walls: list[np.ndarray], places: np.ndarray, true: np.ndarray) -> float:
    """Mean distance of walls, laid as places (n, 2) lie best on true ones, from those of the area."""
    lay = alignment(places, true)
    walls = [transform(lay, wall) for wall in walls]
    return map_error(segments_of(walls), points_on(walls), edges_of(AREAS["cut rectangle"]))[0]
