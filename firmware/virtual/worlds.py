"""Worlds: walls as line segments on the floor, and where the robot starts. Reads TOML; grids become segments too.

`load_world` takes the name of a built-in world or a path: `.toml` (walls, rectangles, segments), `.map` (CARMEN grid)
or `.yaml` (ROS map_server). Metres, x right, y up.
"""

from __future__ import annotations

import itertools
import math
import tomllib
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from firmware.virtual.native import native

BUILT_IN = Path(__file__).resolve().parent / "worlds"
TOML_KEYS = {"name", "title", "start", "walls", "rectangles", "segments"}


class WorldError(ValueError):
    """A world that cannot be used; the message names file, place and remedy in one line."""


class World:
    """Walls `segments` (n, 4) as x1, y1, x2, y2; `start` (3,) pose; `free` (m, 2) optional centres of known free cells.

    `free_resolution` is the side of those cells. Worlds without them are free wherever the start can reach.
    """

    def __init__(
        self,
        segments: np.ndarray,
        start: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0),
        name: str = "world",
        free: np.ndarray | None = None,
        free_resolution: float = 0.0,
    ):
        self.segments = np.ascontiguousarray(np.reshape(segments, (-1, 4)), dtype=float)
        if not np.all(np.isfinite(self.segments)):
            raise WorldError(f"{name}: a wall has a coordinate that is not a number; remove or correct it")
        lengths = np.hypot(*(self.segments[:, 2:] - self.segments[:, :2]).T)
        self.segments = np.ascontiguousarray(self.segments[lengths > 1e-9])
        self.start = np.asarray(start, float)
        self.name = name
        self.free = free
        self.free_resolution = free_resolution

    @classmethod
    def from_grid(
        cls, occupied: np.ndarray, resolution: float, x: float = 0.0, y: float = 0.0, name: str = "grid"
    ) -> World:
        """World of a grid (rows, columns) of walls; values in 0..1 are probabilities, contoured at one half.

        Row is y, column is x, (x, y) the corner of cell (0, 0). Unknown cells must be given as 0: not a wall.
        """
        from firmware.virtual.contours import trace_walls

        return cls(trace_walls(np.asarray(occupied, float), resolution, x, y), name=name)

    @classmethod
    def from_scans(
        cls, poses: np.ndarray, ranges: np.ndarray, bearings: np.ndarray, max_range: float, resolution: float = 0.05
    ) -> World:
        """World drawn from laser scans: poses (n, 3), ranges (n, b) at bearings (b,).

        Ranges at or beyond `max_range` say nothing.
        """
        from firmware.virtual.scans import world_of_scans

        return world_of_scans(poses, ranges, bearings, max_range, resolution)

    @cached_property
    def caster(self) -> Any:
        """The walls as C knows them (`struct caster *`), freed with the world."""
        ffi, lib, _ = native()
        made = lib.caster_new(ffi.cast("struct segment *", self.segments.ctypes.data), len(self.segments))
        if made == ffi.NULL:
            raise MemoryError(f"{self.name}: no memory for {len(self.segments)} walls")
        return ffi.gc(made, lib.caster_free)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, bottom, right, top of all walls; a square metre around the start where there are none."""
        if not len(self.segments):
            x, y = self.start[:2]
            return x - 0.5, y - 0.5, x + 0.5, y + 0.5
        points = self.segments.reshape(-1, 2)
        (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
        return float(left), float(bottom), float(right), float(top)

    @cached_property
    def walls(self) -> list[np.ndarray]:
        """Outlines (n, 2) of the free space, the one around the most first; WorldError where walls have open ends.

        Each is closed: its last corner and its first one are neighbours.
        """
        from firmware.virtual.polygons import closed_outlines

        return closed_outlines(self.segments, self.name)

    def cast(
        self, x: np.ndarray | float, y: np.ndarray | float, bearings: np.ndarray | float, reach: float = 100.0
    ) -> np.ndarray:
        """Ranges to the first wall, inf beyond `reach`; the arguments broadcast against each other."""
        ffi, lib, _ = native()
        rays = np.ascontiguousarray(np.stack(np.broadcast_arrays(x, y, bearings), axis=-1), dtype=float)
        ranges = np.empty(rays.shape[:-1])
        double = "double *"
        lib.caster_rays(
            self.caster, ffi.cast(double, rays.ctypes.data), ranges.size, reach, ffi.cast(double, ranges.ctypes.data)
        )
        return ranges

    def enclosure(self, points: np.ndarray, reach: float = 6.0, rays: int = 16) -> np.ndarray:
        """Share (n,) of directions in which each point (n, 2) sees a wall within `reach`: 1 indoors, 0 in the open."""
        bearings = np.arange(rays) * (2.0 * math.pi / rays)
        return np.mean(np.isfinite(self.cast(points[:, :1], points[:, 1:2], bearings, reach)), axis=1)

    def clearances(self, points: np.ndarray, reach: float) -> np.ndarray:
        """Distance (n,) of each point (n, 2) from the nearest wall, inf beyond `reach`."""
        ffi, lib, _ = native()
        points = np.ascontiguousarray(points, dtype=float)
        out = np.empty(len(points))
        double = "double *"
        lib.caster_clearances(
            self.caster, ffi.cast(double, points.ctypes.data), len(points), reach, ffi.cast(double, out.ctypes.data)
        )
        return out


def load_world(source: str | Path) -> World:
    """World from a file or by a built-in name ("demo", "maze:medium:3", "polygon:3"). Raises WorldError."""
    if str(source).startswith("polygon:"):
        from firmware.virtual.polygons import polygon_named

        return polygon_named(str(source))
    if str(source).startswith("maze:"):
        from firmware.virtual.mazes import maze_named

        return maze_named(str(source))
    path = resolve(source, BUILT_IN, "world", WorldError)
    from firmware.virtual.world_maps import load_carmen, load_ros

    readers = {".toml": load_toml, ".map": load_carmen, ".yaml": load_ros, ".yml": load_ros}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise WorldError(
            f"{path}: no world ends in {path.suffix!r}; use .toml, .map (CARMEN) or .yaml (ROS map_server)"
        )
    return reader(path)


def resolve(source: str | Path, folder: Path, kind: str, error: type[ValueError]) -> Path:
    """Path of a file, or of a built-in one by its bare name; raises `error` with the built-in names."""
    path = Path(source)
    if path.is_file():
        return path
    built_in = folder / f"{source}.toml"
    if path.name == str(source) and built_in.is_file():
        return built_in
    names = ", ".join(sorted(entry.stem for entry in folder.glob("*.toml")))
    if path.is_dir():
        raise error(f"{path}: is a directory; name a {kind} file in it, or a built-in {kind}: {names}")
    raise error(f"{path}: no such file, and no built-in {kind} of that name; built-in: {names}")


def read_toml(path: Path, keys: set[str], error: type[ValueError]) -> dict[str, Any]:
    """Table of a TOML file whose keys must all be known; raises `error`."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise error(f"{path}: not TOML: {problem}; correct it there") from None
    for key in table:
        if key not in keys:
            raise error(f"{path}: {key}: unknown key; known are {', '.join(sorted(keys))}")
    return table


def numbers(value: Any, count: int | None, place: str, error: type[ValueError]) -> list[float]:
    """A list of finite numbers, of exactly `count` if given; raises `error` with the place."""
    ok = isinstance(value, list) and all(
        isinstance(item, int | float) and not isinstance(item, bool) and math.isfinite(item) for item in value
    )
    if not ok or (count is not None and len(value) != count):
        raise error(f"{place}: needs a list of {count if count is not None else 'some'} numbers, found {value!r}")
    return [float(item) for item in value]


def load_toml(path: Path) -> World:
    """World of a TOML file: `walls` are polylines, `rectangles` corners x1, y1, x2, y2, `segments` single walls."""
    table = read_toml(path, TOML_KEYS, WorldError)
    segments = [
        numbers(item, 4, f"{path}: segments[{i}]", WorldError) for i, item in enumerate(table.get("segments", []))
    ]
    for i, wall in enumerate(table.get("walls", [])):
        place = f"{path}: walls[{i}]"
        if not isinstance(wall, list) or len(wall) < 2:
            raise WorldError(f"{place}: needs at least two points [x, y], found {wall!r}")
        points = [numbers(point, 2, f"{place}[{k}]", WorldError) for k, point in enumerate(wall)]
        segments += [[*a, *b] for a, b in itertools.pairwise(points)]
    for i, item in enumerate(table.get("rectangles", [])):
        x1, y1, x2, y2 = numbers(item, 4, f"{path}: rectangles[{i}]", WorldError)
        segments += [[x1, y1, x2, y1], [x2, y1, x2, y2], [x2, y2, x1, y2], [x1, y2, x1, y1]]
    if not segments:
        raise WorldError(f"{path}: no walls; give walls, rectangles or segments")
    x, y, degrees = numbers(table.get("start", [0.0, 0.0, 0.0]), 3, f"{path}: start", WorldError)
    return World(np.array(segments), (x, y, math.radians(degrees)), str(table.get("name", path.stem)))
