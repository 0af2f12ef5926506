"""Foreign formats: what is written is read again, and every broken file is one line with its place."""

from __future__ import annotations

import numpy as np
import pytest

from server.formats.atomic import make_directory, write_atomically
from server.formats.errors import FormatError
from server.formats.g2o import Graph, read_g2o, write_g2o
from server.formats.relations import read_relations
from server.formats.ros_map import FREE, OCCUPIED, UNKNOWN, OccupancyMap, read_ros_map, write_ros_map
from server.formats.tum import read_tum, write_tum
from slam.pose import wrap

TUM_ROW = "1.0 0.1 0.2 0 0 0 0 1\n"


def random_poses(n: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.column_stack([rng.normal(size=(n, 2)) * 10.0, rng.uniform(-np.pi, np.pi, n)])


def test_tum_keeps_times_and_poses(tmp_path):
    poses = random_poses(50)
    poses[0, 2] = np.pi
    times = 976052857.338446 + np.repeat(np.arange(25), 2)[::-1] * 0.1  # they may repeat and step back
    write_tum(tmp_path / "a.tum", times, poses)
    read_times, read_poses = read_tum(tmp_path / "a.tum")
    np.testing.assert_allclose(read_times, times, atol=1e-6)
    np.testing.assert_allclose(read_poses[:, :2], poses[:, :2], atol=1e-6)
    np.testing.assert_allclose(wrap(read_poses[:, 2] - poses[:, 2]), 0.0, atol=1e-8)


def test_tum_takes_the_heading_of_a_tilted_pose(tmp_path):
    yaw, tilt = 0.7, 0.2
    cy, sy, cp, sp = np.cos(yaw / 2), np.sin(yaw / 2), np.cos(tilt / 2), np.sin(tilt / 2)
    (tmp_path / "a.tum").write_text(f"# t x y z qx qy qz qw\n0,1,2,3,{-sy * sp},{cy * sp},{sy * cp},{cy * cp}\n")
    _, poses = read_tum(tmp_path / "a.tum")
    np.testing.assert_allclose(poses, [[1.0, 2.0, yaw]], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "holds no poses"),
        (TUM_ROW + "1.0 2.0\n", ":2: 2 fields where 8 belong"),
        (TUM_ROW + "a b c d e f g h\n", ":2: a field is not a number"),
        ("nan 0 0 0 0 0 0 1\n", ":1: a field is not finite"),
        ("0 0 0 0 0 0 0 0\n", ":1: the quaternion is zero"),
    ],
)
def test_broken_tum_names_the_row(tmp_path, text, told):
    path = tmp_path / "a.tum"
    path.write_text(text)
    with pytest.raises(FormatError) as error:
        read_tum(path)
    assert told in str(error.value)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


def test_missing_file_and_directory_are_told_apart(tmp_path):
    with pytest.raises(FormatError, match="no such file"):
        read_tum(tmp_path / "nothing.tum")
    with pytest.raises(FormatError, match="is a directory"):
        read_tum(tmp_path)


def test_relations_keep_the_plane(tmp_path):
    (tmp_path / "a.relations").write_text("1.5 2.5 0.1 -0.2 9 0 0 -1.2\n\n3 4 1 2 3 0 0 0.5\n")
    relations = read_relations(tmp_path / "a.relations")
    np.testing.assert_array_equal(relations.first_times, [1.5, 3.0])
    np.testing.assert_array_equal(relations.second_times, [2.5, 4.0])
    np.testing.assert_array_equal(relations.motions, [[0.1, -0.2, -1.2], [1.0, 2.0, 0.5]])


@pytest.mark.parametrize(
    ("text", "told"), [("", "holds no relations"), ("1 2 3\n", ":1: 3 fields"), ("x\n", ":1: a field")]
)
def test_broken_relations_name_the_row(tmp_path, text, told):
    (tmp_path / "a.relations").write_text(text)
    with pytest.raises(FormatError, match=told):
        read_relations(tmp_path / "a.relations")


def test_g2o_keeps_the_graph(tmp_path):
    vertices = random_poses(4)
    graph = Graph(vertices, np.array([[0, 1], [1, 2], [2, 3], [3, 0]]), random_poses(4), np.arange(24.0).reshape(4, 6))
    write_g2o(tmp_path / "a.g2o", graph)
    again = read_g2o(tmp_path / "a.g2o")
    for written, read in zip(graph, again, strict=True):
        np.testing.assert_allclose(read, written, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "holds no VERTEX_SE2"),
        ("VERTEX_SE2 0 1 2\n", ":1: 3 numbers"),
        ("VERTEX_SE2 0 1 2 x\n", ":1: a field is not a number"),
        ("VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 1 0 0 0 1 0 0 1 0 1\n", ":2: the edge 0 1 names a vertex that is not there"),
    ],
)
def test_broken_g2o_names_the_row(tmp_path, text, told):
    (tmp_path / "a.g2o").write_text(text)
    with pytest.raises(FormatError, match=told):
        read_g2o(tmp_path / "a.g2o")


def test_ros_map_keeps_cells_and_place(tmp_path):
    cells = np.random.default_rng(2).choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), (7, 5))
    write_ros_map(tmp_path / "floor", OccupancyMap(cells, 0.05, (-1.25, 3.5, 0.0)))
    again = read_ros_map(tmp_path / "floor.yaml")
    np.testing.assert_array_equal(again.cells, cells)
    assert again.resolution == 0.05
    assert again.origin == (-1.25, 3.5, 0.0)


def test_ros_map_has_its_highest_row_first(tmp_path):
    cells = np.full((2, 3), FREE, np.int8)
    cells[0, 2] = OCCUPIED  # lowest y, highest x
    write_ros_map(tmp_path / "floor", OccupancyMap(cells, 0.1, (0.0, 0.0, 0.0)))
    header, _, pixels = (tmp_path / "floor.pgm").read_bytes().partition(b"\n255\n")
    assert header == b"P5\n3 2"
    assert list(pixels) == [254, 254, 254, 254, 254, 0]


def test_ros_map_reads_plain_and_inverted_pictures(tmp_path):
    (tmp_path / "a.pgm").write_bytes(b"P2\n# made by hand\n2 1\n# levels\n255\n0 255\n")
    for negate, expected in ((0, [[OCCUPIED, FREE]]), (1, [[FREE, OCCUPIED]])):
        yaml = f"image: a.pgm  # beside\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: {negate}\n"
        (tmp_path / "a.yaml").write_text(yaml)
        np.testing.assert_array_equal(read_ros_map(tmp_path / "a.yaml").cells, expected)


@pytest.mark.parametrize(
    ("yaml", "picture", "told"),
    [
        ("resolution\n", b"", "a.yaml:1: `resolution` is no `key: value`"),
        ("origin: [0, 0, 0]\n", b"", "a.yaml:resolution: is missing"),
        ("resolution: 0\n", b"", "is not above zero"),
        ("resolution: x\n", b"", "is not a number"),
        ("resolution: 1\norigin: 5\n", b"P5 1 1 255\nx", "a.yaml:origin: is not"),
        ("resolution: 1\nmode: magic\n", b"", "a.yaml:mode: `magic` is unknown"),
        ("resolution: 1\n", b"GIF89a", "a.pgm: is no PGM picture"),
        ("resolution: 1\n", b"P5 4 4 255\nxx", "a.pgm: does not hold 4 x 4 pixels"),
        ("resolution: 1\n", b"P5 1 1 65535\nxx", "a.pgm: has 65535 gray levels"),
    ],
)
def test_broken_ros_map_names_the_key(tmp_path, yaml, picture, told):
    (tmp_path / "a.yaml").write_text(yaml)
    (tmp_path / "a.pgm").write_bytes(picture)
    with pytest.raises(FormatError) as error:
        read_ros_map(tmp_path / "a.yaml")
    assert told in str(error.value)


def test_atomic_writing_replaces_and_leaves_nothing_else(tmp_path):
    write_atomically(tmp_path / "a", "one")
    write_atomically(tmp_path / "a", b"two")
    assert (tmp_path / "a").read_text() == "two"
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert (tmp_path / "a").stat().st_mode & 0o400


def test_unwritable_place_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FormatError, match="cannot be written"):
        write_atomically(tmp_path / "missing" / "a", "one")
    with pytest.raises(FormatError, match="cannot be written"):
        make_directory(tmp_path / "file" / "below")
