"""What viewers get of a cart that feels its way: places with their shares, in words too, its map and its raw path."""

from __future__ import annotations

import zlib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from firmware.virtual import load_world
from firmware.virtual.bumper_cart import run_cart
from server.felt_views import (
    SHADES,
    bump_space_view,
    clusters_view,
    in_words,
    map_view,
    raw_path_view,
    run_status,
    whereabouts,
)
from server.filter_worker import estimate_of
from server.messages import Cart, CartStage, Keyframe, Snapshot, nothing_known
from server.robots.bumper_cart import BumperCart, BumperCartParams, make_estimator
from server.survey import floor_of, in_frame, pack, survey_of, unpack, wall_skew
from server.views import odometry_view, particles_view
from slam.bump_localizer import BumpLocalizerParams
from slam.bump_mapper import BumpMapperParams
from slam.bumps import band_of
from slam.cart_odometry import DRIVE, MIDDLE, Stage
from slam.pose import compose, transform
from slam.pose_clusters import Belief, Cluster

HALF_TURN = np.array([1.5, 1.1, np.pi])  # lays the rectangle of 1.5 by 1.1 m on itself


@cache
def shown(world: str, is_given: bool, bumps: int = 14, seed: int = 2) -> tuple[BumperCart, Snapshot]:
    """A cart that ran in a world, with its map or without one, and what there is to see of it then."""
    params = BumperCartParams(
        map=world if is_given else None,
        localizer=BumpLocalizerParams(particles=1500),
        mapper=BumpMapperParams(n_particles=400),
    )
    robot, estimator = BumperCart(params), make_estimator(params, seed=1)
    stages, _ = run_cart(load_world(world), seed, bumps)
    left = right = 0
    robot.step(Cart(0.0, 0, 0, 7.5, 0, 0, "drive", 0, 1, "armed", "none", 0))
    for number, stage in enumerate(stages):
        left, right, t = left + stage.left, right + stage.right, float(number + 1)
        robot.step(Cart(t, left, right, 7.5, number, number // 3, "drive", 0, 1, "armed", "none", 0))
        for effect in robot.step(CartStage(t, 1, number, Stage(*stage))):
            if isinstance(effect, Keyframe):
                estimator.extend(effect.pose, effect.walls, effect.travelled)
                robot.step(estimate_of(estimator, t, 300))
    return robot, robot.snapshot()


def unpacked(view, name):
    return view.fields["scale"] * view.arrays[name].astype(float)


def test_a_map_that_looks_alike_is_seen_as_two_places_and_told_so():
    _, seen = shown("rectangle", True, bumps=25)
    view, told = clusters_view(seen), whereabouts(seen)
    assert view is not None
    assert told is not None
    assert not view.fields["is_localized"]
    first, second = view.arrays["poses"][:2]
    np.testing.assert_allclose(compose(HALF_TURN, first)[:2], second[:2], atol=0.02)
    one, other = view.arrays["shares"][:2]
    assert one == pytest.approx(other, abs=0.01)
    assert one > 0.4
    assert seen.belief is not None
    for place, (xx, xy, yy) in zip(seen.belief.clusters, view.arrays["covariances"], strict=True):
        np.testing.assert_allclose(place.covariance[:2, :2], [[xx, xy], [xy, yy]], rtol=1e-5)
    assert (told.localized, len(told.places)) == (False, len(view.arrays["shares"]))
    assert told.words.startswith("Not localized: it may be in ")
    assert f"{100 * one:.0f} %" in told.words


def test_particles_are_shown_at_all_images_of_a_map_that_looks_alike():
    _, seen = shown("rectangle", True)
    view = particles_view(seen)
    assert view is not None
    places = unpacked(view, "points") + view.fields["origin"]
    headings = view.arrays["headings"] * np.pi / 128.0
    turned = compose(HALF_TURN, np.column_stack([places, headings]))
    apart = np.hypot(*(turned[:, None, :2] - places[None]).transpose(2, 0, 1)).min(axis=1)
    assert apart.max() < 0.003
    assert len(places) == len(headings) <= 300
    np.testing.assert_allclose(
        np.exp(1j * headings), np.exp(1j * seen.particles[:, 2]), atol=np.pi / 128, err_msg="in 256ths of a turn"
    )


@pytest.mark.parametrize(
    ("shares", "is_localized", "has_bumped", "words"),
    [
        ([], False, False, "It may be anywhere on the map: no bump yet."),
        ([], False, True, "No place on the map explains its bumps."),
        ([0.97, 0.02], True, True, "Localized: 97 % of the belief is in one place."),
        ([0.6], False, True, "Not localized: 60 % of the belief is in one place, the rest is spread."),
        ([0.52, 0.48], False, True, "Not localized: it may be in 2 places, 52 % and 48 %."),
        ([0.4, 0.3, 0.2, 0.05, 0.03], False, True,
         "Not localized: it may be in 5 places, 40 %, 30 %, 20 %, 5 % and less."),
    ],
)  # fmt: skip
def test_the_belief_in_words(shares, is_localized, has_bumped, words):
    places = [Cluster(np.zeros(3), np.zeros((3, 3)), share) for share in shares]
    assert in_words(Belief(places, is_localized), has_bumped) == words


def test_before_the_first_bump_on_a_map_it_may_be_anywhere():
    seen = BumperCart(BumperCartParams(map="rectangle")).snapshot()
    view, told = clusters_view(seen), whereabouts(seen)
    assert view is not None
    assert told is not None
    assert view.arrays["poses"].shape == view.arrays["covariances"].shape == (0, 3)
    assert told.words == "It may be anywhere on the map: no bump yet."
    assert len(seen.walls) == 4, "the map is there"


def test_the_map_that_was_given_is_shown_to_the_millimetre_and_one_of_its_own_as_it_grows():
    _, known = shown("rectangle", True)
    view = map_view(known)
    assert view is not None
    assert view.fields["is_given"]
    corners = {tuple(point) for point in np.round(unpacked(view, "points"), 6).tolist()}
    assert corners == {(0.0, 0.0), (1.5, 0.0), (1.5, 1.1), (0.0, 1.1)}
    _, own = shown("cut-rectangle", False)
    grown = map_view(own)
    assert grown is not None
    assert not grown.fields["is_given"]
    assert len(grown.arrays["lengths"]) == len(own.walls) > 0
    np.testing.assert_allclose(unpacked(grown, "points"), np.concatenate(own.walls), atol=0.00051)
    assert clusters_view(own) is bump_space_view(own) is whereabouts(own) is None, "none of its without a map"


def test_the_raw_path_has_all_movements_and_three_points_at_each_bump():
    robot, seen = shown("cut-rectangle", False)
    view = raw_path_view(seen)
    assert view is not None
    ends = np.array([np.zeros(2), robot.odometry[:2]])
    np.testing.assert_allclose(unpacked(view, "points")[[0, -1]], ends, atol=0.001)
    points = unpacked(view, "bumpers").reshape(-1, 3, 2)
    assert len(points) == len(robot.vertices) == 14
    bumper = np.array([[0.09, 0.0381], [0.09, 0.0], [0.09, -0.0381]])
    ahead = np.array([transform(vertex, bumper) for vertex in robot.vertices])
    np.testing.assert_allclose(points, ahead, atol=0.001)
    assert odometry_view(seen) is None, "it has more than that"


@pytest.mark.parametrize(("localized", "lead"), [("0", 0), ("000", 2), ("0011", 2), ("01011", 3), ("0110", 3)])
def test_on_a_map_the_raw_path_is_laid_where_the_cart_was_found_without_a_break(localized, lead):
    robot = BumperCart(BumperCartParams(map="rectangle"))
    robot.step(Cart(0.0, 0, 0, 7.5, 0, 0, "drive", 0, 1, "armed", "none", 0))
    path = np.random.default_rng(1).uniform(0.0, 1.0, (len(localized), 3))
    for vertex, flag in enumerate(localized):
        robot.step(CartStage(1.0 + vertex, 1, vertex, Stage(DRIVE, 90 + 7 * vertex, 85, MIDDLE)))
        place = Cluster(path[vertex], np.zeros((3, 3)), 0.96 if flag == "1" else 0.5)
        told = nothing_known(1.0 + vertex, path[vertex], 1)
        robot.step(replace(told, path=path[: vertex + 1], belief=Belief([place], flag == "1")))
    felt = robot.snapshot().felt
    assert felt is not None
    np.testing.assert_allclose(compose(felt.laid, robot.vertices[lead]), path[lead], atol=1e-12)


def test_the_bump_space_is_a_band_inside_the_walls():
    robot, seen = shown("rectangle", True)
    view = bump_space_view(seen)
    assert view is not None
    assert robot.area is not None
    cells = np.frombuffer(zlib.decompress(view.arrays["cells"].tobytes()), np.uint8).reshape(view.fields["shape"])
    assert cells.max() == SHADES
    assert robot.area.distances[cells > 0].max() < np.hypot(0.09, 0.0381) + 0.01
    far_from_corners = slice(*np.searchsorted(robot.area.x + 0.005 * np.arange(cells.shape[1]), [0.3, 1.2]))
    low, high = np.flatnonzero(cells[: cells.shape[0] // 2, far_from_corners].any(axis=1))[[0, -1]]
    distances = robot.area.y + robot.area.spacing * np.array([low, high])
    np.testing.assert_allclose(distances, [0.0381, np.hypot(0.09, 0.0381)], atol=0.008)
    np.testing.assert_array_equal(cells > 0, band_of(robot.area, robot.cart, 0.005).shares > 0)


def test_its_run_is_told():
    _, seen = shown("rectangle", True)
    told = run_status(seen)
    assert told is not None
    assert (told.number, told.doing, told.lost_stages) == (1, "drive", 0)


@pytest.mark.parametrize(("world", "is_given"), [("rectangle", True), ("cut-rectangle", False)])
def test_its_map_is_kept_and_turned_like_any_other(world, is_given):
    _, seen = shown(world, is_given)
    survey = survey_of(seen)
    again = unpack(pack(survey))
    assert again.drawn is not None
    for curve, kept in zip(seen.walls, again.drawn, strict=True):
        np.testing.assert_array_equal(curve, kept)
    frame = np.array([0.5, -0.2, 0.3])
    turned = in_frame(again, frame)
    floor = floor_of(turned)
    np.testing.assert_allclose(transform(frame, floor.walls[0]), seen.walls[0], atol=1e-9)
    assert floor.settled == 0
    assert floor.grid is not None
    assert (floor.grid.cells == 100).any()
    if is_given:
        assert wall_skew(survey) == pytest.approx(0.0, abs=1e-6)
        assert wall_skew(turned) == pytest.approx(-0.3, abs=1e-6)
