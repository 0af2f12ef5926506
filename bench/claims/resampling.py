"""Thesis 2.7: resampling costs diversity, so that it is done only when needed, by the entropy of the weights.

The thesis's reason, that even equally weighted particles are lost, is true of independent draws and not of systematic
ones; both are measured. 2^H stands beside the other usual measure, ESS = 1 / sum w^2. The two are the same where some
weights are equal and the others nothing; of log-normal weights the one is N exp(-s^2 / 2), the other N exp(-s^2), so
that ESS / N is the square of 2^H / N.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from bench.claims.drives import Outcome, jobs, outcome, summary
from bench.claims.findings import Effort, Findings, Row
from bench.claims.plots import WAYS, panel, picture
from slam.resampling import systematic

THRESHOLDS = (0.1, 0.25, 0.5, 0.75, 0.95, 1.0)
BACK = (10, 50, 100)  # vertices before the newest whose distinct ancestors are counted
STEPS = (1, 2, 5, 10, 20, 50, 100)
NEUTRAL = 2000  # particles of the drawing without evidence
SHOWN = 2000  # points of the picture of both measures


def neutral() -> list[Row]:
    """Share of the first particles that still have descendants after so many resamplings of equal weights."""
    rng = np.random.default_rng(0)
    schemes = {"independent": np.arange(NEUTRAL), "systematic": np.arange(NEUTRAL)}
    weights = np.full(NEUTRAL, 1.0 / NEUTRAL)
    rows: list[Row] = []
    for step in range(1, STEPS[-1] + 1):
        schemes["independent"] = schemes["independent"][np.sort(rng.integers(NEUTRAL, size=NEUTRAL))]
        schemes["systematic"] = schemes["systematic"][systematic(weights, float(rng.random()))]
        if step in STEPS:
            shares: Row = {f"{name} (%)": 100.0 * len(np.unique(left)) / NEUTRAL for name, left in schemes.items()}
            rows.append({"resamplings": step, **shares})
    return rows


def diversity(runs: list[Outcome], particles: int) -> Row:
    """Medians of resamplings, of ancestors alive at some depths, and of the settled share of the path."""
    row: Row = {"resamplings": float(np.median([one.resamplings for one in runs]))}
    for back in BACK:
        alive = [particles * one.profile[max(0, len(one.profile) - 1 - back)] for one in runs]
        row[f"ancestors {back} back"] = round(float(np.median(alive)))
    settled = [100.0 * one.fixed_depth / max(1, len(one.profile) - 1) for one in runs]
    return row | {"settled (%)": float(np.median(settled))}


def rows_of(effort: Effort, preset: str, ways: dict[str, dict[str, Any]]) -> list[Row]:
    """A row for each way to resample."""
    rows: list[Row] = []
    for name, way in ways.items():
        runs = [outcome(job) for job in jobs(effort.seeds, effort.length, effort.particles, preset, **way)]
        found = summary(runs)
        found.pop("s per drive")
        rows.append({"set-up": preset, "resampling": name, **found, **diversity(runs, effort.particles)})
    return rows


def at(threshold: float) -> dict[str, Any]:
    """The change of the threshold."""
    return {"filter": {"threshold": threshold}}


def always(effort: Effort) -> list[Row]:
    """At every vertex, by independent or systematic draws, and only when needed."""
    ways = {
        "always, independent": {"criterion": "always", "multinomial": True, "changes": at(1.0)},
        "always, systematic": {"criterion": "always", "changes": at(1.0)},
        "when needed, independent": {"multinomial": True},
        "when needed, systematic": {},
    }
    return [row for preset in ("default", "thesis") for row in rows_of(effort, preset, ways)]


def thresholds(effort: Effort) -> list[Row]:
    """Every threshold, by 2^H, and two by ESS."""
    ways: dict[str, dict[str, Any]] = {f"2^H < {t} N": {"changes": at(t)} for t in THRESHOLDS}
    ways |= {f"ESS < {t} N": {"criterion": "ess", "changes": at(t)} for t in (0.25, 0.5)}
    return [row for preset in ("default", "thesis") for row in rows_of(effort, preset, ways)]


def degeneracies(effort: Effort) -> tuple[list[Row], list[Row]]:
    """2^H against ESS at the vertices of all drives: what they agree on, and the points."""
    runs = [
        outcome(job)
        for preset in ("default", "thesis")
        for job in jobs(effort.seeds, effort.length, effort.particles, preset, changes=at(0.1))
    ]
    both = np.concatenate([one.degeneracy for one in runs])
    both = both[both[:, 0] < 1.0 - 1e-6]  # equal weights say nothing
    rows: list[Row] = []
    for threshold in THRESHOLDS[:-1]:
        by_entropy = both[:, 0] < threshold
        row: Row = {"2^H threshold": threshold, "vertices below (%)": 100.0 * float(np.mean(by_entropy))}
        for name, other in (("same", threshold), ("squared", threshold**2)):
            agreed = 100.0 * float(np.mean(by_entropy == (both[:, 1] < other)))
            row[f"ESS at the {name} threshold decides alike (%)"] = agreed
        rows.append(row)
    few = both[:: max(1, len(both) // SHOWN)]
    return rows, [{"entropy": float(one), "ess": float(two)} for one, two in few]


def measure(effort: Effort) -> Findings:
    """All of it."""
    first, rest = neutral(), thresholds(effort)
    agreement, points = degeneracies(effort)
    tables = {"resampling-neutral": first, "resampling-always": always(effort), "resampling-thresholds": rest}
    curves = {"neutral": first, "thresholds": rest, "degeneracy": points}
    return Findings(tables | {"resampling-measures": agreement}, curves)


def draw(findings: Findings) -> Figure:
    """Ancestors lost by chance alone; loops by threshold; the two measures."""
    figure = picture(3)
    axes = panel(figure, 0, 0, "equal weights, resampled")
    for place, name in enumerate(("independent", "systematic")):
        rows = findings.curves["neutral"]
        colour, way = WAYS[place]
        axes.loglog(
            [row["resamplings"] for row in rows], [row[f"{name} (%)"] for row in rows], way, color=colour, label=name
        )
    axes.set_xlabel("resamplings")
    axes.set_ylabel("first particles left (%)")
    axes.legend()
    axes = panel(figure, 0, 1, "ATE by threshold")
    for place, preset in enumerate(("default", "thesis")):
        rows = [
            row for row in findings.curves["thresholds"]
            if row["set-up"] == preset and str(row["resampling"]).startswith("2^H")
        ]  # fmt: skip
        colour, way = WAYS[place]
        x = range(len(rows))
        axes.plot(x, [row["ATE median (m)"] for row in rows], way, color=colour, label=f"{preset}, median")
        axes.plot(x, [row["p90"] for row in rows], way[0], color=colour, fillstyle="none", label=f"{preset}, p90")
    axes.set_xticks(range(len(THRESHOLDS)), [str(t) for t in THRESHOLDS])
    axes.set_xlabel("threshold on 2^H / N")
    axes.set_ylabel("ATE (m)")
    axes.set_ylim(bottom=0.0)
    axes.legend()
    axes = panel(figure, 0, 2, "two measures of one thing")
    points = findings.curves["degeneracy"]
    axes.plot([one["entropy"] for one in points], [one["ess"] for one in points], ".", color=WAYS[0][0], markersize=2.0)
    line = np.linspace(0.0, 1.0, 50)
    axes.plot(line, line, "-", color=WAYS[2][0], label="some equal, others nothing")
    axes.plot(line, line**2, "--", color=WAYS[1][0], label="log-normal weights")
    axes.set_xlabel("2^H / N")
    axes.set_ylabel("ESS / N")
    axes.legend()
    return figure
