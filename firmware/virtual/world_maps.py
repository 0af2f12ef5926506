"""Other people's maps as worlds: CARMEN `.map` grids and ROS map_server images.

Unknown is not a wall: nothing reflects from it, and routes keep to cells that are known to be free. So an unmapped gap
looks like an open door that nobody has a reason to drive through.
"""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, UnidentifiedImageError

from firmware.virtual.worlds import World, WorldError

MAGIC = b"CARMENMAPFILE"
MAX_COMMENTS = 65536  # lines of text may stand before the magic
GRID_CHUNK = b"GRIDMAP"
GRID_HEADER = struct.Struct("<iif")  # size x, size y, resolution
MAX_CELLS = 100_000_000


class Floor(NamedTuple):
    """Grid (rows, columns): probability of a wall, 0 where unknown, and which cells are known to be free."""

    walls: np.ndarray
    is_free: np.ndarray
    resolution: float
    x: float
    y: float


def load_carmen(path: Path) -> World:
    """World of a CARMEN map: float32 probabilities, column-major, negative is unknown. Raises WorldError."""
    data = path.read_bytes()
    magic = data.find(MAGIC, 0, MAX_COMMENTS)
    if magic < 0:
        raise WorldError(f"{path}: byte 0: not a CARMEN map (no {MAGIC.decode()}); other formats need their own ending")
    at = data.find(GRID_CHUNK, magic)
    if at < 0 or len(data) < at + 10 + GRID_HEADER.size:
        raise WorldError(f"{path}: no GRIDMAP chunk in it; export the map again with its grid")
    columns, rows, resolution = GRID_HEADER.unpack_from(data, at + 10)
    if min(columns, rows) < 1 or columns * rows > MAX_CELLS or not 0.0 < resolution < 10.0:
        raise WorldError(
            f"{path}: byte {at + 10}: grid of {columns} x {rows} cells of {resolution} m; the file is damaged"
        )
    begin = at + 10 + GRID_HEADER.size
    if len(data) < begin + 4 * columns * rows:
        raise WorldError(
            f"{path}: ends at byte {len(data)}, the grid needs {begin + 4 * columns * rows}; fetch it again"
        )
    cells = np.frombuffer(data, "<f4", columns * rows, begin).reshape(columns, rows).T
    is_known = cells >= 0.0
    walls = np.where(is_known, np.clip(cells, 0.0, 1.0), 0.0).astype(float)
    return world_of_floor(Floor(walls, is_known & (cells < 0.4), float(resolution), 0.0, 0.0), path.stem)


def read_yaml(path: Path) -> dict[str, str]:
    """The flat `key: value` lines of a map_server description; comments are dropped."""
    entries = {}
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        text = line.split("#", 1)[0].strip()
        if not text or text == "---":
            continue
        key, colon, value = text.partition(":")
        if not colon:
            raise WorldError(f"{path}: line {number}: expected 'key: value', found {text!r}")
        entries[key.strip()] = value.strip().strip("'\"")
    return entries


def yaml_numbers(entries: dict[str, str], key: str, default: str, path: Path) -> list[float]:
    """Numbers of one entry, `[a, b, c]` or a single one."""
    text = entries.get(key, default)
    try:
        return [float(part) for part in text.strip("[]").split(",")]
    except ValueError:
        raise WorldError(f"{path}: {key}: expected numbers, found {text!r}") from None


def load_ros(path: Path) -> World:
    """World of a ROS map_server yaml and its image (pgm, png, also colour). Raises WorldError."""
    entries = read_yaml(path)
    for key in ("image", "resolution", "origin"):
        if key not in entries:
            raise WorldError(f"{path}: {key}: missing; a map_server yaml needs image, resolution and origin")
    image = path.parent / entries["image"]
    try:
        with Image.open(image) as opened:
            shades = np.asarray(opened.convert("L"), float) / 255.0
    except (OSError, UnidentifiedImageError) as problem:
        raise WorldError(f"{path}: image: cannot read {image} ({problem}); put the picture beside the yaml") from None
    resolution = yaml_numbers(entries, "resolution", "0", path)[0]
    origin = yaml_numbers(entries, "origin", "0", path)
    if not resolution > 0.0 or len(origin) < 2:
        raise WorldError(f"{path}: resolution must be above 0 and origin needs x, y, yaw")
    occupied = shades if yaml_numbers(entries, "negate", "0", path)[0] else 1.0 - shades
    occupied = occupied[::-1]  # the image's first row is the map's last
    threshold = yaml_numbers(entries, "occupied_thresh", "0.65", path)[0]
    free = yaml_numbers(entries, "free_thresh", "0.196", path)[0]
    walls = np.where(occupied > threshold, 1.0, 0.0)
    yaw = origin[2] if len(origin) > 2 else 0.0
    if not np.all(np.isfinite(origin)):
        raise WorldError(f"{path}: origin: expected finite numbers, found {entries['origin']!r}")
    world = world_of_floor(Floor(walls, occupied < free, resolution, origin[0], origin[1]), path.stem)
    return turned(world, np.array(origin[:2]), yaw)


def turned(world: World, corner: np.ndarray, yaw: float) -> World:
    """The world of an upright grid turned by `yaw` (rad) about its corner (2,), as a map's origin tells."""
    if yaw == 0.0 or world.free is None:
        return world
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([[cos, sin], [-sin, cos]])
    segments = ((world.segments.reshape(-1, 2) - corner) @ turn + corner).reshape(-1, 4)
    start = np.array([*((world.start[:2] - corner) @ turn + corner), world.start[2] + yaw])
    return World(segments, start, world.name, (world.free - corner) @ turn + corner, world.free_resolution)


def world_of_floor(floor: Floor, name: str) -> World:
    """World of a grid, started at a roomy known place indoors."""
    if not np.any(floor.walls > 0.5):
        raise WorldError(f"{name}: no wall cell in the whole map; is it the right layer, or negated?")
    world = World.from_grid(floor.walls, floor.resolution, floor.x, floor.y, name)
    rows, columns = np.nonzero(floor.is_free)
    if not len(rows):
        raise WorldError(f"{name}: no free cell in the whole map; is it negated?")
    corner = np.array([floor.x, floor.y])
    world.free = (np.column_stack([columns, rows]) + 0.5) * floor.resolution + corner
    world.free_resolution = floor.resolution
    world.start = np.array([*roomiest(world), 0.0])
    return world


def roomiest(world: World, reach: float = 1.0) -> np.ndarray:
    """A place indoors: of the known free cells most enclosed by walls, with room, the one nearest to their middle."""
    assert world.free is not None
    cells = world.free[:: max(1, len(world.free) // 20000)]
    score = world.enclosure(cells) + np.minimum(world.clearances(cells, reach), reach) / reach
    candidates = cells[score >= 0.9 * score.max()]
    return candidates[np.argmin(np.hypot(*(candidates - candidates.mean(axis=0)).T))]
