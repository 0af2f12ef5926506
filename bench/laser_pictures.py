"""The pictures of the benchmarks of lasers: basins of alignment, maps after fast turns, memory as particles grow."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from bench.claims.plots import WAYS, panel, picture
from bench.maze_turns import MAZES, RATES
from bench.maze_turns import WAYS as TURNING
from bench.result import Result


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
        axes.legend(loc="upper left")
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
    for line, (key, title) in enumerate((("worst", "worst piece of wall off (m)"), ("median", "walls off (m)"))):
        for column, size in enumerate(MAZES):
            axes = panel(figure, line, column, f"{size} mazes: {title}")
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
                axes.set_yscale("log")
            told(axes)
            axes.yaxis.set_minor_formatter("{x:g}")
    for axes in figure.axes[len(MAZES) :]:
        axes.set_xlabel("turn rate wanted (rad/s)")
    figure.axes[0].legend(loc="upper left")
    return figure
