"""The view in three dimensions: what it draws, what its switches do, and that a click only proposes."""

import asyncio
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import viser

from server.dashboard import PATIENCE, Dashboard, above, behind
from server.messages import Label, Snapshot
from server.scene import (
    LAYERS,
    MOST_SEGMENTS,
    TREE_HEIGHT,
    WALL_HEIGHT,
    WHEEL_RADIUS,
    draw_tree,
    heading_and_tilt,
    place_on_floor,
    raised,
    ribbons,
    uncertainty,
)
from server.stream import Viewer, decode
from slam.uncertainty import Branches
from tests.server.live_session import HandSession
from tests.server.test_bridge import drive_for


@pytest.fixture(scope="module")
def snapshot() -> Snapshot:
    """A short drive's, with two branches that part at vertex 1, an objective and a label."""
    session = HandSession()
    drive_for(session, 8.0, 0.3, 0.3)
    seen = session.bridge.look()
    poses = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 0.1, 0.2], [1.0, -0.1, -0.2]])
    branches = Branches(poses, np.array([-1, 0, 1, 1], np.int32), np.array([0, 1, 2, 2], np.int32))
    route = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 1.0]])
    labels = (Label(7, "Kitchen", 1.0, 0.5),)
    return replace(seen, branches=branches, fixed_depth=1, goal=(2.0, 1.0), route=route, labels=labels)


@pytest.fixture
def dashboard(snapshot: Snapshot) -> Iterator[Dashboard]:
    """A view that somebody has opened."""
    dashboard = Dashboard()
    asyncio.run(dashboard.start(snapshot))
    yield dashboard
    dashboard.stop()


def server_of(dashboard: Dashboard) -> viser.ViserServer:
    assert dashboard.server is not None
    return dashboard.server


def rotated(wxyz: tuple[float, ...], vector: tuple[float, float, float]) -> np.ndarray:
    """A vector turned by a quaternion."""
    w, axis = wxyz[0], np.array(wxyz[1:])
    v = np.array(vector)
    return v + 2.0 * w * np.cross(axis, v) + 2.0 * np.cross(axis, np.cross(axis, v))


def test_every_layer_is_drawn_below_its_own_node(dashboard, snapshot):
    scene = server_of(dashboard).scene
    for name in (
        "/walls/mesh", "/path/line", "/tree/lines", "/robot/beams/sonar", "/robot/beams/infrared", "/way/line",
        "/way/pole/ball", "/labels/all/7",
    ):  # fmt: skip
        assert scene.get_handle_by_name(name) is not None, name
    assert set(dashboard.switches) == {layer.name for layer in LAYERS}
    for layer in LAYERS:
        assert scene.get_handle_by_name(layer.name) is not None


def test_what_is_switched_off_is_not_drawn_and_hidden(dashboard, snapshot):
    scene = server_of(dashboard).scene
    assert scene.get_handle_by_name("/particles/points") is None, "off at first"
    dashboard.switches["/particles"].value = True
    dashboard.draw(snapshot)
    assert scene.get_handle_by_name("/particles/points") is not None
    dashboard.switches["/walls"].value = False
    walls = scene.get_handle_by_name("/walls")
    assert walls is not None


def test_only_what_has_changed_is_drawn_again(dashboard, snapshot):
    scene = server_of(dashboard).scene
    walls, beams = scene.get_handle_by_name("/walls/mesh"), scene.get_handle_by_name("/robot/beams/sonar")
    dashboard.draw(replace(snapshot, t=snapshot.t + 0.1))
    assert scene.get_handle_by_name("/walls/mesh") is walls
    assert scene.get_handle_by_name("/robot/beams/sonar") is not beams


def test_another_session_clears_the_map_and_the_objective(dashboard, snapshot):
    none = np.zeros((0, 3))
    dashboard.switches["/particles"].value = True
    dashboard.draw(snapshot)
    dashboard.draw(
        replace(
            snapshot, t=0.1, path=none, walls=[], profile=np.zeros(0), spread=np.zeros(0), particles=none,
            branches=None, goal=None, route=np.zeros((0, 2)), labels=(), affinity=0.0,
        )
    )  # fmt: skip
    scene = server_of(dashboard).scene
    for name in (
        "/walls/mesh",
        "/path/line",
        "/tree/lines",
        "/particles/points",
        "/way/line",
        "/way/pole",
        "/labels/all/7",
    ):
        assert scene.get_handle_by_name(name) is None, name


def test_the_body_leans_as_the_robot_does(dashboard, snapshot):
    dashboard.draw(replace(snapshot, pose=np.array([1.0, 2.0, math.pi / 2.0]), tilt=0.2))
    assert dashboard.robot is not None
    np.testing.assert_allclose(dashboard.robot.position, [1.0, 2.0, WHEEL_RADIUS])
    top = rotated(tuple(dashboard.robot.wxyz), (0.0, 0.0, 1.0))
    np.testing.assert_allclose(top, [0.0, math.sin(0.2), math.cos(0.2)], atol=1e-6)


def test_heading_is_counter_clockwise_and_tilt_forward():
    np.testing.assert_allclose(rotated(heading_and_tilt(0.3, 0.0), (1, 0, 0)), [math.cos(0.3), math.sin(0.3), 0])
    np.testing.assert_allclose(rotated(heading_and_tilt(0.0, 0.1), (0, 0, 1)), [math.sin(0.1), 0, math.cos(0.1)])


def test_in_the_tree_time_goes_upwards_and_children_hang_on_their_parents(dashboard, snapshot):
    tree = server_of(dashboard).scene.get_handle_by_name("/tree/lines")
    assert isinstance(tree, viser.LineSegmentsHandle)
    segments = np.asarray(tree.points)
    assert segments.shape == (3, 2, 3)
    assert np.all(segments[:, 1, 2] > segments[:, 0, 2])
    np.testing.assert_array_equal(segments[1, 0], segments[0, 1])
    np.testing.assert_array_equal(segments[2, 0], segments[0, 1])
    settled, first, second = np.asarray(tree.colors)[:, 0].astype(int)
    assert settled[2] > settled[0], "blue"
    assert first[0] > first[2], "orange"
    np.testing.assert_array_equal(first, second)


def test_a_long_drives_tree_stays_in_the_room():
    depths = np.arange(500)
    heights = raised(np.zeros((500, 3)), depths, 500)[:, 2]
    assert heights.max() <= WALL_HEIGHT + TREE_HEIGHT


def test_ribbons_stand_on_the_curves():
    curves = [
        np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]),
        np.array([[5.0, 5.0]]),
        np.array([[2.0, 0.0], [2.0, 1.0]]),
    ]
    vertices, faces = ribbons(curves, 0.3)
    corners = vertices[faces]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert areas.sum() == pytest.approx(3 * 0.3)
    assert set(vertices[:, 2].tolist()) == {0.0, float(np.float32(0.3))}


def test_no_walls_are_no_ribbons():
    vertices, faces = ribbons([], 0.3)
    assert vertices.shape == (0, 3)
    assert faces.shape == (0, 3)


def test_of_a_huge_map_every_wall_stays_in_view():
    x = np.linspace(0.0, 1.0, 50)
    curves = [np.column_stack([x, np.full(50, float(k))]) for k in range(1000)]
    vertices, faces = ribbons(curves, 0.3)
    assert len(faces) / 2 <= 1.2 * MOST_SEGMENTS
    assert set(vertices[:, 1].tolist()) == set(range(1000))
    assert vertices[:, 0].max() == 1.0, "curves keep their ends"


def test_certainty_is_the_spread_where_there_is_one(snapshot):
    n = len(snapshot.path)
    spread = np.linspace(0.0, 2.0, n)
    shares = uncertainty(replace(snapshot, spread=spread))
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    by_profile = uncertainty(replace(snapshot, spread=np.zeros(0), profile=np.full(n, 0.25)))
    np.testing.assert_allclose(by_profile, 0.5)


@pytest.mark.parametrize(
    ("origin", "direction", "place"),
    [
        ((0.0, 0.0, 2.0), (0.0, 0.0, -1.0), (0.0, 0.0)),
        ((1.0, 0.0, 1.0), (1.0, 0.5, -1.0), (2.0, 0.5)),
        ((0.0, 0.0, 2.0), (1.0, 0.0, 0.0), None),
        ((0.0, 0.0, 2.0), (1.0, 0.0, 0.1), None),
        ((0.0, 0.0, 2.0), (1.0, 0.0, -1e-4), None),
        ((0.0, 0.0, -2.0), (1.0, 0.0, 1.0), (2.0, 0.0)),
    ],
)
def test_a_ray_meets_the_floor_or_not(origin, direction, place):
    assert place_on_floor(origin, direction) == (None if place is None else pytest.approx(place))


def test_a_click_is_shown_to_all_viewers_and_moves_nothing():
    session = HandSession()
    session.advance(1.0)
    heard: list[dict] = []

    async def never(_: bytes) -> None:
        raise AssertionError("nothing is sent by hand")

    class Notebook(Viewer):
        def put(self, topic: str, body: bytes) -> None:
            heard.append(decode(b"\0\0\0\0" + body)[1])

    dashboard = session.bridge.dashboard
    asyncio.run(dashboard.start(session.bridge.look()))
    try:
        session.bridge.hub.join(Notebook("viewer-1", never))
        heard.clear()
        dashboard.take_proposal((1.25, -0.5))
        assert heard == [{"topic": "notice", "kind": "proposal", "x": 1.25, "y": -0.5, "arrays": []}]
        assert session.bridge.control.goal is None
        assert session.bridge.look().goal is None
        scene = server_of(dashboard).scene
        assert scene.get_handle_by_name("/proposal/ball") is not None
        dashboard.draw(replace(session.bridge.look(), t=session.bridge.look().t + PATIENCE + 1.0))
        assert scene.get_handle_by_name("/proposal") is None, "nobody took it up"
    finally:
        dashboard.stop()


def test_nothing_is_drawn_while_nobody_looks(snapshot):
    dashboard = Dashboard()
    dashboard.update(snapshot)
    assert not dashboard.is_watched
    assert dashboard.server is None
    dashboard.take_proposal((1.0, 1.0))  # a click that came while the view was being closed


def test_the_camera_stands_behind_the_robot_or_above_the_whole_path(snapshot):
    position, target = behind(replace(snapshot, pose=np.array([2.0, 3.0, 0.7])))
    along = np.array(target[:2]) - np.array(position[:2])
    assert math.atan2(along[1], along[0]) == pytest.approx(0.7)
    path = np.array([[0.0, 0.0, 0.0], [40.0, 10.0, 0.0]])
    position, target = above(replace(snapshot, path=path, pose=np.zeros(3)))
    assert target == (20.0, 5.0, 0.0)
    assert position[2] > 30.0


def test_no_branches_no_tree(snapshot, dashboard):
    draw_tree(server_of(dashboard).scene, replace(snapshot, branches=None))
    assert server_of(dashboard).scene.get_handle_by_name("/tree/lines") is None
