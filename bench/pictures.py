"""The README's pictures of benchmarks, drawn from the results that `crunch bench` kept.

python -m bench.pictures [NAME...] [--results build/bench] [--out docs/images]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from bench.beams import BEAMS, PUBLISHED
from bench.calibration import DRIVES, VIEWS
from bench.cart_pictures import bump_lessons, bump_mapping, bump_merging, bump_sensitivity, bumps
from bench.claims.plots import STYLE, WAYS, panel, picture
from bench.laser_pictures import basin, laser_memory, maze_turns
from bench.recordings import CACHE, ROOT
from bench.result import Result, Results
from server.formats.carmen import FLASER_MAX_RANGE

NAMES = {"intel": "semi-real Intel", "aces": "semi-real ACES"}
LIVE = 1.7  # s between vertices at 0.3 m/s


def calibration(result: Result) -> Figure:
    """How often the truth lies within regions that should hold so much: refined paths and, thin, the particles."""
    figure = picture(len(VIEWS))
    rows = {row.name: row.records for row in result.rows}
    for column, view in enumerate(VIEWS):
        axes = panel(figure, 0, column, view)
        axes.plot([0, 100], [0, 100], color="#999999", linewidth=1.0)
        for (colour, _), drive in zip(WAYS, DRIVES, strict=False):
            for claim, width in (("refinement", 1.8), ("particles", 0.8)):
                records = rows.get(f"{drive}, {claim}, {view}")
                if records:
                    held = 100.0 * np.cumsum(np.mean([record["probabilities"] for record in records], axis=0))
                    label = NAMES.get(drive, f"{drive} drift") if claim == "refinement" else None
                    axes.plot(
                        np.linspace(0.0, 100.0, len(held) + 1), [0.0, *held], color=colour, linewidth=width, label=label
                    )
        axes.set(xlabel="should hold (%)", xlim=(0, 100), ylim=(0, 100))
    figure.axes[0].set_ylabel("holds the truth (%)")
    figure.axes[-1].legend(loc="upper left")
    return figure


def scale(result: Result) -> Figure:
    """Accuracy, time and memory against the number of particles, every run a dot."""
    figure = picture(3)
    rows = [row for row in result.rows if row.name.isdigit()]  # the default's
    particles = [int(row.name) for row in rows]
    closed = [100.0 * np.mean([record["closed"] for record in row.records]) for row in rows]
    panels = (
        (f"ATE (m); {min(closed):.0f} to {max(closed):.0f} % closed", {"ate": "median"}, 1.0),
        ("time per vertex (s)", {"worst_ms": "worst", "vertex_ms": "median"}, 1e-3),
        ("peak memory (GB)", {"peak_mb": "median"}, 1e-3),
    )
    for column, (title, keys, factor) in enumerate(panels):
        axes = panel(figure, 0, column, title)
        for (colour, way), (key, label) in zip(WAYS, keys.items(), strict=False):
            values = [[factor * record[key] for record in row.records] for row in rows]
            axes.plot(particles, [float(np.median(runs)) for runs in values], way, color=colour, label=label)
            for n, runs in zip(particles, values, strict=True):
                axes.plot([n] * len(runs), runs, ".", color=colour, markersize=2.0)
        axes.set(xscale="log", xlabel="particles")
        if column:
            axes.set_yscale("log")
    figure.axes[1].axhline(LIVE, color="#999999", linewidth=1.0, label="the robot's")
    figure.axes[1].legend()
    figure.axes[0].set_ylim(bottom=0.0)
    return figure


def beams(result: Result) -> Figure:
    """Error of Intel's relations against the number of far-seeing beams, every run a dot, beside those of others."""
    figure = picture(2)
    full = [row.records for row in result.rows if row.records[0]["reach"] == FLASER_MAX_RANGE]
    rows = [records for records in full if "mean" in records[0]]
    counts = [records[0]["beams"] for records in rows]
    ways = {"": "Crunch", "thesis_": "the thesis's filter", "odometry_": "odometry"}
    for column, (title, key) in enumerate((("mean error (m)", "mean"), ("mean turn error (degrees)", "degrees"))):
        axes = panel(figure, 0, column, title)
        for (colour, way), (prefix, label) in zip(WAYS, ways.items(), strict=False):
            values = [[record[prefix + key] for record in records] for records in rows]
            axes.plot(counts, [float(np.median(runs)) for runs in values], way, color=colour, label=label)
            for n, runs in zip(counts, values, strict=True):
                axes.plot([n] * len(runs), runs, ".", color=colour, markersize=2.0)
        for (colour, way), (name, published) in zip(WAYS[3:], PUBLISHED.items(), strict=False):
            axes.plot(published.beams, getattr(published, key), way[0], color=colour, label=f"{name}, published")
        axes.set(xscale="log", yscale="log", xlabel="beams", xticks=BEAMS, xticklabels=BEAMS)
        axes.minorticks_off()
        axes.yaxis.set_major_formatter("{x:g}")
    figure.axes[1].legend(loc="center right")
    return figure


PICTURES: dict[str, Callable[[Result], Figure]] = {
    "basin": basin,
    "beams": beams,
    "bump-lessons": bump_lessons,
    "bump-mapping": bump_mapping,
    "bump-merging": bump_merging,
    "bump-sensitivity": bump_sensitivity,
    "bumps": bumps,
    "calibration": calibration,
    "laser-memory": laser_memory,
    "maze-turns": maze_turns,
    "scale": scale,
}
FILES = {
    "bump-lessons": "bumper-cart-lessons",
    "bump-mapping": "bumper-cart-unknown",
    "bump-merging": "bumper-cart-carts",
    "bump-sensitivity": "bumper-cart-sensitivity",
    "bumps": "bumper-cart-localized",
    "maze-turns": "turn-rate",
}  # those that are not called as the benchmark is


def main() -> None:
    """Draw those that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*PICTURES, []], default=list(PICTURES), metavar="NAME")
    parser.add_argument("--results", type=Path, default=CACHE)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images")
    wanted = parser.parse_args()
    wanted.out.mkdir(parents=True, exist_ok=True)
    for name in wanted.names:
        result = Results.read(wanted.results / f"{name}.json").results[name]
        with matplotlib.rc_context(STYLE):
            path = wanted.out / f"{FILES.get(name, name)}.png"
            PICTURES[name](result).savefig(path, metadata={"Software": None})
        print(path)


if __name__ == "__main__":
    main()
