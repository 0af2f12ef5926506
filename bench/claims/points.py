"""Thesis 2.5: fewer test points are faster and vary more; an evaluation that goes badly can be cut short.

Pairs of vertices come from the drives: places truly seen twice (`true`), the same with the relative pose off by
`OFF` (`near`), vertices from elsewhere put in their stead (`elsewhere`), and second vertices turned to any side
(`turned`). Scores are log likelihood ratios of "the
same place" against chance, so that their running sum is the statistic of Wald's sequential probability ratio test.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from bench.claims.drives import fold_of, jobs, outcome, setting, summary
from bench.claims.findings import Effort, Findings, Row
from bench.claims.pairs import Pairs, nanoseconds, paired, point_scores, points_of
from bench.claims.plots import WAYS, panel, picture
from slam.affinity import AffinityParams
from slam.pose import compose
from slam.walls import Walls

COUNTS = (4, 8, 16, 32, 64, 128, 256)
ON_DRIVES = (4, 16, 64, 256)
DENSE = 4096  # points that stand for infinitely many
USUAL = 64
NEAR, AGO = 0.8, 30  # m and vertices between the two of a pair
OFF = (0.3, 0.3, 0.15)  # m, m, rad: standard deviations
FAR = 3.0  # m from the place that stands in for another
DRIVES = 8  # that pairs are taken from
BAD = -0.1  # mean score below which a pair is called very bad
Seen = tuple[Walls, Walls, np.ndarray, np.ndarray]


def pairs_of(effort: Effort) -> tuple[dict[str, list[Seen]], float]:
    """Walls and poses of pairs, by group, and the local map's reach."""
    params = setting("default", {})
    rng = np.random.default_rng(0)
    true: list[Seen] = []
    elsewhere: list[Seen] = []
    drives = min(DRIVES, effort.seeds)
    for seed in range(drives):
        seen = fold_of("cycle", seed, effort.length, params)
        walls, truth = seen.drive.walls, seen.vertex_truth
        apart = np.hypot(*(truth[:, None, :2] - truth[None, :, :2]).transpose(2, 0, 1))
        ago = np.subtract.outer(np.arange(len(truth)), np.arange(len(truth)))
        later, earlier = np.nonzero((apart < NEAR) & (ago >= AGO))
        for k in rng.permutation(len(later))[: effort.pairs // drives]:
            a, b = int(later[k]), int(earlier[k])
            other = int(rng.choice(np.flatnonzero(apart[b] > FAR)))
            true.append((walls[a], walls[b], truth[a], truth[b]))
            elsewhere.append((walls[a], walls[other], truth[a], truth[b]))
    near = [(one, two, a, compose(b, rng.normal(0.0, OFF))) for one, two, a, b in true]
    turned = [(one, two, a, b + [0.0, 0.0, rng.uniform(-math.pi, math.pi)]) for one, two, a, b in true]
    return {"true": true, "near": near, "elsewhere": elsewhere, "turned": turned}, params.filter_params().reach


def spreads(pairs: Pairs, params: AffinityParams, reach: float) -> list[Row]:
    """Error of the mean score about that of `DENSE` points, by number of points."""
    halton = points_of(params, reach, DENSE)
    chance = np.random.default_rng(1).normal(0.0, params.spread * reach, (DENSE, 2))
    scores = {"Halton": point_scores(pairs, halton, params), "random": point_scores(pairs, chance, params)}
    exact = scores["Halton"].mean(axis=1, keepdims=True)
    rows: list[Row] = []
    for count in COUNTS:
        row: Row = {"points": count}
        for name, values in scores.items():
            means = values.reshape(len(values), DENSE // count, count).mean(axis=2)
            row[f"spread, {name}"] = float(np.sqrt(np.mean((means - exact) ** 2)))
        row["log weight's, Halton"] = params.gain * float(row["spread, Halton"])
        rows.append(row)
    return rows


def times(effort: Effort, params: AffinityParams, reach: float) -> tuple[list[Row], list[Row]]:
    """Nanoseconds for a pair by number of points, on the true path; with early exit, there and on the odometry's."""
    seen = fold_of("cycle", 0, effort.length, setting("default", {}))
    walls, truth = seen.drive.walls, seen.vertex_truth
    odometry = seen.drive.odometry[seen.drive.rows]
    by_count: list[Row] = [
        {
            "points": count,
            "ns per pair": nanoseconds(truth, walls, params.model_copy(update={"n_points": count}), reach),
        }
        for count in COUNTS
    ]
    by_exit: list[Row] = []
    for name, bound in (("all points", -math.inf), (f"running mean below {BAD}", BAD)):
        hasty = params.model_copy(update={"early_exit": bound})
        paths = {"true path (ns)": truth, "odometry's path (ns)": odometry}
        row: Row = {"a pair by": name}
        by_exit.append(row | {where: nanoseconds(path, walls, hasty, reach) for where, path in paths.items()})
    return by_count, by_exit


class Rule(NamedTuple):
    """A way to cut short: `stops` tells from sums (k, m) of the first points, and their numbers (m,), where to."""

    name: str
    every: int
    stops: Callable[[np.ndarray, np.ndarray], np.ndarray]


def rules(params: AffinityParams, points: int) -> list[Rule]:
    """The running mean; what no further point could mend; Wald's test, by the share of good pairs it may lose."""
    best = max(params.both_wall, params.both_free)
    found = [
        Rule(f"running mean below {bound}", 16, lambda sums, counts, bound=bound: sums < bound * counts)
        for bound in (-0.1, -0.3)
    ]
    found.append(Rule("no rest could mend it", 1, lambda sums, counts: sums + best * (points - counts) < BAD * points))
    for share in (1e-1, 1e-2, 1e-3):
        bound = math.log(share)
        found.append(Rule(f"likelihood ratio below {share:g}", 4, lambda sums, counts, bound=bound: sums < bound))
    return found


def cut_short(scores: np.ndarray, rule: Rule) -> tuple[np.ndarray, np.ndarray]:
    """Points looked at (k,) and mean score (k,) so far, of pairs with `scores` (k, m) in the order of looking."""
    n = scores.shape[1]
    counts = np.arange(1, n + 1)
    sums = np.cumsum(scores, axis=1)
    stops = rule.stops(sums, counts) & (counts % rule.every == 0)
    stops[:, -1] = True
    looked = 1 + np.argmax(stops, axis=1)
    return looked, sums[np.arange(len(sums)), looked - 1] / looked


def scores_by(groups: dict[str, Pairs], params: AffinityParams, reach: float) -> list[Row]:
    """How the mean scores of each group lie."""
    rows: list[Row] = []
    for name, pairs in groups.items():
        means = point_scores(pairs, points_of(params, reach), params).mean(axis=1)
        low, middle, high = (float(value) for value in np.quantile(means, [0.1, 0.5, 0.9]))
        row: Row = {"pairs": name, "10th percentile": low, "median": middle, "90th percentile": high}
        rows.append(row | {"very bad (%)": 100.0 * float(np.mean(means < BAD))})
    return rows


def early(groups: dict[str, Pairs], params: AffinityParams, reach: float) -> list[Row]:
    """Points saved and decisions changed by each rule, for the groups of pairs."""
    points = points_of(params, reach)
    whole = {name: point_scores(pairs, points, params) for name, pairs in groups.items()}
    rows: list[Row] = []
    for rule in [Rule("none", 1, lambda sums, counts: np.zeros(sums.shape, bool)), *rules(params, params.n_points)]:
        row: Row = {"rule": rule.name}
        stopped, wrong, lost, changes = 0, 0, 0.0, []
        for name, scores in whole.items():
            looked, found = cut_short(scores, rule)
            mean = scores.mean(axis=1)
            row[f"points, {name}"] = float(np.mean(looked))
            is_cut = looked < scores.shape[1]
            stopped += int(is_cut.sum())
            lost = float(np.mean(is_cut)) if name == "true" else lost
            wrong += int(np.sum(is_cut & (mean >= BAD)))
            changes.append(params.gain * (found - mean))
        row["cut short (%)"] = 100.0 * stopped / sum(map(len, whole.values()))
        row["true ones (%)"] = 100.0 * lost
        row["of them not very bad (%)"] = 100.0 * wrong / max(1, stopped)
        row["log weight off by"] = float(np.sqrt(np.mean(np.concatenate(changes) ** 2)))
        rows.append(row)
    return rows


def on_drives(effort: Effort) -> list[Row]:
    """Loops by the number of points, and with early exit."""
    rows: list[Row] = []
    ways: list[tuple[str, dict[str, float]]] = [(f"{count} points", {"n_points": count}) for count in ON_DRIVES]
    ways.append((f"{USUAL} points, early exit at {BAD}", {"early_exit": BAD}))
    for name, changes in ways:
        over = {"filter": {"comparison": {"affinity": changes}}}
        runs = [outcome(job) for job in jobs(effort.seeds, effort.length, effort.particles, changes=over)]
        rows.append({"affinity": name, **summary(runs)})
    return rows


def measure(effort: Effort) -> Findings:
    """All of it."""
    params = AffinityParams(n_points=USUAL)
    seen, reach = pairs_of(effort)
    groups = {name: paired(pairs, params, reach) for name, pairs in seen.items()}
    by_count, by_exit = times(effort, params, reach)
    spread = [one | two for one, two in zip(spreads(groups["near"], params, reach), by_count, strict=True)]
    cut = early(groups, params, reach)
    tables = {"points-spread": spread, "points-scores": scores_by(groups, params, reach), "points-early": cut}
    return Findings(
        tables | {"points-time": by_exit, "points-drives": on_drives(effort)}, {"spread": spread, "early": cut}
    )


def draw(findings: Findings) -> Figure:
    """Spread and time against the number of points; what the rules save and break."""
    figure = picture(3)
    spread, cut = findings.curves["spread"], findings.curves["early"]
    counts = [float(row["points"]) for row in spread]
    axes = panel(figure, 0, 0, "spread of the mean score")
    for place, name in enumerate(("random", "Halton")):
        axes.loglog(
            counts, [row[f"spread, {name}"] for row in spread], WAYS[place][1], color=WAYS[place][0], label=name
        )
    first = float(spread[0]["spread, random"])
    axes.loglog(counts, [first * math.sqrt(counts[0] / n) for n in counts], ":", color="#888888", label="1 / root of n")
    axes.set_xlabel("test points")
    axes.legend()
    axes = panel(figure, 0, 1, "time of a pair (ns)")
    axes.loglog(counts, [row["ns per pair"] for row in spread], WAYS[0][1], color=WAYS[0][0])
    axes.set_xlabel("test points")
    axes = panel(figure, 0, 2, "early exit: saved and changed")
    for place, row in enumerate(cut[1:]):
        looked = float(row["points, turned"])
        colour, way = WAYS[place]
        axes.plot(
            [100.0 * (1.0 - looked / USUAL)], [float(row["of them not very bad (%)"])], way[0], color=colour,
            label=row["rule"], markersize=7.0,
        )  # fmt: skip
    axes.set_xlabel("points saved on turned pairs (%)")
    axes.set_ylabel("cut short, but not very bad (%)")
    axes.legend()
    return figure
