"""Layers and tiles: what a robot has is shown once it changes, what it has not is not, and walls are sent once."""

import dataclasses

import numpy as np
import pytest

from server.layers import CENTIMETRE, TILE, Layers, View, tile_view
from server.stream import Hub, decode
from server.views import odometry_view
from tests.server.live_session import HandSession


class Notebook(Hub):
    """A hub that writes down what is published."""

    def __init__(self):
        super().__init__()
        self.published: list[str] = []

    def publish(self, topic, fields, arrays=None):
        """Write it down, if it is news."""
        before = self.newest.get(topic)
        super().publish(topic, fields, arrays)
        if self.newest[topic] is not before:
            self.published.append(topic)


@pytest.fixture(scope="module")
def snapshot():
    session = HandSession()
    session.advance(1.0)
    return session.bridge.look()


def curves_of(n_vertices: int) -> list[list[np.ndarray]]:
    rng = np.random.default_rng(n_vertices)
    return [[rng.uniform(-2.0, 2.0, (k, 2)) for k in (5, 1, 7)] for _ in range(n_vertices)]


def with_vertices(snapshot, curves):
    path = np.zeros((len(curves), 3))
    return dataclasses.replace(snapshot, path=path, vertex_curves=curves, profile=np.ones(len(curves)))


def test_layers_are_looked_at_in_their_turn_and_published_when_they_change(snapshot):
    hub = Notebook()
    layers = Layers(hub)
    looks = []
    layers.add("slow", lambda _: View({"n": len(looks.append(0) or looks) // 3}), every=4)
    for _ in range(24):
        layers.show(snapshot)
    assert len(looks) == 6
    assert hub.published.count("slow") == 3
    assert hub.published.count("path") == 1


def test_what_the_robot_has_not_is_no_layer_of_it(snapshot):
    hub = Notebook()
    layers = Layers(hub)
    has = [False]
    layers.add("arm", lambda _: View({}) if has[0] else None, every=1)
    assert "arm" not in layers.names(snapshot), "before anything was shown"
    assert {"pose", "histogram", "local", "path", "tile"} <= set(layers.names(snapshot))
    layers.show(snapshot)
    assert "arm" not in layers.names(snapshot)
    has[0] = True
    layers.show(snapshot)
    assert "arm" in layers.names(snapshot)
    has[0] = False
    layers.show(snapshot)
    assert "arm" not in layers.names(snapshot)
    assert "arm" not in hub.newest, "who joins now is not shown it"
    blind = dataclasses.replace(snapshot, densities=np.zeros(0), local_map=np.zeros((0, 0)))
    assert not {"histogram", "local"} & set(Layers(Hub()).names(blind))


def test_a_tile_is_sent_when_it_gets_a_vertex_and_never_again(snapshot):
    hub = Notebook()
    layers = Layers(hub)
    curves = curves_of(2 * TILE + 3)
    for n in (0, 1, 2, 2, TILE, TILE + 1, len(curves), len(curves)):
        layers.show(with_vertices(snapshot, curves[:n]))
    tiles = [topic for topic in hub.published if topic.startswith("tile")]
    assert tiles == ["tile/0", "tile/0", "tile/0", "tile/1", "tile/1", "tile/2"]


def test_a_tile_brings_each_vertex_its_own_curves(snapshot):
    curves = curves_of(TILE)
    _, header, arrays = decode(b"\0\0\0\0" + published(snapshot, curves)["tile/0"])
    assert header["first"] == 0
    assert arrays["counts"].tolist() == [2] * TILE, "a single point is no wall"
    ends = np.cumsum(arrays["lengths"])
    points = header["scale"] * np.asarray(arrays["points"], float)
    packed = np.split(points, ends[:-1])
    wanted = [curve for seen in curves for curve in seen if len(curve) > 1]
    for curve, exact in zip(packed, wanted, strict=True):
        distances = np.abs(curve[:, None] - exact[None]).max(axis=2).min(axis=1)
        assert distances.max() <= 0.51 * CENTIMETRE


def published(snapshot, curves) -> dict[str, bytes]:
    hub = Hub()
    Layers(hub).show(with_vertices(snapshot, curves))
    return hub.newest


def test_straight_walls_cost_few_points():
    wall = np.column_stack([np.linspace(0.0, 2.0, 40), np.full(40, 1.0)])
    assert len(tile_view(0, [[wall]]).arrays["points"]) == 2


def test_another_session_starts_with_the_first_tile(snapshot):
    hub = Notebook()
    layers = Layers(hub)
    layers.show(with_vertices(snapshot, curves_of(TILE + 2)))
    layers.begin()
    assert hub.newest == {}
    layers.show(with_vertices(snapshot, curves_of(1)))
    assert "tile/1" not in hub.newest
    assert hub.published.count("tile/0") == 2


def test_before_the_first_vertex_there_is_no_path(snapshot):
    shown = published(snapshot, [])
    assert decode(b"\0\0\0\0" + shown["path"])[2]["path"].shape == (0, 3)
    assert decode(b"\0\0\0\0" + shown["particles"])[2]["points"].shape == (0, 2)


def test_particles_are_told_to_the_centimetre(snapshot):
    particles = np.random.default_rng(0).normal([50.0, -20.0, 0.0], 1.0, (300, 3))
    far = dataclasses.replace(with_vertices(snapshot, curves_of(1)), particles=particles)
    hub = Hub()
    Layers(hub).show(far)
    _, header, arrays = decode(b"\0\0\0\0" + hub.newest["particles"])
    told = header["scale"] * arrays["points"] + header["origin"]
    np.testing.assert_allclose(told, particles[:, :2], atol=0.51 * CENTIMETRE)


def test_the_wheels_own_path_begins_where_the_best_path_does(snapshot):
    """A drive whose odometry turned off by a right angle is laid along the path again."""
    odometry = np.array([[3.0, 1.0, np.pi / 2], [3.0, 1.5, np.pi / 2], [3.0, 2.0, np.pi / 2]])
    path = np.array([[0.0, 0.0, 0.0], [0.5, 0.01, 0.02], [1.0, 0.03, 0.02]])
    seen = dataclasses.replace(snapshot, path=path, vertex_odometry=odometry)
    view, before = odometry_view(seen), odometry_view(dataclasses.replace(seen, vertex_odometry=np.zeros((0, 3))))
    assert view is not None
    assert before is not None
    np.testing.assert_allclose(view.fields["scale"] * view.arrays["points"], [[0, 0], [0.5, 0], [1, 0]], atol=0.006)
    assert not len(before.arrays["points"])
