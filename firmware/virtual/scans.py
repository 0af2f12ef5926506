"""A world drawn from somebody's laser scans at reference poses: what a semi-real recording is driven through."""

from __future__ import annotations

import numpy as np

from firmware.virtual.contours import trace_walls
from firmware.virtual.native import native
from firmware.virtual.worlds import World, WorldError

MIN_HITS = 2
WALL_SHARE = 0.25  # of the beams that reached a cell ended in it
MARGIN = 0.5  # m around everything seen


def count_beams(
    poses: np.ndarray, ranges: np.ndarray, bearings: np.ndarray, max_range: float, resolution: float
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Hits and visits (rows, columns) of all beams, and the corner of cell (0, 0)."""
    is_echo = np.isfinite(ranges) & (ranges > 0.0) & (ranges < max_range)
    angles = poses[:, 2:3] + bearings
    reach = np.where(is_echo, ranges, 0.0)
    ends_x, ends_y = poses[:, :1] + reach * np.cos(angles), poses[:, 1:2] + reach * np.sin(angles)
    x, y = ends_x.min() - MARGIN, ends_y.min() - MARGIN
    columns = int(np.ceil((ends_x.max() + MARGIN - x) / resolution))
    rows = int(np.ceil((ends_y.max() + MARGIN - y) / resolution))
    hits, visits = np.zeros((rows, columns), np.uint16), np.zeros((rows, columns), np.uint16)
    ffi, lib, _ = native()
    cells = [ffi.cast("uint16_t *", array.ctypes.data) for array in (hits, visits)]
    grid = ffi.new("struct scan_grid *", [x, y, resolution, columns, rows, *cells])
    at = [ffi.cast("double *", array.ctypes.data) for array in (poses, ranges, bearings)]
    for i in range(len(poses)):
        lib.scan_grid_add(grid, at[0] + 3 * i, at[1] + len(bearings) * i, at[2], len(bearings), max_range)
    return hits, visits, float(x), float(y)


def world_of_scans(
    poses: np.ndarray, ranges: np.ndarray, bearings: np.ndarray, max_range: float, resolution: float
) -> World:
    """World of poses (n, 3), ranges (n, b), bearings (b,): a wall is where a quarter of the beams that came ended.

    A quarter, because beams that graze a wall pass through many of its cells before they end. Raises WorldError.
    """
    poses, ranges, bearings = (np.ascontiguousarray(array, dtype=float) for array in (poses, ranges, bearings))
    if poses.ndim != 2 or poses.shape[1:] != (3,) or ranges.shape != (len(poses), len(bearings)) or not len(poses):
        raise WorldError(
            f"scans: poses {poses.shape}, ranges {ranges.shape} and bearings {bearings.shape} do not fit; "
            "need (n, 3), (n, b) and (b,)"
        )
    hits, visits, x, y = count_beams(poses, ranges, bearings, max_range, resolution)
    share = hits / np.maximum(visits, 1)
    walls = np.where(hits >= MIN_HITS, np.clip(share * 0.5 / WALL_SHARE, 0.0, 1.0), 0.0)
    segments = trace_walls(walls, resolution, x, y)
    if not len(segments):
        raise WorldError(f"scans: no walls in {len(poses)} scans below {max_range} m; check units and bearings")
    rows, columns = np.nonzero((visits > 0) & (walls < 0.25))
    free = (np.column_stack([columns, rows]) + 0.5) * resolution + np.array([x, y])
    return World(segments, poses[0], "scans", free, resolution)
