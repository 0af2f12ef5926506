"""`crunch calibrate cart`: logs of one bumper cart in, its build and its noise out, with intervals and a picture.

A known map, the path that a camera above saw, or both tell what the counters cannot; without them walls that are felt
again tell all but the tick, which stays as it is. The camera's frame and clock are
its own: the clock is set where the turns that it saw are the cart's. Each recording is folded into its runs' stages
(its siblings `recorded` and `replay`, for logs and options); what they say of the cart is for `slam.cart_calibration`.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from server import config
from server.errors import UserError
from server.formats.tum import read_tum
from server.recorded import open_log
from server.replay import Options
from server.robots.bumper_cart import Run, area_named, runs_of
from slam.bump_mapper import BumpMapperParams
from slam.cart_calibration import learn_alone, learn_from_camera, learn_from_map
from slam.cart_odometry import CartParams, Stage, arcs, bumps_of, raw_path
from slam.pose import wrap
from slam.posterior import Learned

NAME = "bumper_cart"
BUILT = ("wheelbase", "tick", "bumper_width", "bumper_ahead", "veer", "distance_noise", "turn_noise", "rotation_noise")
UNITS = {
    "wheelbase": "m", "tick": "m", "bumper_width": "m", "bumper_ahead": "m", "tolerance": "m", "play": "ticks",
    "distance_noise": "m per root metre", "turn_noise": "rad per root metre", "rotation_noise": "rad per root rad",
    "veer": "rad per m", "overrun": "m",
}  # fmt: skip
UNTOLD = 0.7  # share of the doubt beforehand that is left of what the logs do not tell
CLOCK = 0.1  # s between the looks at which the clocks are laid on each other,
FINE = np.linspace(-0.4, 0.4, 41)  # s around the best of them
ALIKE = 1.2  # times the least median difference of turns: a cart stands after each stage, so that many offsets do


class CartCalibration(NamedTuple):
    """What was learned, from so many bumps, and what the reader should know of the logs; the `longest` run."""

    learned: Learned
    present: CartParams
    bumps: int
    warnings: list[str]
    longest: Sequence[Stage] = ()

    def rows(self) -> list[tuple[str, ...]]:
        """A table: parameter, estimate, interval, present value, unit, and a word where the logs do not tell it."""
        rows: list[tuple[str, ...]] = [("parameter", "estimate", "90 % interval", "present", "unit", "")]
        for name, value, (low, high), _, left in zip(
            *self.learned[:3], self.learned.names, self.learned.left, strict=True
        ):
            present = getattr(self.present, name, None)
            told = f"{present:.4g}" if present is not None else "-"
            word = "hardly told by the logs" if left > UNTOLD else ""
            rows.append((name, f"{value:.4g}", f"{low:.4g} to {high:.4g}", told, UNITS[name], word))
        return rows

    @property
    def found(self) -> CartParams:
        """The cart as it is by what was learned."""
        return self.present._replace(**{name: self.learned.value(name) for name in BUILT if name in self.learned.names})

    def toml(self) -> str:
        """A configuration file with what was learned."""
        names = [name for name in BUILT if name in self.learned.names]
        lines = [f"# Learned by `crunch calibrate cart` from {self.bumps} bumps.", f"[{NAME}.build]"]
        lines += [f"{name} = {self.learned.value(name):.5g}  # {UNITS[name]}" for name in names]
        if "tolerance" in self.learned.names:
            lines += ["", f"[{NAME}.localizer]", f"tolerance = {self.learned.value('tolerance'):.5g}  # m"]
        return "\n".join(lines) + "\n"

    def plot(self, kind: str = "png") -> bytes:
        """The longest run's movements end to end, with the present values and with those learned."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure((10.0, 5.0), layout="constrained")
        pictures = (("before", self.present, "#e4792a"), ("after", self.found, "#2f6fde"))
        for place, (title, cart, tint) in enumerate(pictures, 1):
            path = raw_path(self.longest, cart)
            axes = figure.add_subplot(1, 2, place, xlabel="x (m)", ylabel="y (m)", title=f"{title} calibration")
            axes.plot(path[:, 0], path[:, 1], color=tint, linewidth=0.8)
            bumped = path[bumps_of(self.longest) + 1]
            axes.plot(bumped[:, 0], bumped[:, 1], ".", color="black", markersize=3, label="bumps")
            axes.set_aspect("equal", "datalim")
            axes.legend(frameon=False)
        picture = io.BytesIO()
        FigureCanvasAgg(figure)
        figure.savefig(picture, format=kind, dpi=120)
        return picture.getvalue()


def calibrate(
    paths: Sequence[Path], world: str | None, options: Options, cameras: Sequence[Path] = ()
) -> CartCalibration:
    """Learn from logs of one cart on one map, beside the paths of a camera, one for each log, or alone; or UserError.

    `cameras` are TUM files.
    """
    check(paths, cameras)
    area = area_named(world) if world is not None else None
    runs: list[list[Stage]] = []
    seen: list[np.ndarray] = []
    warnings: list[str] = []
    present, mapper = CartParams(), BumpMapperParams()
    for place, path in enumerate(paths):
        log = open_log(path, None, None, NAME)
        params = config.load(options.flags, options.file, log.configuration, options.assignments).bumper_cart
        present, mapper = params.build.params, params.mapper
        for run in runs_of(log.messages(None), params):
            runs.append(run.stages)
            if cameras:
                seen.append(seen_at_ends(run, *read_tum(cameras[place]), present))
            if run.truant:
                warnings.append(f"{path}: {run.truant} stages were lost; poses on both sides of them are not compared")
        warnings += log.warnings
    try:
        if area is None and not cameras:
            learned = learn_alone(runs, present, options.seed, mapper)
            warnings.append(f"bumps alone tell no lengths: all are told for a tick of {present.tick:g} m, as it is set")
        elif area is None:
            learned = learn_from_camera(runs, seen, present)
        else:
            learned = learn_from_map(runs, area, present, options.seed, seen or None)
    except ValueError as error:
        raise UserError(f"{', '.join(map(str, paths))}: nothing is learned: {error}") from None
    bumps = sum(len(bumps_of(stages)) for stages in runs)
    return CartCalibration(learned, present, bumps, warnings, max(runs, key=len))


def check(paths: Sequence[Path], cameras: Sequence[Path]) -> None:
    """UserError where there is too little, or too much of the same."""
    if cameras and len(cameras) != len(paths):
        raise UserError(f"{len(cameras)} camera's paths for {len(paths)} logs; give one --path for each log, in order")
    for place, path in enumerate(paths):
        if path.resolve() in [other.resolve() for other in paths[:place]]:
            raise UserError(f"{path} is named twice; name each log once, or its intervals would be too narrow")


def seen_at_ends(run: Run, times: np.ndarray, poses: np.ndarray, cart: CartParams) -> np.ndarray:
    """Poses (n + 1, 3) that a camera saw at times (m,) at the start and the n stages' ends; nan where it saw nothing.

    Where the cart began is not known, for nothing tells when.
    """
    order = np.argsort(times, kind="stable")
    times, poses = times[order], poses[order]
    ends = np.array(run.times)
    turns = arcs(run.stages, cart)[:, 2]
    ends = ends + clock_offset(ends, turns, times, poses)
    return np.vstack([np.full((1, 3), np.nan), poses_at(ends, times, poses)])


def poses_at(wanted: np.ndarray, times: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Poses (n, 3) at times (n,) between those (m, 3) that were seen at times (m,); nan outside."""
    columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    return np.column_stack([np.interp(wanted, times, column, np.nan, np.nan) for column in columns])


def clock_offset(ends: np.ndarray, turns: np.ndarray, times: np.ndarray, poses: np.ndarray) -> float:
    """What to add to the times (n,) of stages' ends, between which so much (n,) was turned, for a camera's times (m,).

    The offset at which rates of turning agree best; then the middle of those at which each stage's turn does.
    """
    grid = np.arange(ends[0], ends[-1], CLOCK)
    told = np.diff(np.interp(grid, ends, np.cumsum(turns)))
    looks = np.arange(times[0], times[-1], CLOCK)
    saw = np.diff(np.interp(looks, times, np.unwrap(poses[:, 2])))
    likeness = np.correlate(saw, told, "full")
    coarse = looks[0] - grid[0] + CLOCK * (int(np.argmax(likeness)) - (len(told) - 1))
    off = []
    for step in FINE:
        seen = poses_at(ends + coarse + step, times, poses)[:, 2]
        differences = np.abs(wrap(np.diff(seen) - turns[1:]))
        differences = differences[np.isfinite(differences)]
        off.append(float(np.median(differences)) if len(differences) else np.inf)
    best = float(np.min(off))
    if not np.isfinite(best):
        raise UserError("the camera's path is of no time at which the cart drove; give the path of this log")
    return float(coarse + np.mean(FINE[np.array(off) <= ALIKE * best]))
