"""One look for all pictures: light, large enough to read, told apart by colour (Okabe and Ito's) and by marker."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.claims.findings import Findings

WAYS = (
    ("#0072B2", "o-"),
    ("#D55E00", "s--"),
    ("#009E73", "^-."),
    ("#CC79A7", "D:"),
    ("#000000", "x-"),
    ("#E69F00", "v--"),
)
STYLE: Any = {
    "font.size": 9.0, "axes.titlesize": 9.5, "axes.grid": True, "grid.color": "#e4e4e4", "axes.axisbelow": True,
    "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False, "legend.fontsize": 8.0,
    "lines.markersize": 4.0, "lines.linewidth": 1.4, "figure.facecolor": "white", "savefig.dpi": 110,
}  # fmt: skip

Draw = Callable[[Findings], Figure]


def picture(columns: int, rows: int = 1) -> Figure:
    """An empty picture of so many panels."""
    figure = Figure(figsize=(0.6 + 2.9 * columns, 0.5 + 2.5 * rows), layout="constrained")
    figure.subplots(rows, columns, squeeze=False)
    return figure


def panel(figure: Figure, row: int, column: int, title: str = "") -> Axes:
    """One of its panels."""
    grid = figure.axes[0].get_gridspec()
    assert grid is not None
    axes = figure.axes[row * grid.ncols + column]
    axes.set_title(title)
    return axes


def save(draw: Draw, findings: Findings, path: Path) -> None:
    """Draw and write as PNG."""
    with matplotlib.rc_context(STYLE):
        draw(findings).savefig(path, metadata={"Software": None})
