"""Maps to be looked at: walls dark, the path blue where it is settled and orange where particles still differ.

Draws what its sibling `maps` makes.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from server.formats.ros_map import UNKNOWN
from server.maps import FloorMap
from server.messages import Label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER, INK, MUTED = "#fbfbf9", "#1f2733", "#6b7480"
FREE_TINT, WALL_TINT = "#e9eff4", "#26303d"
SETTLED_TINT, OPEN_TINT = "#2f6fde", "#e4792a"
START_TINT, END_TINT = "#2f9e5b", "#c8343f"
NEUTRAL_TINT = "#6f8094"  # on light and on dark paper alike
SEEN_ALPHA = 48  # of 255
SUPERSAMPLED = 2


def draw_png(floor: FloorMap, title: str, subtitle: str = "") -> bytes:
    """The map as a picture: walls dark, the path blue where it is settled and orange where particles still differ."""
    low, high = picture_bounds(floor)
    figure, axes = framed(low, high, title, subtitle)
    draw_floor(axes, floor)
    draw_path(axes, floor)
    draw_labels(axes, floor.labels)
    draw_scale_bar(axes, low, high)
    draw_legend(axes, floor)
    return rendered(figure)


def draw_pair(first: FloorMap, second: FloorMap, names: tuple[str, str], subtitle: str) -> bytes:
    """Two maps of one frame: walls of the first blue, those of the second orange, so that both show where they meet."""
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    bounds = [picture_bounds(floor) for floor in (first, second)]
    low, high = np.minimum(bounds[0][0], bounds[1][0]), np.maximum(bounds[0][1], bounds[1][1])
    figure, axes = framed(low, high, f"{names[0]} and {names[1]}", subtitle)
    for floor, tint, width in ((first, SETTLED_TINT, 3.2), (second, OPEN_TINT, 1.3)):
        axes.add_collection(LineCollection(floor.walls, colors=tint, linewidths=width, alpha=0.65), autolim=False)
    draw_scale_bar(axes, low, high)
    marks = [Line2D([], [], color=SETTLED_TINT, lw=3.2), Line2D([], [], color=OPEN_TINT, lw=1.3)]
    look = {"loc": "lower right", "facecolor": PAPER, "edgecolor": "none", "labelcolor": INK, "fontsize": 8.5}
    legend = axes.legend(marks, names, **look)
    for text in legend.get_texts():
        text.set_parse_math(False)
    return rendered(figure)


def framed(low: np.ndarray, high: np.ndarray, title: str, subtitle: str) -> tuple[Figure, Axes]:
    """A page that shows the world from `low` (2,) to `high` (2,) below a title."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

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
    words = {"va": "top", "parse_math": False}  # names are no formulas
    figure.text(0.17 / size[0], 1.0 - 0.16 / size[1], title, color=INK, size=13, weight="bold", **words)
    figure.text(0.17 / size[0], 1.0 - 0.42 / size[1], subtitle, color=MUTED, size=9.5, **words)
    return figure, axes


def rendered(figure: Figure) -> bytes:
    """A page as PNG; the same page gives the same bytes."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", facecolor=PAPER, metadata={"Software": None})
    return picture.getvalue()


def draw_thumbnail(floor: FloorMap, width: int = 480, height: int = 320) -> bytes:
    """A small picture without words, which is clear on light and on dark paper; made at once, even while driving."""
    from PIL import Image, ImageDraw

    low, high = picture_bounds(floor)
    metres = float(max((high - low) / (width, height))) / SUPERSAMPLED  # per pixel
    size = (SUPERSAMPLED * width, SUPERSAMPLED * height)
    corner = 0.5 * (low + high) + 0.5 * metres * np.array([-size[0], size[1]])  # the upper left one
    picture = Image.new("RGBA", size)
    if floor.grid is not None:
        seen = np.where(floor.grid.cells[::-1] == UNKNOWN, 0, SEEN_ALPHA).astype(np.uint8)
        cell = floor.grid.resolution / metres
        x, y = (np.array(floor.grid.origin[:2]) + [0.0, floor.grid.resolution * len(seen)] - corner) / (metres, -metres)
        shown = (max(1, round(seen.shape[1] * cell)), max(1, round(seen.shape[0] * cell)))
        picture.paste(NEUTRAL_TINT, (round(x), round(y)), Image.fromarray(seen).resize(shown))
    pen = ImageDraw.Draw(picture)
    for line, tint, thickness in [*((wall, NEUTRAL_TINT, 4) for wall in floor.walls), (floor.path, SETTLED_TINT, 4)]:
        pen.line([(x, y) for x, y in (line[:, :2] - corner) / (metres, -metres)], fill=tint, width=thickness)
    content = io.BytesIO()
    picture.resize((width, height), Image.Resampling.LANCZOS).save(content, "PNG")
    return content.getvalue()


def wall_box(floor: FloorMap) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner (2,) of path and walls."""
    points = np.concatenate([np.zeros((1, 2)) if not len(floor.path) else floor.path[:, :2], *floor.walls])
    return points.min(axis=0), points.max(axis=0)


def picture_bounds(floor: FloorMap) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner (2,) of everything drawn, with a margin."""
    low, high = wall_box(floor)
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
        tint = ListedColormap([FREE_TINT])
        axes.imshow(seen, origin="lower", extent=box, cmap=tint, interpolation="nearest", zorder=0)
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


def draw_labels(axes: Axes, labels: Sequence[Label]) -> None:
    """A dot at each named place, and its name above it."""
    for label in labels:
        axes.plot(label.x, label.y, "o", color=INK, ms=4, zorder=7)
        place = {"xy": (label.x, label.y), "xytext": (0, 5), "textcoords": "offset points", "zorder": 8}
        box = {"boxstyle": "round,pad=0.25", "facecolor": PAPER, "edgecolor": "none", "alpha": 0.8}
        style = {"ha": "center", "va": "bottom", "color": INK, "size": 9, "weight": "bold", "parse_math": False}
        axes.annotate(label.text, **place, **style, bbox=box)


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
