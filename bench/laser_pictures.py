"""The pictures of the benchmarks of lasers: basins of alignment, maps after fast turns, memory as particles grow."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from bench.basin import DEGREES, METHODS, METRES, WORLDS, held_of
from bench.basin import MAZES as IN_MAZES
from bench.claims.plots import WAYS, panel, picture
from bench.maze import NEAR
from bench.maze_turns import MAZES, RATES
from bench.maze_turns import WAYS as TURNING
from bench.result import Result

LOGS = [world for world in WORLDS if world != IN_MAZES]
BRIGHT = 60.0  # per cent from which on a cell's number is dark
OFF = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)  # m, on the axis of walls that are off


def basin(result: Result) -> Figure:
    """The share of pairs that each way aligns, over how far and how turned its guess was; mazes above real logs."""
    figure = picture(len(METHODS), 2)
    parts = {row.name: row.records for row in result.rows}
    for line, (title, worlds) in enumerate({"mazes": [IN_MAZES], "real logs": LOGS}.items()):
        for column, method in enumerate(METHODS):
            axes = panel(figure, line, column, f"{title}: {method}")
            axes.grid(visible=False)
            axes.set(xticks=range(len(METRES)), xticklabels=[f"{metres:g}" for metres in METRES])
            axes.set(yticks=range(len(DEGREES)), yticklabels=[f"{degrees:g}" for degrees in DEGREES])
            records = [each for world in worlds for each in parts.get(f"{world}, {method}", [])]
            if not records:
                continue
            shares = 100.0 * held_of(records)
            axes.imshow(shares, cmap="viridis", vmin=0.0, vmax=100.0, origin="lower", aspect="auto")
            for (row, place), percent in np.ndenumerate(shares):
                colour = "white" if percent < BRIGHT else "black"
                axes.text(place, row, f"{percent:.0f}", color=colour, fontsize=6.5, ha="center", va="center")
    for axes in figure.axes[len(METHODS) :]:
        axes.set_xlabel("guess off (m)")
    for axes in figure.axes[:: len(METHODS)]:
        axes.set_ylabel("turned (degrees)")
    return figure


def laser_memory(result: Result) -> Figure:
    """What maps take against the number of particles, beside a growth in proportion; and the time of a vertex."""
    figure = picture(2)
    panels = (
        ("memory (MB)", {"megabytes": "shared patches", "apart": "maps of their own", "peak_mb": "the whole process"}),
        ("a vertex (ms)", {"vertex_ms": "median", "worst_ms": "slowest"}),
    )
    particles = [row.records[0]["particles"] for row in result.rows]
    for column, (title, keys) in enumerate(panels):
        axes = panel(figure, 0, column, title)
        for (colour, way), (key, label) in zip(WAYS, keys.items(), strict=False):
            axes.plot(particles, medians(result, key), way, color=colour, label=label)
        least = medians(result, next(iter(keys)))[0]
        grown = [least * n / particles[0] for n in particles]
        axes.plot(particles, grown, ":", color="#999999", label="in proportion")
        axes.set(xscale="log", yscale="log", xlabel="particles", xticks=particles, xticklabels=particles)
        told(axes)
        axes.legend()
    return figure


def medians(result: Result, key: str) -> list[float]:
    """The median of each row's runs."""
    return [float(np.median([record[key] for record in row.records])) for row in result.rows]


def told(axes: Axes) -> None:
    """Label axes of logarithms with plain numbers."""
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")


def maze_turns(result: Result) -> Figure:
    """How far walls are off against the rate that was wanted, in mazes of each size, every maze a dot."""
    figure = picture(len(MAZES), 2)
    rows = {row.name: row.records for row in result.rows}
    for line, (key, title) in enumerate(
        (("worst", "worst piece of wall off (m)"), ("median", "walls off, median (m)"))
    ):
        for column, size in enumerate(MAZES):
            axes = panel(figure, line, column, f"{size}: {title}")
            axes.set(xscale="log", xticks=RATES, xticklabels=[f"{rate:g}" for rate in RATES], xlim=(0.25, 4.8))
            for (colour, mark), way in zip(WAYS, TURNING, strict=False):
                found = {rate: rows.get(f"{size}, {rate:g} rad/s, {way}", []) for rate in RATES}
                values = {rate: [run[key] for run in runs if run[key] is not None] for rate, runs in found.items()}
                seen = {rate: each for rate, each in values.items() if each}
                if not seen:
                    continue
                axes.plot(list(seen), [float(np.median(each)) for each in seen.values()], mark, color=colour, label=way)
                for rate, each in seen.items():
                    axes.plot([rate] * len(each), each, ".", color=colour, markersize=2.0)
            told(axes)
    for axes in figure.axes[: len(MAZES)]:
        axes.axhline(NEAR, color="#999999", linewidth=1.0, label="right up to here")
        axes.set(yscale="log", yticks=OFF, yticklabels=OFF)
        axes.yaxis.set_minor_locator(NullLocator())
        axes.set_ylim(bottom=OFF[0])
    for axes in figure.axes[len(MAZES) :]:
        axes.set_xlabel("turn rate wanted (rad/s)")
        axes.set_ylim(bottom=0.0)
    figure.axes[0].legend(loc="upper left")
    return figure
