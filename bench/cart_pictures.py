"""The pictures of Bumper Cart's benchmarks: who is localized, what it costs to be wrong, and the paper's lessons."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from bench.benchmark import Record
from bench.bump_localization import NUMBERS, RULES, SENSITIVE
from bench.bump_mapping import CARTS, CASES, DRAWN, GOOD
from bench.cart_lessons import MANNERS, METRE, USUAL, WIDTHS
from bench.claims.plots import WAYS, panel, picture
from bench.result import Result
from firmware.virtual.polygons import polygon

TRACKS = 12  # carts whose ways are drawn
SEEN = 1.1  # m to each side of a room's middle that are drawn


def percent(records: list[Record], key: str) -> float:
    """Of how many of the runs it holds."""
    return 100.0 * float(np.mean([record[key] for record in records]))


def plain_logarithm(axes: Axes, values: tuple[float, ...]) -> None:
    """A logarithmic axis below that tells these values, and no others, as they are."""
    axes.set(xscale="log", xticks=values, xticklabels=[f"{value:g}" for value in values])
    axes.xaxis.set_minor_locator(NullLocator())


def bumps(result: Result) -> Figure:
    """Carts that are localized rightly and wrongly, and bumps until then, against the number of particles."""
    figure = picture(3)
    rows = {row.name: row.records for row in result.rows}
    for column, (title, key) in enumerate(
        (("localized, and right (%)", "is_right"), ("localized, but wrong (%)", "is_wrong"), ("bumps until then", ""))
    ):
        axes = panel(figure, 0, column, title)
        for (colour, way), rule in zip(WAYS, RULES, strict=False):
            found = {number: rows.get(f"{rule}, {number} particles", []) for number in NUMBERS}
            seen = {number: records for number, records in found.items() if records}
            if key:
                axes.plot(
                    list(seen), [percent(records, key) for records in seen.values()], way, color=colour, label=rule
                )
                continue
            hits = {
                number: [record["hits"] for record in records if record["hits"] is not None]
                for number, records in seen.items()
            }
            for quantile, width in ((0.5, 1.6), (0.9, 0.7)):
                label = f"{rule}, {'median' if quantile == 0.5 else 'nine of ten'}"
                values = [float(np.quantile(each, quantile)) if each else np.nan for each in hits.values()]
                axes.plot(list(hits), values, way, color=colour, linewidth=width, label=label)
        plain_logarithm(axes, NUMBERS)
        axes.set_xlabel("particles")
        axes.set_ylim(bottom=0.0)
        axes.legend()
    return figure


def bump_sensitivity(result: Result) -> Figure:
    """Carts that are localized rightly against how wrong one parameter is that the filter is told of, by parameter."""
    figure = picture(3, 2)
    rows = {row.name: row.records for row in result.rows}
    for place, (name, factors) in enumerate(SENSITIVE.items()):
        axes = panel(figure, *divmod(place, 3), name.replace("_", " "))
        for (colour, way), rule in zip(WAYS, RULES, strict=False):
            found = {factor: rows.get(f"{rule}, {name} times {factor:g}", []) for factor in factors}
            found = dict(sorted({1.0: rows.get(rule, []), **found}.items()))
            seen = {factor: percent(records, "is_right") for factor, records in found.items() if records}
            axes.plot(list(seen), list(seen.values()), way, color=colour, label=rule)
        plain_logarithm(axes, tuple(sorted((1.0, *factors))))
        axes.set_ylim(0.0, 100.0)
    for axes in figure.axes[3:]:
        axes.set_xlabel("told, as a multiple of the usual")
    for axes in figure.axes[::3]:
        axes.set_ylabel("localized, and right (%)")
    figure.axes[0].legend()
    return figure


def bump_lessons(result: Result) -> Figure:
    """Ways of a metre as the wheels are driven, how far off their ends are told, and maps by the bumper's width."""
    figure = picture(3)
    rows = {row.name: row.records for row in result.rows}
    tracks, ends, widths = (
        panel(figure, 0, column, title)
        for column, title in enumerate(
            ("ways of a metre, to the side (cm)", "the metre's end off, as counted (cm)", "map off, by the bumper (m)")
        )
    )
    for place, ((colour, _), manner) in enumerate(zip(WAYS, MANNERS, strict=False)):
        records = rows.get(manner, [])
        for record in records[:TRACKS]:
            track = np.array(record["track"])
            label = manner if record is records[0] else None
            tracks.plot(track[:, 0], 100.0 * track[:, 1], color=colour, linewidth=0.8, label=label)
        values = [METRE * record["place"] for record in records]  # per cent of a metre are centimetres
        ends.plot(np.linspace(place - 0.25, place + 0.25, len(values)), sorted(values), ".", color=colour)
        if values:
            ends.plot([place - 0.3, place + 0.3], [np.median(values)] * 2, color="black")
    tracks.set_xlabel("ahead (m)")
    tracks.legend()
    ends.set(xticks=range(len(MANNERS)), xticklabels=[manner.replace(" ", "\n") for manner in MANNERS])
    ends.set_ylim(bottom=0.0)
    built = {USUAL: rows.get(next(iter(MANNERS)), []), **{w: rows.get(f"bumper {1e3 * w:.0f} mm", []) for w in WIDTHS}}
    errors = {width: [record["error"] for record in built[width]] for width in sorted(built) if built[width]}
    for width, values in errors.items():
        widths.plot([1e3 * width] * len(values), values, ".", color=WAYS[0][0], markersize=2.5)
    widths.plot([1e3 * width for width in errors], [np.median(each) for each in errors.values()], color=WAYS[0][0])
    widths.axhline(GOOD, color="#999999", linewidth=1.0)
    widths.set(yscale="log", xlabel="bumper's width (mm)")
    widths.yaxis.set_major_formatter("{x:g}")
    return figure


def bump_mapping(result: Result) -> Figure:
    """Errors of maps of unknown rooms beside dead reckoning's, and the best, the middle and the worst of them."""
    figure = picture(4)
    rows = {row.name: row.records for row in result.rows}
    usual = {int(name.split()[0]): rows[name] for name in CASES if name in rows and name.endswith("bumps")}
    axes = panel(figure, 0, 0, "walls off (m)")
    for (colour, _), (label, key) in zip(
        WAYS, (("refined map", "error"), ("dead reckoning", "raw_error")), strict=False
    ):
        medians = [np.median([record[key] for record in records]) for records in usual.values()]
        axes.plot(list(usual), medians, color=colour, label=label)
        for number, records in usual.items():
            axes.plot([number] * len(records), [record[key] for record in records], ".", color=colour, markersize=2.5)
    axes.axhline(GOOD, color="#999999", linewidth=1.0)
    axes.set(yscale="log", xlabel="bumps")
    plain_logarithm(axes, tuple(usual))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.legend()
    ranked = sorted(rows.get(DRAWN, []), key=lambda record: record["error"])
    drawn = [("best", 0), ("middle", len(ranked) // 2), ("worst", len(ranked) - 1)] if ranked else []
    for column, (name, row) in enumerate(drawn, 1):
        axes = panel(figure, 0, column)
        draw_room(axes, ranked[row], f"{name} of {len(ranked)}: {100.0 * ranked[row]['error']:.1f} cm")
    if drawn:
        figure.legend(*figure.axes[1].get_legend_handles_labels(), loc="outside lower right", ncols=3, frameon=False)
    return figure


def draw_room(axes: Axes, record: Record, title: str) -> None:
    """A room's true walls, those mapped, and where dead reckoning felt them."""
    for place, (x1, y1, x2, y2) in enumerate(polygon(record["room"]).segments):
        axes.plot([x1, x2], [y1, y2], color="#bbbbbb", linewidth=3.0, label=None if place else "walls")
    x, y = np.array(record["contacts"]).T
    axes.plot(x, y, ".", color=WAYS[1][0], markersize=2.0, label="bumps, dead reckoning")
    for place, wall in enumerate(record["walls"]):
        x, y = np.array(wall).T
        axes.plot(x, y, color=WAYS[0][0], linewidth=1.2, label=None if place else "mapped")
    x, y = polygon(record["room"]).segments.reshape(-1, 2).T
    middle_x, middle_y = 0.5 * (x.min() + x.max()), 0.5 * (y.min() + y.max())
    around = {"xlim": (middle_x - SEEN, middle_x + SEEN), "ylim": (middle_y - SEEN, middle_y + SEEN)}
    axes.set(title=title, aspect="equal", xticks=[], yticks=[], **around)
    axes.spines[:].set_visible(False)


def bump_merging(result: Result) -> Figure:
    """A merged map's error, and the merge's time, against the number of carts."""
    figure = picture(2)
    rows = {int(row.name.split()[0]): row.records for row in result.rows}
    numbers = [number for number in CARTS if number in rows]
    errors, times = panel(figure, 0, 0, "walls off (mm)"), panel(figure, 0, 1, "merged in (s)")
    for axes, key, factor in ((errors, "error", 1e3), (errors, "alone", 1e3), (times, "seconds", 1.0)):
        colour = WAYS[1 if key == "alone" else 0][0]
        label = {"error": "merged map", "alone": "one cart's own map"}.get(key)
        found = {number: factor * np.array([record[key] for record in rows[number]]) for number in numbers}
        axes.plot(numbers, [np.median(each) for each in found.values()], color=colour, label=label)
        for number, values in found.items():
            axes.plot([number] * len(values), values, ".", color=colour)
        axes.set(yscale="log", xlabel="carts")
        plain_logarithm(axes, tuple(numbers))
        axes.yaxis.set_major_formatter("{x:g}")
    errors.legend()
    return figure
