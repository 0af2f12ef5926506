"""Maps: what was seen free is free, walls are where they were seen, and every file says the same."""

from __future__ import annotations

import csv
import io
import json
import math

import numpy as np
import pytest
from PIL import Image

from server import map_files, map_picture, maps
from server.formats.ros_map import FREE, OCCUPIED, UNKNOWN
from slam.pose import between
from slam.walls import Walls

N_RAYS = 120
TIMES = np.array([1.0, 2.0, 3.5])
OLD_COLUMNS = ("vertex", "time", "distance", "nodes_per_particle", "settled")


def room_walls(pose: np.ndarray, half: float = 1.0) -> Walls:
    """What is seen from a pose within a square room around the origin, `half` m to each side."""
    angles = pose[2] + 2.0 * np.pi * np.arange(N_RAYS) / N_RAYS
    cos, sin = np.cos(angles), np.sin(angles)
    distances = np.minimum(
        (np.copysign(half, cos) - pose[0]) / np.where(cos == 0.0, 1e-12, cos),
        (np.copysign(half, sin) - pose[1]) / np.where(sin == 0.0, 1e-12, sin),
    )
    return Walls(distances, distances - 0.05)


@pytest.fixture
def room() -> tuple[np.ndarray, list[Walls]]:
    path = np.array([[-0.3, 0.0, 0.0], [0.1, 0.1, 0.5], [0.3, -0.2, 2.0]])
    return path, [room_walls(pose) for pose in path]


def cell_at(grid: maps.OccupancyMap, x: float, y: float) -> int:
    column = int((x - grid.origin[0]) / grid.resolution)
    row = int((y - grid.origin[1]) / grid.resolution)
    return int(grid.cells[row, column])


def test_a_room_is_free_inside_walled_and_unknown_outside(room):
    grid = maps.occupancy(*room)
    assert cell_at(grid, 0.0, 0.0) == FREE
    assert cell_at(grid, 0.8, -0.8) == FREE
    for angle in np.linspace(-np.pi, np.pi, 40):
        x, y = math.cos(angle), math.sin(angle)
        scale = 1.0 / max(abs(x), abs(y))
        near = [cell_at(grid, s * x * scale, s * y * scale) for s in (0.97, 1.0, 1.03)]
        assert OCCUPIED in near, f"no wall at {math.degrees(angle):.0f} degrees"
        assert cell_at(grid, 1.2 * x * scale, 1.2 * y * scale) == UNKNOWN


def test_walls_and_free_space_lie_at_the_path_whatever_its_frame(room):
    path, walls = room
    turn, shift = 0.8, np.array([10.0, -20.0])
    cos, sin = math.cos(turn), math.sin(turn)
    moved = np.column_stack([path[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + shift, path[:, 2] + turn])
    counts = [
        {value: int(np.sum(maps.occupancy(poses, walls).cells == value)) for value in (FREE, OCCUPIED)}
        for poses in (path, moved)
    ]
    assert counts[1][FREE] == pytest.approx(counts[0][FREE], rel=0.05)
    assert counts[1][OCCUPIED] == pytest.approx(counts[0][OCCUPIED], rel=0.6), "a line of cells is longer aslant"


def test_a_wall_seen_by_few_gives_way_to_free_space_seen_by_many():
    pose = np.zeros(3)
    ghost = Walls(np.where(np.arange(N_RAYS) < 8, 0.5, np.inf), np.full(N_RAYS, 0.4))
    clear = Walls(np.full(N_RAYS, np.inf), np.full(N_RAYS, 0.9))
    grid = maps.occupancy(np.array([pose] * 10), [ghost] + [clear] * 9)
    assert cell_at(grid, 0.49, 0.1) == FREE
    grid = maps.occupancy(np.array([pose] * 2), [ghost, clear])
    assert OCCUPIED in [cell_at(grid, x, 0.1) for x in (0.44, 0.49, 0.54)]


def test_an_empty_path_gives_an_empty_map():
    floor = maps.floor_map(np.zeros((0, 3)), [])
    assert floor.grid is not None
    assert floor.grid.cells.tolist() == [[UNKNOWN]]
    assert map_picture.draw_png(floor, "nothing").startswith(b"\x89PNG")


def test_the_picture_shows_walls_path_start_and_end(room):
    path, walls = room
    picture = Image.open(io.BytesIO(map_picture.draw_png(maps.floor_map(path, walls, 1), "Title", "subtitle")))
    assert min(picture.size) > 400
    colours = np.asarray(picture.convert("RGB")).reshape(-1, 3).astype(int)
    for tint in (
        map_picture.SETTLED_TINT,
        map_picture.OPEN_TINT,
        map_picture.START_TINT,
        map_picture.END_TINT,
        map_picture.FREE_TINT,
        map_picture.PAPER,
    ):
        wanted = np.array([int(tint[i : i + 2], 16) for i in (1, 3, 5)])
        assert np.any(np.abs(colours - wanted).max(axis=1) < 12), f"{tint} is missing"


def test_the_picture_is_the_same_each_time(room):
    floor = maps.floor_map(*room)
    assert map_picture.draw_png(floor, "a") == map_picture.draw_png(floor, "a")


def test_json_holds_path_and_walls_in_the_world(room):
    path, walls = room
    content = json.loads(map_files.map_json(maps.floor_map(path, walls, 1), "crunch"))
    assert content["format"] == "crunch-map-1"
    assert content["settled"] == 2
    np.testing.assert_allclose(content["path"], path, atol=1e-3)
    points = np.concatenate([np.array(curve) for curve in content["walls"]])
    np.testing.assert_allclose(np.abs(points).max(axis=1), 1.0, atol=2e-3)


def test_profile_has_a_row_per_vertex():
    path = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.5, 1.0]])
    profile = map_files.Profile(np.array([0.01, 0.01, 1.0]), 2, np.array([[0, 0, 0], [0.1, 0.2, 0.03], [1, 2, 0.3]]))
    rows = map_files.profile_csv(TIMES, path, profile).splitlines()
    assert rows[0] == "vertex,time,distance,nodes_per_particle,settled,x_std,y_std,heading_std"
    assert rows[1:] == [
        "0,1.000000,0.000,0.010000,1,0.0000,0.0000,0.00000",
        "1,2.000000,0.500,0.010000,1,0.1000,0.2000,0.03000",
        "2,3.500000,1.000,1.000000,0,1.0000,2.0000,0.30000",
    ]
    unknown = map_files.profile_csv(TIMES, path, profile._replace(deviations=np.zeros((0, 3)))).splitlines()
    assert [row.rsplit(",", 3)[0] for row in unknown] == [row.rsplit(",", 3)[0] for row in rows]
    assert {row.count(",") for row in unknown} == {7}
    assert all(row.endswith(",,,") for row in unknown[1:])


@pytest.mark.parametrize("deviations", [np.zeros((0, 3)), np.full((3, 3), 0.25)])
def test_who_reads_the_first_columns_of_a_profile_still_can(deviations):
    path, nodes = np.zeros((3, 3)), np.array([0.01, 0.01, 1.0])
    text = map_files.profile_csv(TIMES, path, map_files.Profile(nodes, 2, deviations))
    by_place = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1, usecols=range(5))
    by_name = [[float(row[name]) for name in OLD_COLUMNS] for row in csv.DictReader(io.StringIO(text))]
    np.testing.assert_array_equal(by_place, by_name)
    np.testing.assert_array_equal(by_place.T, [[0, 1, 2], TIMES, [0, 0, 0], nodes, [1, 1, 0]])


def test_a_profile_with_a_row_missing_is_a_mistake():
    with pytest.raises(ValueError, match="zip"):
        map_files.profile_csv(TIMES, np.zeros((3, 3)), map_files.Profile(np.ones(3), 1, np.zeros((2, 3))))


def test_pose_graph_joins_neighbours_by_what_odometry_measured():
    rng = np.random.default_rng(4)
    path, odometry = rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    graph = map_files.pose_graph(path, odometry, 0.04, 0.05)
    np.testing.assert_array_equal(graph.pairs, [[0, 1], [1, 2], [2, 3], [3, 4]])
    np.testing.assert_allclose(graph.motions, between(odometry[:-1], odometry[1:]))
    lengths = np.hypot(*graph.motions[:, :2].T)
    np.testing.assert_allclose(1.0 / graph.information[:, 0], 0.05**2 * np.maximum(lengths, 0.1))


@pytest.mark.parametrize(("length", "rounded"), [(0.99, 0.5), (1.0, 1.0), (4.9, 2.0), (50.0, 50.0), (0.03, 0.02)])
def test_scale_bars_have_round_lengths(length, rounded):
    assert map_picture.round_length(length) == pytest.approx(rounded)


def test_trail_meets_where_the_path_is_settled():
    trajectory = np.arange(30.0).reshape(10, 3)
    settled, still_open = maps.trail_of(trajectory, np.array([0, 4, 9]), 2)
    np.testing.assert_array_equal(settled, trajectory[:5])
    np.testing.assert_array_equal(still_open[0], trajectory[4])
    np.testing.assert_array_equal(still_open[-1], trajectory[-1])


def test_a_jump_of_kilometres_makes_the_grid_coarser_and_not_larger(room):
    path, walls = room
    path = path + np.array([[0.0, 0.0, 0.0], [9000.0, -40.0, 0.0], [9000.0, -40.0, 0.0]])
    grid = maps.occupancy(path, walls)
    assert maps.MAX_CELLS / 2 <= max(grid.cells.shape) <= maps.MAX_CELLS
    assert math.log2(grid.resolution / maps.RESOLUTION) % 1.0 == 0.0
    assert OCCUPIED in grid.cells


def test_a_path_is_as_long_as_its_way_and_trembling_is_none():
    rng = np.random.default_rng(0)
    still = np.column_stack([rng.normal(0.0, 0.003, (600, 2)), np.zeros(600)])
    there = np.column_stack([np.linspace(0.0, 2.0, 100), np.zeros((100, 2))])
    path = np.concatenate([still, there, there[::-1]])
    assert maps.path_length(there) == pytest.approx(2.0)
    assert maps.path_length(path) > 6.0
    assert maps.path_length(path, 0.02) == pytest.approx(4.0, abs=0.03)
    assert maps.path_length(path[:1], 0.02) == maps.path_length(path[:0], 0.02) == 0.0
