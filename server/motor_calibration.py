"""`crunch calibrate motors`: trials of powers, distances and times in, each motor's curve out (Maze Runner, eq. 2)."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from server.errors import UserError
from server.formats.errors import FormatError, read_bytes
from slam.motor_curve import MotorFit, fit_curve

COLUMNS = ("power", "distance", "time")
WHEEL = "wheel"  # a column that may say which motor a trial was of
WHEELS = ("left", "right")
BOTH = "both"
REMEDY = "the first line is `power,distance,time`, then a trial a line: share of full power, metres, seconds"
PICTURES = ("png", "jpg", "svg", "pdf")  # kinds, by the ends of files' names
SURE = 0.95  # of the intervals


class Trials(NamedTuple):
    """Powers, distances (m) and times (s) of one motor, each (n,)."""

    powers: np.ndarray
    distances: np.ndarray
    times: np.ndarray

    @property
    def speeds(self) -> np.ndarray:
        """m/s."""
        return self.distances / self.times


class MotorCalibration(NamedTuple):
    """The trials and the curve of each motor: `both`, or `left` and `right`."""

    trials: Mapping[str, Trials]
    fits: Mapping[str, MotorFit]

    def rows(self) -> list[tuple[str, ...]]:
        """A table of the curves: its titles, and a row for each motor."""
        titles = ("motor", "trials", "A", "95 %", "B (s/m)", "95 %", "fastest (m/s)", "residuals (% of the power)")
        return [titles, *(row_of(name, fit, len(self.trials[name].powers)) for name, fit in self.fits.items())]

    def residual_rows(self) -> list[tuple[str, ...]]:
        """A table of the trials: what was told, and by how much the curve misses it."""
        found = [("motor", "power", "speed (m/s)", "the curve's power", "off (%)")]
        for name, fit in self.fits.items():
            for power, speed, off in zip(
                self.trials[name].powers, self.trials[name].speeds, fit.residuals, strict=True
            ):
                curve = float(fit.curve.command(speed))
                found.append((name, f"{power:.3f}", f"{speed:.3f}", f"{curve:.3f}", f"{100.0 * off:+.1f}"))
        return found

    def toml(self) -> str:
        """The settings for a file behind --config."""
        curves = [self.fits[wheel if wheel in self.fits else BOTH].curve for wheel in WHEELS]
        standing, growth = ([f"{value:.6g}" for value in values] for values in zip(*curves, strict=True))
        return f"[maze_runner.motors]\nstanding = [{', '.join(standing)}]\ngrowth = [{', '.join(growth)}]\n"

    def plot(self, kind: str = "png") -> bytes:
        """Trials and curves as a picture of a kind of `PICTURES`."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure((7.0, 4.5), layout="constrained")
        axes = figure.add_subplot(xlabel="speed (m/s)", ylabel="power (share of full)", title="Power = A exp(B speed)")
        for tint, (name, fit) in zip(("#2f6fde", "#e4792a"), self.fits.items(), strict=False):
            speeds = np.linspace(0.0, fit.curve.fastest, 200)
            axes.plot(speeds, fit.curve.command(np.maximum(speeds, 1e-9)), color=tint, label=f"{name}: curve")
            axes.plot(self.trials[name].speeds, self.trials[name].powers, "o", color=tint, label=f"{name}: trials")
        axes.set_ylim(0.0, 1.05)
        axes.legend(frameon=False)
        picture = io.BytesIO()
        FigureCanvasAgg(figure)
        figure.savefig(picture, format=kind, dpi=120)
        return picture.getvalue()


def calibrate(paths: Sequence[Path]) -> MotorCalibration:
    """The curves of all files' trials together; UserError for what a person can mend."""
    for place, path in enumerate(paths):
        if path.resolve() in [other.resolve() for other in paths[:place]]:
            raise UserError(f"{path} is named twice; name each file once, or its intervals would be too narrow")
    rows = [row for path in paths for row in read_trials(path)]
    names = sorted({name for name, *_ in rows})
    if len(names) > 1 and BOTH in names:
        raise UserError("some trials say which wheel they were of and some do not; give all of them a wheel, or none")
    if names not in ([BOTH], list(WHEELS)):
        raise UserError(f"there are trials of the {names[0]} wheel only; add the other's, or leave out the column")
    trials = {name: trials_of([numbers for wheel, *numbers in rows if wheel == name]) for name in names}
    try:
        return MotorCalibration(trials, {name: fit_curve(*those) for name, those in trials.items()})
    except ValueError as error:
        raise UserError(f"no curve is learned: {error}") from None


def picture_kind(path: Path) -> str:
    """The kind of picture that a file's name asks for; UserError where it is none that is drawn."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in PICTURES:
        raise UserError(f"--plot {path}: is no name of a picture; let it end in .{', .'.join(PICTURES)}")
    return kind


def trials_of(rows: list[list[float]]) -> Trials:
    """Rows of power, distance and time as columns."""
    return Trials(*np.array(rows, float).T)


def read_trials(path: Path) -> list[tuple[str, float, float, float]]:
    """Wheel, power, distance and time of each trial; FormatError names the line that cannot be read."""
    reader = csv.DictReader(io.StringIO(read_bytes(path, "name a CSV file").decode("utf-8-sig", errors="replace")))
    names = [name.strip().lower() for name in reader.fieldnames or ()]
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        raise FormatError(path, 1, f"has no column {' and '.join(missing)}", REMEDY)
    reader.fieldnames = names
    rows = []
    for row in reader:
        wheel = (row.get(WHEEL) or BOTH).strip().lower()
        try:
            numbers = [float(row[name] or "") for name in COLUMNS]
        except (ValueError, TypeError):
            raise FormatError(path, reader.line_num, "a field is not a number", REMEDY) from None
        if not all(math.isfinite(number) for number in numbers) or wheel not in (*WHEELS, BOTH):
            raise FormatError(path, reader.line_num, "cannot be read", f"{REMEDY}; a wheel is left or right")
        rows.append((wheel, *numbers))
    if not rows:
        raise FormatError(path, None, "holds no trial", REMEDY)
    return rows


def row_of(name: str, fit: MotorFit, n_trials: int) -> tuple[str, ...]:
    """A motor's curve as texts; without intervals where two trials leave nothing to judge by."""
    curve, spread = fit.curve, float(np.sqrt(np.mean(fit.residuals**2)))
    if math.isfinite(fit.growth_sigma):
        from scipy.stats import t as student  # here, for it takes long to load

        sure = float(student.ppf(0.5 + 0.5 * SURE, n_trials - 2))  # few trials tell little of their spread
        wide = math.exp(sure * fit.log_standing_sigma)
        standing = f"{curve.standing / wide:.4f} to {curve.standing * wide:.4f}"
        low, high = (curve.growth + sign * sure * fit.growth_sigma for sign in (-1.0, 1.0))
        growth = f"{low:.3f} to {high:.3f}"
    else:
        standing = growth = "-"
    values = (f"{curve.standing:.4f}", standing, f"{curve.growth:.3f}", growth, f"{curve.fastest:.3f}")
    return (name, str(n_trials), *values, f"{100.0 * spread:.1f}")
