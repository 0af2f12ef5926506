"""Is the estimate as good as it says? How often the truth lies within the regions that should hold it.

Every vertex's place is looked at from the first vertex, from the newest one, from twenty that are spread along the
path, and, where the truth came back to a place (*revisits*), from the vertex that saw it before. The error there is
measured in the ellipse of the covariance that is claimed for it: d^2 = e' C^-1 e, which is chi-squared of two degrees
of freedom if the claim is right, so that a region that should hold a share q of the errors is d^2 < -2 ln(1 - q). A
record tells for one drive the shares that it held.

Claims: `particles` is mean and covariance of the particles as they are at the end, `refinement` the refined path with
the covariance of its least squares. Both are looked at with the default's noise and, on simulated drives, with the
noise and the spread of biases that the robot truly has (*noise known*): what is left then is not for calibrating the
odometry to mend.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from bench.benchmark import Bench, Column, Crew, Record, Row, middle, runs, values_of
from bench.recordings import cycle, data_folder, read, semireal
from bench.scores import params_of
from firmware.virtual import DRIFTS
from server.formats.logs import Log
from server.replay import fold
from server.robots.crunch import Crunch, CrunchParams, make_estimator
from slam.evaluate import revisit_pairs
from slam.islands import Islands
from slam.path_filter import PathFilter
from slam.pose import between
from slam.refined_filter import Correction, RefinedFilter
from slam.resampling import normalize, systematic
from slam.timeline import interpolate
from slam.uncertainty import MIDDLE, SAMPLE

NOMINAL = (0.5, 0.68, 0.9, 0.95)
BINS = 20  # of the probabilities at which the errors lie; level if the claims are right
CERTAIN = 1e-4  # m; below this a claim says that there is no error at all
# In the order of the virtual robot's drifts.
SLIP = ("distance_noise", "turn_noise", "scale_bias", "turn_bias", "rotation_noise")
DRIVES = ("low", "medium", "high", "intel", "aces")
VIEWS = ("from the first vertex", "from the newest", "from all along", "revisits")
VIEWERS = 20  # spread along the path


class Claim(NamedTuple):
    """Where vertices should lie as seen from others, (k, 2) m, and with which covariance (k, 2, 2)."""

    places: np.ndarray
    covariances: np.ndarray


Claimant = Callable[[np.ndarray, np.ndarray], Claim]  # vertices (k,) that look, vertices (k,) that are looked at


def particles_claim(path_filter: PathFilter) -> Claimant:
    """Mean and covariance over a systematic sample of the particles' paths."""
    tree = path_filter.tree
    assert tree is not None
    drawn = systematic(normalize(path_filter.particles.log_weights), MIDDLE, SAMPLE)
    paths = np.array([tree.path(int(particle)) for particle in drawn])

    def claim(viewers: np.ndarray, viewed: np.ndarray) -> Claim:
        places = between(paths[:, viewers], paths[:, viewed])[..., :2]
        centred = places - places.mean(axis=0)
        return Claim(places.mean(axis=0), np.einsum("pki,pkj->kij", centred, centred) / len(paths))

    return claim


def refinement_claim(correction: Correction) -> Claimant:
    """The refined path, and the covariances of its normal equations."""
    covariances, marginals = correction.covariances, correction.covariances.marginals()

    def claim(viewers: np.ndarray, viewed: np.ndarray) -> Claim:
        found = np.empty((len(viewers), 3, 3))
        for viewer in np.unique(viewers):
            rows = viewers == viewer
            found[rows] = covariances.seen_from(int(viewer), marginals)[viewed[rows]]
        places = between(correction.after[viewers], correction.after[viewed])
        return Claim(places[:, :2], found[:, :2, :2])

    return claim


def views_of(truth: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Which vertices (k,) look at which (k,), by the name of the view, for true poses (n, 3)."""
    n = len(truth)
    later, earlier = revisit_pairs(truth, 0.4, 20.0)
    everyone = np.arange(n)
    viewers = np.linspace(0, n - 1, VIEWERS).astype(np.int64)
    return {
        "from the first vertex": (np.zeros(n - 1, np.int64), everyone[1:]),
        "from the newest": (np.full(n - 1, n - 1), everyone[:-1]),
        "from all along": (np.repeat(viewers, n - 1), np.concatenate([np.delete(everyone, k) for k in viewers])),
        "revisits": (earlier, later),
    }


def held(claim: Claim, true_places: np.ndarray) -> Record:
    """How often the truth (k, 2) lies in the claimed regions, and how large errors and claims are."""
    errors = true_places - claim.places
    spreads = np.sqrt(np.trace(claim.covariances, axis1=1, axis2=2))
    precisions = np.linalg.inv(claim.covariances + 1e-12 * np.eye(2))
    squares = np.einsum("ki,kij,kj->k", errors, precisions, errors)
    squares[spreads < CERTAIN] = np.inf
    probabilities = 1.0 - np.exp(-0.5 * squares)
    shares = {f"held_{round(100 * part)}": 100.0 * float(np.mean(probabilities <= part)) for part in NOMINAL}
    return {
        **shares,
        "error": float(np.median(np.hypot(errors[:, 0], errors[:, 1]))),
        "spread": float(np.median(spreads)),
        "certain": 100.0 * float(np.mean(spreads < CERTAIN)),
        "probabilities": (np.histogram(probabilities, BINS, (0.0, 1.0))[0] / len(errors)).tolist(),
    }


def run(name: str, seed: int) -> dict[str, Record]:
    """One drive: a record by claim and view, with the default's noise and, where it is known, with the robot's own."""
    log, times, truth = read(semireal(name, seed) if name in ("intel", "aces") else cycle(seed, name))
    found = claimed(log, times, truth, params_of(), seed)
    if name not in DRIFTS:
        return found
    known = params_of(filter={"motion": dict(zip(SLIP, DRIFTS[name], strict=True))})
    return found | {f"{kind}, noise known": record for kind, record in claimed(log, times, truth, known, seed).items()}


def claimed(log: Log, times: np.ndarray, truth: np.ndarray, params: CrunchParams, seed: int) -> dict[str, Record]:
    """A record by claim and view of one drive with these parameters."""
    path_filter = make_estimator(params, seed)
    drive = fold(log, Crunch(params), lambda seen: path_filter.extend(seen.pose, seen.walls, seen.travelled))
    at_vertices = interpolate(times, truth, drive.times[drive.rows])[0]
    path_filter.refine()
    claims = claims_of(path_filter)
    found = {}
    for view, (viewers, viewed) in views_of(at_vertices).items():
        places = between(at_vertices[viewers], at_vertices[viewed])[:, :2]
        for claimant, claim in claims.items():
            found[f"{claimant}, {view}"] = {"seed": seed, **held(claim(viewers, viewed), places)}
    return found


def claims_of(path_filter: RefinedFilter) -> dict[str, Claimant]:
    """Whose claims are looked at."""
    assert isinstance(path_filter.path_filter, Islands)
    claims = {"particles": particles_claim(path_filter.path_filter.filter)}
    if path_filter.correction is not None:
        claims["refinement"] = refinement_claim(path_filter.correction)
    return claims


def rows(crew: Crew) -> Iterator[Row]:
    """One for each drive, claim and view."""
    for name in DRIVES if data_folder() else DRIVES[:3]:
        if crew.wants(name):
            found = crew.map(run, [(name, seed) for seed in range(crew.seeds)], name)
            for kind in dict.fromkeys(kind for records in found for kind in records):
                yield Row(f"{name}, {kind}", [records[kind] for records in found if kind in records])


def mean(key: str) -> Callable[[Row], str]:
    """Mean over the drives with its standard error."""

    def text(row: Row) -> str:
        values = np.array(values_of(row, key), float)
        error = float(np.std(values, ddof=1)) / math.sqrt(values.size) if values.size > 1 else math.nan
        return f"{values.mean():.0f} ± {error:.0f}" if values.size > 1 else f"{values.mean():.0f}"

    return text


BENCH = Bench(
    name="calibration",
    about="does the truth lie as often within the regions of 50, 68, 90 and 95 % as it should?",
    rows=rows,
    columns=(
        Column("drives", runs),
        *(Column(f"{100 * part:.0f} % region holds (%)", mean(f"held_{round(100 * part)}")) for part in NOMINAL),
        Column("error, median (m)", middle("error")),
        Column("claimed spread", middle("spread")),
        Column("claimed certain (%)", mean("certain")),
    ),
    seeds=30,
    minutes=20,
    heading="drift or log, claim, view",
)
