"""Maps as ROS's map_server loads them: a PGM picture (first row is the highest y) and a YAML file beside it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from server.formats.atomic import write_atomically
from server.formats.errors import FormatError, read_bytes, read_lines

FREE, OCCUPIED, UNKNOWN = 0, 100, -1  # the values of nav_msgs/OccupancyGrid
FREE_THRESHOLD, OCCUPIED_THRESHOLD = 0.196, 0.65
GRAY = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}
MODES = ("trinary", "scale", "raw")


class OccupancyMap(NamedTuple):
    """`cells` (rows, columns) int8, row 0 at the lowest y, 0 free, 100 occupied, -1 unknown; `origin` (x, y, yaw)."""

    cells: np.ndarray
    resolution: float
    origin: tuple[float, float, float]


def format_pgm(cells: np.ndarray) -> bytes:
    """The binary PGM of trinary cells."""
    gray = np.full(cells.shape, GRAY[UNKNOWN], np.uint8)
    gray[cells == FREE] = GRAY[FREE]
    gray[cells == OCCUPIED] = GRAY[OCCUPIED]
    rows, columns = cells.shape
    return f"P5\n{columns} {rows}\n255\n".encode() + gray[::-1].tobytes()


def format_yaml(image: str, resolution: float, origin: tuple[float, float, float]) -> str:
    """The YAML beside the picture."""
    x, y, yaw = origin
    return (
        f"image: {image}\nmode: trinary\nresolution: {resolution:g}\norigin: [{x:.6f}, {y:.6f}, {yaw:.6f}]\n"
        f"negate: 0\noccupied_thresh: {OCCUPIED_THRESHOLD}\nfree_thresh: {FREE_THRESHOLD}\n"
    )


def write_ros_map(stem: Path | str, grid: OccupancyMap) -> None:
    """Write `stem`.pgm, then `stem`.yaml, which makes the map complete."""
    stem = Path(stem)
    write_atomically(stem.with_name(stem.name + ".pgm"), format_pgm(grid.cells))
    write_atomically(stem.with_name(stem.name + ".yaml"), format_yaml(stem.name + ".pgm", grid.resolution, grid.origin))


def read_ros_map(path: Path | str) -> OccupancyMap:
    """The map that a YAML file describes, reduced to free, occupied and unknown as map_server does it."""
    path = Path(path)
    keys = read_yaml(path)
    resolution = number(path, keys, "resolution")
    if not resolution > 0.0:
        raise FormatError(path, "resolution", f"{resolution:g} is not above zero", "give metres per cell")
    gray = read_pgm(path.parent / keys.get("image", path.stem + ".pgm"))
    darkness = gray / 255.0 if number(path, keys, "negate", 0.0) else (255 - gray.astype(float)) / 255.0
    cells = np.full(gray.shape, UNKNOWN, np.int8)
    cells[darkness < number(path, keys, "free_thresh", FREE_THRESHOLD)] = FREE
    cells[darkness > number(path, keys, "occupied_thresh", OCCUPIED_THRESHOLD)] = OCCUPIED
    return OccupancyMap(cells[::-1].copy(), resolution, read_origin(path, keys))


def read_yaml(path: Path) -> dict[str, str]:
    """The flat `key: value` pairs, which is all of YAML that map files use."""
    pairs: dict[str, str] = {}
    for row, line in enumerate(read_lines(path), 1):
        text = line.split("#")[0].strip()
        if not text or text == "---":
            continue
        key, colon, value = text.partition(":")
        if not colon:
            raise FormatError(path, row, f"`{text}` is no `key: value`", "see https://wiki.ros.org/map_server")
        pairs[key.strip()] = value.strip().strip("\"'")
    if pairs.get("mode", "trinary") not in MODES:
        raise FormatError(path, "mode", f"`{pairs['mode']}` is unknown", "use trinary, scale or raw")
    return pairs


def number(path: Path, keys: dict[str, str], key: str, default: float = math.nan) -> float:
    """A number among the keys; without a default it must be there."""
    if key not in keys and not math.isnan(default):
        return default
    try:
        return float(keys[key])
    except KeyError:
        raise FormatError(path, key, "is missing", "map_server needs image, resolution and origin") from None
    except ValueError:
        raise FormatError(path, key, f"`{keys[key]}` is not a number", "see https://wiki.ros.org/map_server") from None


def read_origin(path: Path, keys: dict[str, str]) -> tuple[float, float, float]:
    """`[x, y, yaw]`."""
    try:
        x, y, yaw = (float(part) for part in keys["origin"].strip("[]").split(","))
    except (KeyError, ValueError):
        raise FormatError(
            path, "origin", "is not `[x, y, yaw]`", "map_server needs image, resolution and origin"
        ) from None
    return x, y, yaw


def read_pgm(path: Path) -> np.ndarray:
    """The gray values (rows, columns) of a binary or plain 8-bit PGM, in the picture's order."""
    content = read_bytes(path)
    kind, columns, rows, largest, body = pgm_header(path, content)
    if not 0 < largest < 256:
        raise FormatError(path, None, f"has {largest} gray levels", "save it with 8 bits")
    try:
        gray = np.array(body.split(), np.uint8) if kind == b"P2" else np.frombuffer(body, np.uint8, rows * columns)
        return gray.reshape(rows, columns)
    except ValueError:
        raise FormatError(
            path, None, f"does not hold {columns} x {rows} pixels", "copy it again, it seems cut"
        ) from None


def pgm_header(path: Path, content: bytes) -> tuple[bytes, int, int, int, bytes]:
    """Kind, columns, rows, largest value, and the pixels' bytes; comments may stand between the numbers."""
    fields: list[bytes] = []
    at = 0
    while len(fields) < 4 and at < len(content):
        if content[at : at + 1] == b"#":
            at = content.find(b"\n", at) + 1 or len(content)
        elif content[at : at + 1].isspace():
            at += 1
        else:
            end = at
            while end < len(content) and not content[end : end + 1].isspace():
                end += 1
            fields.append(content[at:end])
            at = end
    if len(fields) < 4 or fields[0] not in (b"P2", b"P5") or not all(field.isdigit() for field in fields[1:]):
        raise FormatError(path, None, "is no PGM picture", "save it as PGM (P5)")
    columns, rows, largest = (int(field) for field in fields[1:])
    return fields[0], columns, rows, largest, content[at + 1 :]
