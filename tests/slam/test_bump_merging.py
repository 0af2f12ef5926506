"""Several carts' maps made one: wrong maps are outvoted, runs are found on the map, more carts make a better one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest

from slam.bump_finding import Recording, starts_anywhere
from slam.bump_mapper import BumpMapper, BumpMapperParams, segments_of
from slam.bump_merging import BumpMergingParams, MergedMap, bend, merge, moved_line
from slam.bump_swarm import PHI, innovation
from slam.bump_walls import map_error, points_on, stretches
from slam.cart_odometry import CartParams, bumps_of, raw_path
from slam.evaluate import alignment
from slam.pose import compose, transform
from tests.slam.bump_world import AREAS, edges_of, run

MODEL = BumpMapperParams().model(CartParams())
MERGING = BumpMergingParams()


CUT = AREAS["cut rectangle"]
MAPPER = BumpMapperParams(n_particles=1500, n_islands=2, drag_share=1e-3, drag_tried=1e-3)  # which this world has not
N_CARTS = 10


class Carts(NamedTuple):
    """Recordings, true places (n, 2) of each one's bumps, and the errors of their own maps."""

    recordings: list[Recording]
    truths: list[np.ndarray]
    alone: list[float]


def recording(area: list[np.ndarray], seed: int, bumps: int) -> tuple[Recording, np.ndarray]:
    """A cart's, and the true places of its bumps."""
    stages, truth = run(area, seed, bumps)
    mapper = BumpMapper(CartParams(), MAPPER, seed)
    mapper.extend(stages)
    return Recording(stages, CartParams(), mapper.refine()), truth[bumps_of(stages) + 1, :2]


@pytest.fixture(scope="module")
def carts() -> Carts:
    """Ten of 60 bumps in one room."""
    found = [recording(CUT, 40 + seed, 60) for seed in range(N_CARTS)]
    alone = [off(each.area.walls, each.area.path[:, :2], truth) for each, truth in found]
    return Carts([each for each, _ in found], [truth for _, truth in found], alone)


@pytest.fixture(scope="module")
def whole(carts: Carts) -> MergedMap:
    """All of them."""
    return merge(carts.recordings, MAPPER, MERGING)


def error_of(whole: MergedMap, truths: list[np.ndarray]) -> float:
    """Of a merged map, laid by all its paths."""
    used = [cart for cart in range(len(truths)) if cart not in whole.left_out]
    places = np.concatenate([whole.nodes[cart][1::2, :2] for cart in used])
    return off(whole.walls, places, np.concatenate([truths[cart] for cart in used]))


def test_ten_carts_make_a_better_map_than_one(carts: Carts, whole: MergedMap):
    assert len(whole.left_out) <= 2
    error = error_of(whole, carts.truths)
    assert error < 0.5 * float(np.median(carts.alone)), (error, carts.alone)
    assert error < 0.006


def test_the_map_lies_in_the_frame_of_the_reference(whole: MergedMap):
    np.testing.assert_allclose(whole.nodes[whole.reference][0], 0.0, atol=1e-9)
    assert whole.reference == whole.core[0]


def test_the_order_of_recordings_does_not_matter(carts: Carts):
    few = carts.recordings[:3]
    one, other = merge(few, MAPPER, MERGING), merge(few[::-1], MAPPER, MERGING)
    assert one.lines.tobytes() == other.lines.tobytes()
    assert [nodes.tobytes() for nodes in one.nodes] == [nodes.tobytes() for nodes in other.nodes[::-1]]
    assert one.reference == 2 - other.reference


def test_a_cart_with_a_wrong_map_is_found_by_its_run(carts: Carts, whole: MergedMap):
    """Of five carts one has another room's map: it has no vote, and its run lies in the map all the same."""
    other, _ = recording(AREAS["pentagon"], 7, 60)
    best = [*whole.core, *(cart for cart in range(N_CARTS) if cart not in whole.core)][:5]
    recordings = [carts.recordings[cart] for cart in best]
    recordings[4] = recordings[4]._replace(area=other.area._replace(cost=-1e3))
    found = merge(recordings, MAPPER, MERGING)
    assert 4 not in found.core
    assert found.left_out == []
    assert error_of(found, [carts.truths[cart] for cart in best]) < 0.01


def test_a_cart_from_elsewhere_is_left_out(carts: Carts, whole: MergedMap):
    other, _ = recording(AREAS["triangle"], 7, 40)
    best = whole.core[:3]
    found = merge([*(carts.recordings[cart] for cart in best), other], MAPPER, MERGING)
    assert found.left_out == [3]
    assert found.excess[3] > MERGING.worse
    assert len(found.nodes[3]) == 0


def test_one_cart_alone_keeps_its_map(carts: Carts):
    best = int(np.argmin(carts.alone))
    found = merge(carts.recordings[best : best + 1], MAPPER, MERGING)
    assert found.core == [0]
    assert error_of(found, carts.truths[best : best + 1]) < max(0.01, 1.5 * carts.alone[best])


def test_a_merge_of_nothing_is_refused(carts: Carts):
    with pytest.raises(ValueError, match="0 recordings"):
        merge([])
    one = carts.recordings[0]
    bare = one._replace(area=one.area._replace(felt=np.full_like(one.area.felt, -1)))
    with pytest.raises(ValueError, match="1 recordings, none of which felt a wall"):
        merge([bare])


def test_lines_move_with_their_frame(whole: MergedMap):
    line, pose = whole.lines[1], np.array([0.5, -0.4, 1.9])
    ends = stretches(line[None]).reshape(2, 2)
    np.testing.assert_allclose(stretches(moved_line(line, pose)[None]).reshape(2, 2), transform(pose, ends), atol=1e-12)


def test_starts_have_their_first_bump_at_a_wall(carts: Carts, whole: MergedMap):
    one = carts.recordings[0]
    starts = starts_anywhere(whole.lines, one, 300)
    first = bumps_of(one.stages)[0]
    ends = compose(starts, raw_path(one.stages[: first + 1], one.cart)[-1])
    offs = [min(abs(innovation(line, pose, MODEL)[0]) for line in whole.lines) for pose in ends]
    assert max(offs) < 1e-6
    facing = [max(math.cos(pose[2] - line[PHI]) for line in whole.lines) for pose in ends]
    assert min(facing) > 0.2


def test_a_bend_is_found_where_contacts_lie_along_two_walls():
    places = np.linspace(-0.5, 0.5, 101)
    assert bend(places, 0.1 * np.abs(places - 0.2)) == pytest.approx(0.2, abs=0.05)
    assert bend(places[:10], places[:10]) is None


def off(walls: list[np.ndarray], places: np.ndarray, true: np.ndarray) -> float:
    """Mean distance of walls, laid as places (n, 2) lie best on true ones, from those of the area."""
    lay = alignment(places, true)
    walls = [transform(lay, wall) for wall in walls]
    return map_error(segments_of(walls), points_on(walls), edges_of(AREAS["cut rectangle"]))[0]
