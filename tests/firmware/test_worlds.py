"""Worlds: rays against a slow twin, files read or refused in one line, grids and scans that become true walls."""

import os
import struct
from pathlib import Path

import numpy as np
import pytest

from firmware.virtual import World, WorldError, corridor_cycle, load_world
from firmware.virtual.contours import simplify, trace_walls
from tests.firmware.virtual_wire import room
from tests.naive import caster as naive

DATA = Path(os.environ.get("CRUNCH_DATA", Path(__file__).parents[2] / "data")) / "maps"
needs_maps = pytest.mark.skipif(not DATA.is_dir(), reason=f"no maps in {DATA}; set CRUNCH_DATA")


def clutter(rng, count, size):
    start = rng.uniform(0.0, size, (count, 2))
    return np.hstack([start, start + rng.normal(0.0, 0.7, (count, 2))])


def test_rays_and_clearances_agree_with_their_slow_twins():
    rng = np.random.default_rng(1)
    world = World(clutter(rng, 120, 8.0))
    x, y = rng.uniform(-2.0, 10.0, (2, 300))
    bearings = np.concatenate([rng.uniform(-np.pi, np.pi, 260), np.arange(40) * np.pi / 2])
    ranges = world.cast(x, y, bearings, 6.0)
    expected = [naive.cast(world.segments, a, b, c, 6.0) for a, b, c in zip(x, y, bearings, strict=True)]
    np.testing.assert_allclose(ranges, expected, atol=1e-9)
    clearances = world.clearances(np.column_stack([x, y]), 20.0)
    expected = [naive.clearance(world.segments, a, b) for a, b in zip(x, y, strict=True)]
    np.testing.assert_allclose(clearances, expected, atol=1e-9)


def test_rays_along_bins_borders_and_from_outside_hit():
    world = room(4.0, 2.0)  # walls on multiples of a bin's side
    assert world.cast(0.0, 0.0, np.array([0.0, np.pi / 2, np.pi, -np.pi / 2])) == pytest.approx([2.0, 1.0, 2.0, 1.0])
    assert world.cast(-50.0, 0.3, 0.0) == pytest.approx(48.0)
    assert np.isinf(world.cast(-50.0, 0.3, np.pi))
    assert np.isinf(world.cast(0.0, 0.0, 0.0, reach=1.9))


def test_large_worlds_find_the_same_walls():
    rng = np.random.default_rng(2)
    world = World(clutter(rng, 50_000, 100.0))
    rays = rng.uniform(30.0, 70.0, (20, 2))
    bearings = rng.uniform(-np.pi, np.pi, 20)
    ranges = world.cast(rays[:, 0], rays[:, 1], bearings, 3.0)
    near = [world.segments[np.hypot(*(world.segments[:, :2] - ray).T) < 8.0] for ray in rays]
    expected = [naive.cast(walls, r[0], r[1], b, 3.0) for walls, r, b in zip(near, rays, bearings, strict=True)]
    np.testing.assert_allclose(ranges, expected, atol=1e-9)


def test_a_world_without_walls_is_open_space():
    world = World(np.empty((0, 4)))
    assert np.isinf(world.cast(0.0, 0.0, 0.3))
    assert np.isinf(world.clearances(np.zeros((1, 2)), 5.0))


def test_simplified_lines_stay_within_the_tolerance():
    x = np.linspace(0.0, 10.0, 400)
    line = np.column_stack([x, np.sin(x)])
    kept = simplify(line, 0.05)
    assert len(kept) < 40
    walls = np.hstack([kept[:-1], kept[1:]])
    assert max(naive.clearance(walls, *point) for point in line) <= 0.05 + 1e-12


@pytest.mark.parametrize("angle", [0.0, 0.2, 0.6, np.pi / 4])
def test_walls_of_a_grid_stand_where_they_stood_and_look_the_same_way(angle):
    """A half plane drawn in cells of 5 cm: the traced wall's distance and normal, whatever its direction."""
    y, x = np.mgrid[0:120, 0:120] * 0.05 + 0.025
    normal = np.array([np.cos(angle), np.sin(angle)])
    occupied = ((x - 3.0) * normal[0] + (y - 3.0) * normal[1] > 0.8).astype(float)
    world = World.from_grid(occupied, 0.05)
    spread = angle + np.radians(np.arange(-10, 11, 5))
    assert world.cast(3.0, 3.0, spread) * np.cos(spread - angle) == pytest.approx(0.8, abs=0.045)
    walls = world.segments[naive_near(world, 3.0 + 0.8 * normal)]
    along = walls[:, 2:] - walls[:, :2]
    cosine = np.abs(along @ normal) / np.hypot(*along.T)
    assert np.average(cosine, weights=np.hypot(*along.T)) < 0.1


def naive_near(world, point, reach=0.5):
    return [naive.clearance(wall[None], *point) < reach for wall in world.segments]


def test_lone_cells_are_noise_and_posts_are_walls():
    grid = np.zeros((20, 20))
    grid[5, 5] = 1.0
    assert len(trace_walls(grid, 0.1, 0.0, 0.0)) == 0
    grid[10:13, 10:13] = 1.0
    walls = trace_walls(grid, 0.1, 1.0, 2.0)
    assert len(walls) >= 4
    assert walls.mean(axis=0) == pytest.approx([2.15, 3.15, 2.15, 3.15], abs=0.05)


def test_a_world_drawn_from_scans_gives_the_scans_back():
    truth = room(6.0, 4.0)
    rng = np.random.default_rng(3)
    poses = np.column_stack([rng.uniform(-2.0, 2.0, 60), rng.uniform(-1.2, 1.2, 60), rng.uniform(-3.0, 3.0, 60)])
    bearings = np.radians(np.arange(-90, 91, 1.0))
    ranges = truth.cast(poses[:, :1], poses[:, 1:2], poses[:, 2:] + bearings)
    ranges += rng.normal(0.0, 0.01, ranges.shape)
    ranges[::7, ::5] = 80.0  # no return
    drawn = World.from_scans(poses, ranges, bearings, 20.0)
    seen = drawn.cast(poses[:, :1], poses[:, 1:2], poses[:, 2:] + bearings)
    errors = seen - truth.cast(poses[:, :1], poses[:, 1:2], poses[:, 2:] + bearings)
    assert np.mean(np.abs(errors) < 0.10) > 0.95  # two cells; slant rays meet a wall's thickness sooner
    assert -0.05 < np.median(errors) <= 0.0  # walls are as thick as their cells, and grow inward
    assert drawn.free is not None
    assert np.all(np.abs(drawn.free) <= [3.05, 2.05])


def test_scans_that_do_not_fit_are_refused():
    with pytest.raises(WorldError, match=r"need \(n, 3\), \(n, b\) and \(b,\)"):
        World.from_scans(np.zeros((2, 3)), np.ones((3, 4)), np.zeros(4), 10.0)
    with pytest.raises(WorldError, match="no walls"):
        World.from_scans(np.zeros((1, 3)), np.full((1, 4), 99.0), np.zeros(4), 10.0)


@pytest.mark.parametrize("name", ["demo", "corridor50"])
def test_built_in_worlds_start_in_the_open(name):
    world = load_world(name)
    assert world.name == name
    assert world.clearances(world.start[None, :2], 5.0)[0] > 0.4
    assert world.enclosure(world.start[None, :2], 20.0)[0] == 1.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("walls = [[[0, 0], [1, 0]]]\nwals = 1", r"wals: unknown key; known are .*walls"),
        ("walls = [[[0, 0]]]", r"walls\[0\]: needs at least two points"),
        ("walls = [[[0, 0], [1, 'a']]]", r"walls\[0\]\[1\]: needs a list of 2 numbers"),
        ("segments = [[1, 2, 3]]", r"segments\[0\]: needs a list of 4 numbers"),
        ("start = [0, 0]\nsegments = [[0, 0, 1, 1]]", r"start: needs a list of 3 numbers"),
        ("name = 'empty'", "no walls"),
        ("walls = [", "not TOML"),
    ],
)
def test_bad_worlds_name_file_place_and_remedy(tmp_path, text, message):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(WorldError, match=r"bad\.toml: " + message) as caught:
        load_world(path)
    assert "\n" not in str(caught.value)


def test_missing_worlds_are_told_what_there_is(tmp_path):
    with pytest.raises(WorldError, match=r"no such file.*corridor50, cut-rectangle, demo"):
        load_world("nowhere")
    with pytest.raises(WorldError, match="is a directory"):
        load_world(tmp_path)
    (tmp_path / "world.obj").write_text("")
    with pytest.raises(WorldError, match=r"no world ends in '\.obj'"):
        load_world(tmp_path / "world.obj")


def carmen(cells, resolution=0.1):
    head = struct.pack("<iif", cells.shape[0], cells.shape[1], resolution)
    return b"# made by hand\nCARMENMAPFILEv020 GRIDMAP" + bytes(3) + head + cells.astype("<f4").tobytes()


def test_carmen_grids_are_columns_first_and_unknown_is_no_wall(tmp_path):
    cells = np.full((40, 20), -1.0)  # 40 columns, 20 rows
    cells[5:35, 5:15] = 0.01
    cells[35, 5:15] = 0.99
    cells[36, 5:15] = 0.99
    path = tmp_path / "made.map"
    path.write_bytes(carmen(cells))
    world = load_world(path)
    assert world.cast(2.0, 1.0, 0.0) == pytest.approx(1.5, abs=0.06)
    assert np.isinf(world.cast(2.0, 1.0, np.pi))
    assert world.free is not None
    assert len(world.free) == 300


@pytest.mark.parametrize(
    ("data", "message"),
    [(b"hello", "not a CARMEN map"), (b"CARMENMAPFILE", "no GRIDMAP"), (carmen(np.zeros((9, 9)))[:-5], "ends at byte")],
)
def test_bad_carmen_maps_are_refused(tmp_path, data, message):
    path = tmp_path / "bad.map"
    path.write_bytes(data)
    with pytest.raises(WorldError, match=message):
        load_world(path)


def test_ros_maps_turn_about_their_origin(tmp_path):
    pixels = np.full((20, 30), 254, np.uint8)
    pixels[2:4, :] = 0
    (tmp_path / "floor.pgm").write_bytes(b"P5 30 20 255\n" + pixels.tobytes())
    text = "image: floor.pgm\nresolution: 0.1\norigin: [-1.0, -2.0, {}]\nnegate: 0\n"
    (tmp_path / "upright.yaml").write_text(text.format(0.0))
    (tmp_path / "turned.yaml").write_text(text.format(0.6))
    upright, turned = load_world(tmp_path / "upright.yaml"), load_world(tmp_path / "turned.yaml")
    corner = -1.0 - 2.0j
    for before, after in (
        (upright.segments.reshape(-1, 2), turned.segments.reshape(-1, 2)),
        (upright.free, turned.free),
        (upright.start[None, :2], turned.start[None, :2]),
    ):
        expected = corner + (np.array(before) @ [1.0, 1.0j] - corner) * np.exp(0.6j)
        np.testing.assert_allclose(np.array(after) @ [1.0, 1.0j], expected, atol=1e-9)
    assert turned.start[2] == pytest.approx(0.6)
    x, y = upright.start[:2]
    upright_range = upright.cast(x, y, np.pi / 2)
    x, y = turned.start[:2]
    assert turned.cast(x, y, 0.6 + np.pi / 2) == pytest.approx(upright_range, abs=1e-9)


def test_ros_maps_stand_on_their_origin_right_way_up(tmp_path):
    pixels = np.full((20, 30), 254, np.uint8)
    pixels[2:4, :] = 0  # near the image's top: far in y
    (tmp_path / "floor.pgm").write_bytes(b"P5 30 20 255\n" + pixels.tobytes())
    path = tmp_path / "floor.yaml"
    path.write_text("image: floor.pgm\nresolution: 0.1\norigin: [-1.0, -2.0, 0.0]\nnegate: 0\n")
    world = load_world(path)
    assert world.cast(0.0, -1.5, np.pi / 2) == pytest.approx(1.1, abs=0.06)
    path.write_text("image: missing.pgm\nresolution: 0.1\norigin: [0, 0, 0]\n")
    with pytest.raises(WorldError, match=r"floor\.yaml: image: cannot read"):
        load_world(path)
    path.write_text("image: floor.pgm\n")
    with pytest.raises(WorldError, match="resolution: missing"):
        load_world(path)


@needs_maps
@pytest.mark.parametrize("name", ["freiburg.map", "longwood.map", "ac109_1.yaml"])
def test_real_maps_become_worlds(name):
    world = load_world(DATA / name)
    assert 200 < len(world.segments) < 5000
    assert world.free is not None
    assert world.enclosure(world.start[None, :2])[0] > 0.7
    inside = world.free[:: max(1, len(world.free) // 2000)]
    assert np.mean(world.clearances(inside, 0.05) > 0.01) > 0.95


def test_corridor_cycles_are_seeded_and_as_wide_as_asked():
    for seed, width in ((0, 1.5), (1, 1.8), (2, 2.4)):
        world = corridor_cycle(seed, width=width)
        np.testing.assert_array_equal(world.segments, corridor_cycle(seed, width=width).segments)
        across = world.cast(np.linspace(1.0, 15.0, 200), 0.0, np.pi / 2) + world.cast(
            np.linspace(1.0, 15.0, 200), 0.0, -np.pi / 2
        )
        assert np.median(across) == pytest.approx(width, abs=0.13)
        assert np.mean(np.abs(across - width) < 1e-9) > 0.3
    assert len(corridor_cycle(3).segments) != len(corridor_cycle(4).segments)
    with pytest.raises(ValueError, match="does not fit"):
        corridor_cycle(0, width=6.0)
