"""What a replay was and what came of it: the figures of `report.json` (docs/outputs.md)."""

from __future__ import annotations

import importlib.metadata
import math
import platform
import resource
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numba
import numpy as np
from pydantic import BaseModel

from slam.hypotheses import Verdict
from slam.pose_clusters import Belief
from slam.uncertainty import Uncertainty


class Certainty(BaseModel):
    """How certain the vertices are, by whom (`Uncertainty.source`): median and worst, none where that is not known."""

    source: str
    spread_median_m: float | None = None
    spread_worst_m: float | None = None
    heading_median_rad: float | None = None
    heading_worst_rad: float | None = None

    @classmethod
    def of(cls, uncertainty: Uncertainty) -> Certainty:
        """The figures of all vertices."""
        if not len(uncertainty.deviations):
            return cls(source=uncertainty.source)
        spread, heading = uncertainty.spread, uncertainty.deviations[:, 2]
        return cls(
            source=uncertainty.source,
            spread_median_m=round(float(np.median(spread)), 4),
            spread_worst_m=round(float(np.max(spread)), 4),
            heading_median_rad=round(float(np.median(heading)), 5),
            heading_worst_rad=round(float(np.max(heading)), 5),
        )


class Choice(BaseModel):
    """By how many nats the map that is told leads (none where no island makes another), and who makes it."""

    lead_nats: float | None
    agreeing: int
    of: int
    restarts: int

    @classmethod
    def of_verdict(cls, verdict: Verdict) -> Choice:
        """The same as a verdict."""
        lead = round(verdict.lead, 2) if math.isfinite(verdict.lead) else None
        return cls(lead_nats=lead, agreeing=verdict.agreeing, of=verdict.of, restarts=verdict.restarts)


class Localization(BaseModel):
    """Whether a robot that is looked for on a map is found, since which vertex on end, and the shares of all places."""

    localized: bool
    since_vertex: int | None
    shares: list[float]

    @classmethod
    def of(cls, beliefs: Sequence[Belief]) -> Localization | None:
        """The figures at the end, given what was believed at each vertex; None where nobody was looked for."""
        if not beliefs:
            return None
        lost = [vertex for vertex, belief in enumerate(beliefs) if not belief.is_localized]
        since = 1 + max(lost, default=-1)
        shares = [round(float(cluster.share), 4) for cluster in beliefs[-1].clusters]
        return cls(localized=since < len(beliefs), since_vertex=since if since < len(beliefs) else None, shares=shares)


class Report(BaseModel):
    """Names carry their units; `wall_s` and `real_time_factor` are of the run without compiling and without files."""

    robot: str
    log: str
    kind: str
    description: str
    seed: int
    threads: int
    beams: int | None
    max_range: float | None
    preset: str
    settings: dict[str, Any]  # nested; those that differ from the defaults
    particles: int
    vertices: int
    odometry_readings: int
    path_length_m: float
    duration_s: float
    wall_s: float
    real_time_factor: float
    seconds: dict[str, float]
    peak_rss_mb: float
    resamplings: int
    effective_particles: float
    fixed_depth: int
    affinity: float
    plausibility: float
    uncertainty: Certainty
    hypotheses: Choice
    localization: Localization | None
    truncated_at: int | None
    warnings: list[str]
    versions: dict[str, str]

    def headline(self) -> tuple[str, str]:
        """Title and subtitle of the map's picture."""
        title = f"{self.robot.replace('_', ' ').title()} on {Path(self.log).name}"
        subtitle = f"{self.particles:,} particles, seed {self.seed} · {self.vertices:,} vertices · "
        return title, f"{subtitle}{self.path_length_m:.0f} m · {self.real_time_factor:,.0f} times real time"

    def summary(self) -> str:
        """One line for the terminal."""
        return (
            f"{self.path_length_m:.1f} m, {self.vertices} vertices, {self.particles} particles, "
            f"{self.resamplings} resamplings, {self.wall_s:.1f} s ({self.real_time_factor:.0f} times real time)"
        )


def peak_rss_mb() -> float:
    """The most memory that this process has held, in MB."""
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6, 1)


def version() -> str:
    """The installed version of Crunch."""
    return importlib.metadata.version("crunch")


def describe_machine() -> dict[str, str]:
    """What the figures depend on beside the sources."""
    return {
        "crunch": version(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "platform": f"{platform.system()} {platform.machine()}",
    }
