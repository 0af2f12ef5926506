"""Maps for people and programs: a picture, ROS's map_server files, JSON, a pose graph and the tree's profile.

Everything is made from the best path and the walls that its vertices saw; nothing here knows a robot or the filter.
"""

from __future__ import annotations

import io
import json
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from server.formats.g2o import Graph
from server.formats.ros_map import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from slam.pose import between, transform
from slam.walls import Walls, curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAP_FORMAT = "crunch-map-1"
RESOLUTION = 0.05  # m per cell, where the grid stays within MAX_CELLS
MAX_CELLS = 4000  # along either side of a grid; one jump of the odometry may stretch a map over kilometres
TRAIL_POINTS = 20_000  # of a drawn trajectory
MARGIN = 0.5  # m of unknown around what was seen
OCCUPIED_SHARE = (
    0.25  # of the vertices that looked at a cell and saw a wall in it; paths are never exact, walls are thin
)

PAPER, INK, MUTED = "#fbfbf9", "#1f2733", "#6b7480"
FREE_TINT, WALL_TINT = "#e9eff4", "#26303d"
SETTLED_TINT, OPEN_TINT = "#2f6fde", "#e4792a"
START_TINT, END_TINT = "#2f9e5b", "#c8343f"


class FloorMap(NamedTuple):
    """What is drawn and stored: `path` (n, 3), `walls` curves (k, 2) in the world, how many first vertices are settled.

    Where there is a `trail`, two arrays (k, 3) of poses, settled and open, it is drawn instead of the path's chords.
    """

    path: np.ndarray
    walls: list[np.ndarray]
    settled: int = 0
    grid: OccupancyMap | None = None
    trail: tuple[np.ndarray, np.ndarray] | None = None


def floor_map(path: np.ndarray, walls: list[Walls], fixed_depth: int = 0, resolution: float = RESOLUTION) -> FloorMap:
    """The map of a path (n, 3) and what its vertices saw."""
    return FloorMap(path, world_curves(path, walls), fixed_depth + 1, occupancy(path, walls, resolution))


def world_curves(path: np.ndarray, walls: list[Walls]) -> list[np.ndarray]:
    """Every vertex's wall curves, each (k, 2) with k > 1, in the world."""
    found = []
    for pose, seen in zip(path, walls, strict=True):
        found.extend(transform(pose, curve) for curve in curves(seen) if len(curve) > 1)
    return found


def occupancy(path: np.ndarray, walls: list[Walls], resolution: float = RESOLUTION) -> OccupancyMap:
    """Cells that vertices saw free, those that they saw walls in, and unknown ones; coarser where MAX_CELLS asks so."""
    resolution = affordable(path, walls, resolution)
    low, shape = extent(path, walls, resolution)
    free = np.zeros(shape, np.int32)
    occupied = np.zeros(shape, np.int32)
    for pose, seen in zip(path, walls, strict=True):
        count_free(free, low, resolution, pose, seen)
        count_walls(occupied, low, resolution, pose, seen)
    cells = np.full(shape, UNKNOWN, np.int8)
    cells[free > 0] = FREE
    cells[(occupied > 0) & (occupied >= OCCUPIED_SHARE * (free + occupied))] = OCCUPIED
    return OccupancyMap(cells, resolution, (float(low[0]), float(low[1]), 0.0))


def reach_of(seen: Walls) -> float:
    """How far a vertex saw anything."""
    finite = seen.distances[np.isfinite(seen.distances)]
    return float(max(finite.max(initial=0.0), seen.free.max(initial=0.0)))


def extent(path: np.ndarray, walls: list[Walls], resolution: float) -> tuple[np.ndarray, tuple[int, int]]:
    """Corner (2,), on a multiple of the resolution, and (rows, columns) of a grid that holds everything seen."""
    if not len(path):
        return np.zeros(2), (1, 1)
    low, high = seen_box(path, walls)
    low = np.floor(low / resolution) * resolution
    columns, rows = np.ceil((high - low) / resolution).astype(int)
    return low, (int(rows), int(columns))


def seen_box(path: np.ndarray, walls: list[Walls]) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner (2,) of everything seen, with the margin."""
    if not len(path):
        return np.zeros(2), np.zeros(2)
    reach = np.array([reach_of(seen) for seen in walls])[:, None] + MARGIN
    return (path[:, :2] - reach).min(axis=0), (path[:, :2] + reach).max(axis=0)


def affordable(path: np.ndarray, walls: list[Walls], resolution: float) -> float:
    """The resolution, doubled until a grid of everything seen stays within MAX_CELLS."""
    low, high = seen_box(path, walls)
    doublings = math.log2(max(float((high - low).max()) / ((MAX_CELLS - 1) * resolution), 1.0))
    return resolution * 2.0 ** math.ceil(doublings)


def count_free(free: np.ndarray, low: np.ndarray, resolution: float, pose: np.ndarray, seen: Walls) -> None:
    """Add one to the cells whose centres lie nearer than their ray was seen free."""
    centre = (pose[:2] - low) / resolution
    radius = int(seen.free.max(initial=0.0) / resolution) + 1
    first = np.maximum(centre.astype(int) - radius, 0)
    last = np.minimum(centre.astype(int) + radius + 1, free.shape[::-1])
    x = (np.arange(first[0], last[0]) + 0.5 - centre[0]) * resolution
    y = (np.arange(first[1], last[1]) + 0.5 - centre[1])[:, None] * resolution
    n_rays = seen.free.size
    rays = np.rint((np.arctan2(y, x) - pose[2]) * n_rays / (2.0 * math.pi)).astype(int) % n_rays
    bound = np.minimum(seen.free, seen.distances - 0.5 * resolution)
    free[first[1] : last[1], first[0] : last[0]] += np.hypot(x, y) < bound[rays]


def count_walls(occupied: np.ndarray, low: np.ndarray, resolution: float, pose: np.ndarray, seen: Walls) -> None:
    """Add one to the cells that a vertex's wall curves pass through."""
    points = [densify(transform(pose, curve), 0.5 * resolution) for curve in curves(seen)]
    if points:
        cells = np.unique(((np.concatenate(points) - low) / resolution).astype(int), axis=0)
        occupied[cells[:, 1], cells[:, 0]] += 1


def densify(curve: np.ndarray, step: float) -> np.ndarray:
    """Points (m, 2) along a curve (k, 2), no two neighbours farther apart than `step`."""
    if len(curve) < 2:
        return curve
    lengths = np.hypot(*np.diff(curve, axis=0).T)
    stations = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.linspace(0.0, stations[-1], int(stations[-1] / step) + 2)
    return np.column_stack([np.interp(at, stations, curve[:, 0]), np.interp(at, stations, curve[:, 1])])


def path_length(path: np.ndarray) -> float:
    """Metres along a path (n, 3)."""
    return float(np.hypot(*np.diff(path[:, :2], axis=0).T).sum()) if len(path) > 1 else 0.0


def draw_png(floor: FloorMap, title: str, subtitle: str = "") -> bytes:
    """The map as a picture: walls dark, the path blue where it is settled and orange where particles still differ."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    low, high = picture_bounds(floor)
    width, height = high - low
    inches = 11.0 / max(width, height)
    header = 0.62
    size = (max(width * inches, 4.5), max(height * inches, 3.0) + header)
    figure = Figure(figsize=size, dpi=150, facecolor=PAPER)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0 - header / size[1]))
    axes.set_axis_off()
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    draw_floor(axes, floor)
    draw_path(axes, floor)
    draw_scale_bar(axes, low, high)
    draw_legend(axes, floor)
    figure.text(0.17 / size[0], 1.0 - 0.16 / size[1], title, color=INK, size=13, weight="bold", va="top")
    figure.text(0.17 / size[0], 1.0 - 0.42 / size[1], subtitle, color=MUTED, size=9.5, va="top")
    picture = io.BytesIO()
    figure.savefig(picture, format="png", facecolor=PAPER, metadata={"Software": None})
    return picture.getvalue()


def picture_bounds(floor: FloorMap) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner (2,) of everything drawn, with a margin."""
    points = np.concatenate([np.zeros((1, 2)) if not len(floor.path) else floor.path[:, :2], *floor.walls])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.03 * float(max(high - low)) + 0.4
    return low - margin, high + margin


def draw_floor(axes: Axes, floor: FloorMap) -> None:
    """What was seen free as a light tint, the walls over it."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap

    if floor.grid is not None:
        rows, columns = floor.grid.cells.shape
        x, y, _ = floor.grid.origin
        box = (x, x + columns * floor.grid.resolution, y, y + rows * floor.grid.resolution)
        seen = np.ma.masked_where(floor.grid.cells == UNKNOWN, np.zeros((rows, columns)))
        axes.imshow(
            seen, origin="lower", extent=box, cmap=ListedColormap([FREE_TINT]), interpolation="nearest", zorder=0
        )
        axes.set_autoscale_on(False)
    lines = LineCollection(floor.walls, colors=WALL_TINT, linewidths=1.2, alpha=0.6, capstyle="round", zorder=2)
    axes.add_collection(lines, autolim=False)


def draw_path(axes: Axes, floor: FloorMap) -> None:
    """The path in two colours, a dot at its start and an arrow at its end."""
    if not len(floor.path):
        return
    joint = max(floor.settled - 1, 0)
    settled, still_open = floor.trail or (floor.path[: floor.settled], floor.path[joint:])
    axes.plot(settled[:, 0], settled[:, 1], color=SETTLED_TINT, lw=1.3, alpha=0.9, zorder=3)
    axes.plot(still_open[:, 0], still_open[:, 1], color=OPEN_TINT, lw=1.3, zorder=3)
    start, (x, y, theta) = floor.path[0], still_open[-1] if len(still_open) else settled[-1]
    axes.plot(*start[:2], "o", color=START_TINT, ms=8, mec="white", mew=1.2, zorder=5)
    axes.plot(x, y, marker=(3, 0, math.degrees(theta) - 90.0), color=END_TINT, ms=11, mec="white", mew=1.2, zorder=5)


def trail_of(trajectory: np.ndarray, rows: np.ndarray, settled: int) -> tuple[np.ndarray, np.ndarray]:
    """The settled and the open part of a trajectory (n, 3) whose vertices stand at `rows`, thinned for drawing."""
    joint = int(rows[min(settled, len(rows)) - 1]) if settled else 0
    step = max(1, len(trajectory) // TRAIL_POINTS)
    return trajectory[: joint + 1 : step], np.concatenate([trajectory[joint::step], trajectory[-1:]])


def draw_scale_bar(axes: Axes, low: np.ndarray, high: np.ndarray) -> None:
    """A bar of a round length, about a sixth of the picture, in the lower left corner."""
    width = float(high[0] - low[0])
    length = round_length(width / 6.0)
    x, y = float(low[0]) + 0.02 * width, float(low[1]) + 0.02 * width
    axes.plot([x, x + length], [y, y], color=INK, lw=3.0, solid_capstyle="butt", zorder=6)
    label = {"xy": (x + length / 2.0, y), "xytext": (0, 4), "textcoords": "offset points"}
    axes.annotate(f"{length:g} m", **label, ha="center", va="bottom", color=INK, size=9, zorder=6)


def round_length(length: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above `length`."""
    power = 10.0 ** math.floor(math.log10(length))
    return max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= length * 1.0001)


def draw_legend(axes: Axes, floor: FloorMap) -> None:
    """What the marks mean, in the corner with the least in it."""
    from matplotlib.lines import Line2D

    marks = [
        Line2D([], [], color=WALL_TINT, lw=1.6, label="wall"),
        Line2D([], [], color=SETTLED_TINT, lw=1.6, label="path, settled"),
        Line2D([], [], color=OPEN_TINT, lw=1.6, label="path, still open"),
        Line2D([], [], marker="o", color=START_TINT, lw=0, mec="white", ms=8, label="start"),
        Line2D([], [], marker=(3, 0, -90), color=END_TINT, lw=0, mec="white", ms=10, label="end"),
    ]
    if floor.settled >= len(floor.path):
        del marks[2]
    elif floor.settled <= 1:
        del marks[1]
    axes.legend(
        handles=marks, loc="lower right", ncols=len(marks), frameon=True, facecolor=PAPER, edgecolor="none",
        framealpha=0.85, fontsize=8.5, labelcolor=INK, handlelength=1.6, columnspacing=1.4, borderaxespad=0.8,
    )  # fmt: skip


def map_json(floor: FloorMap, robot: str) -> str:
    """The map for programs, as docs/outputs.md has it: metres to a millimetre, radians to a tenth of a milliradian."""
    path = [[round(float(x), 3), round(float(y), 3), round(float(theta), 4)] for x, y, theta in floor.path]
    walls = [np.round(curve, 3).tolist() for curve in floor.walls]
    content = {"format": MAP_FORMAT, "robot": robot, "frame": "world", "settled": min(floor.settled, len(path))}
    return json.dumps({**content, "path": path, "walls": walls}, separators=(",", ":")) + "\n"


def profile_csv(times: np.ndarray, path: np.ndarray, profile: np.ndarray, fixed_depth: int) -> str:
    """One row per vertex: time, the path's length so far, nodes of the tree at its depth per particle, settled."""
    steps = np.hypot(*np.diff(path[:, :2], axis=0, prepend=path[:1, :2]).T) if len(path) else np.zeros(0)
    rows = ["vertex,time,distance,nodes_per_particle,settled\n"]
    for vertex, (t, distance, nodes) in enumerate(zip(times, np.cumsum(steps), profile, strict=True)):
        rows.append(f"{vertex},{t:.6f},{distance:.3f},{nodes:.6f},{int(vertex <= fixed_depth)}\n")
    return "".join(rows)


def pose_graph(path: np.ndarray, odometry: np.ndarray, turn_noise: float, distance_noise: float) -> Graph:
    """The path's vertices, joined by the motions that odometry (n, 3) measured; its noise is per root metre."""
    motions = between(odometry[:-1], odometry[1:])
    lengths = np.maximum(np.hypot(motions[:, 0], motions[:, 1]), 0.1)
    information = np.zeros((len(motions), 6))
    information[:, 0] = information[:, 3] = 1.0 / (max(distance_noise, 1e-3) ** 2 * lengths)
    information[:, 5] = 1.0 / (max(turn_noise, 1e-3) ** 2 * lengths)
    rows = np.arange(len(motions))
    return Graph(path, np.column_stack([rows, rows + 1]), motions, information)
