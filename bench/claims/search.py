"""Thesis 2.6 and 2.7: local search is enough without long cycles, and cannot get a long cycle right.

The same corridors are driven as far, with the same errors of odometry: twice around the cycle, or out and back again
several times without ever closing it.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from bench.claims.drives import Route, by_odometry, jobs, outcome, summary
from bench.claims.findings import Effort, Findings, Row
from bench.claims.plots import WAYS, panel, picture

ROUTES: tuple[Route, ...] = ("out and back", "cycle")
TRIES = (10, 100)  # perturbations at each vertex
PATIENT, FEW = 1000, 4  # the same, where patience is put to the test, by one seed of so many
QUARTERS = 4


def compared(effort: Effort) -> tuple[list[Row], list[Row]]:
    """Odometry, searches and the filter on both routes; and each seed's revisit error, for the picture."""
    rows: list[Row] = []
    curves: list[Row] = []
    for route in ROUTES:
        ways = {f"local search, {tries} a vertex": {"estimator": "search", "perturbations": tries} for tries in TRIES}
        runs = []
        for name, changes in (ways | {"path filter": {}}).items():
            wanted = jobs(effort.seeds, effort.length, effort.particles, route=route, changes=changes)
            runs = [outcome(job) for job in wanted]
            rows.append({"route": route, "estimator": name, **summary(runs)})
            curves += [{"route": route, "estimator": name, "error": one.revisit} for one in runs]
        place = len(rows) - len(ways) - 1
        rows.insert(place, {"route": route, "estimator": "odometry", **by_odometry(runs)})
        curves += [{"route": route, "estimator": "odometry", "error": one.odometry_revisit} for one in runs]
    over = {"estimator": "search", "perturbations": PATIENT}
    patient = jobs(max(1, effort.seeds // FEW), effort.length, effort.particles, changes=over)
    name = f"local search, {PATIENT} a vertex"
    return [*rows, {"route": "cycle", "estimator": name, **summary([outcome(job) for job in patient])}], curves


def diluted(effort: Effort) -> list[Row]:
    """Share of perturbations that improve the path, by quarter of the drive: more vertices, fewer tries for each."""
    rows: list[Row] = []
    for route in ROUTES:
        over = {"estimator": "search", "perturbations": TRIES[-1]}
        shares = []
        for job in jobs(effort.seeds, effort.length, effort.particles, route=route, changes=over):
            accepted = np.r_[0, outcome(job).accepted]
            marks = np.linspace(0, accepted.size - 1, QUARTERS + 1).astype(int)
            shares.append(np.diff(accepted[marks]) / np.diff(marks) / TRIES[-1])
        middle = 100.0 * np.mean(shares, axis=0)
        row: Row = {"route": route}
        rows.append(row | {f"quarter {k + 1} (%)": float(value) for k, value in enumerate(middle)})
    return rows


def measure(effort: Effort) -> Findings:
    """All of it."""
    rows, curves = compared(effort)
    return Findings({"search-drives": rows, "search-diluted": diluted(effort)}, {"search": curves})


def draw(findings: Findings) -> Figure:
    """Every seed's revisit error, by estimator, on both routes."""
    figure = picture(2)
    curves = findings.curves["search"]
    names = ["odometry", *(f"local search, {tries} a vertex" for tries in TRIES), "path filter"]
    for column, route in enumerate(ROUTES):
        axes = panel(
            figure, 0, column, {"cycle": "two laps of a long cycle", "out and back": "out and back, no cycle"}[route]
        )
        for place, name in enumerate(names):
            errors = [float(one["error"]) for one in curves if (one["route"], one["estimator"]) == (route, name)]
            colour, way = WAYS[place]
            apart = np.linspace(-0.25, 0.25, len(errors)) if len(errors) > 1 else np.zeros(1)
            axes.semilogy(place + apart, sorted(errors), way[0], color=colour, alpha=0.8)
            axes.plot([place - 0.35, place + 0.35], [np.median(errors)] * 2, color=colour)
        axes.axhline(0.35, color="#888888", linewidth=0.8)
        axes.set_xticks(range(len(names)), ["odometry", *(f"search\n{tries}" for tries in TRIES), "filter"])
        if column == 0:
            axes.set_ylabel("revisit error of each seed (m)")
    return figure
