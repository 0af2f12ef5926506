"""`crunch calibrate sonar`: repeated readings of a standing sonar in, its noise by range out, with intervals.

What is learned is how much readings vary (`slam.sonar_noise`), so that errors which every repeat shares do not show.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from server.errors import UserError
from server.formats.errors import FormatError, read_bytes
from server.formats.ev3 import REMEDY, is_ev3, read_ev3
from slam.local_map import LocalMapParams
from slam.sonar_noise import FEWEST, SonarNoise, fit_bands

NARROWEST = 0.01  # m of a band; readings are told to the millimetre
WIDEST = 10.0  # m, farther than sonars hear
SURE = 3.0  # standard deviations that what is told of a wall must hold


class SonarCalibration(NamedTuple):
    """Noise by bands of range; how many sets of how many repeats there were, and in how many most were silent."""

    bands: list[SonarNoise]
    n_sets: int
    n_repeats: int
    n_silent: int

    def rows(self) -> list[tuple[str, ...]]:
        """A table: its titles, and a row of texts for each band."""
        titles = ("range (m)", "sets", "sigma (mm)", "95 %", "outliers (%)", "95 %", "silent (%)", "95 %")
        return [titles, *(row_of(band) for band in self.bands)]

    def notes(self, present: LocalMapParams) -> list[str]:
        """What the table leaves out, and what it says about the present settings."""
        silent = f"{self.n_silent} of {self.n_sets} sets of {self.n_repeats} were silent in most repeats: of no range"
        sure = [band for band in self.bands if band.has_intervals]
        few = [f"bands of fewer than {FEWEST} sets have no intervals"] if len(sure) < len(self.bands) else []
        return [silent, *few, self.verdict(sure, present.sonar_arc)]

    def verdict(self, bands: list[SonarNoise], arc: float) -> str:
        """Whether the arc (m) that the local map draws is wide enough for bands that have intervals."""
        if not bands:
            return f"sonar_arc = {arc:g} m is not judged: no band has an interval; measure more, or choose wider bands"
        widest = max(band.intervals[0, 1] for band in bands)
        verdict = "holds" if arc >= SURE * widest else "is less than"
        which = "every band" if len(bands) == len(self.bands) else "every band with an interval"
        return f"sonar_arc = {arc:g} m {verdict} {SURE:g} sigma of {which} ({1e3 * SURE * widest:.0f} mm)"


def calibrate(paths: Sequence[Path], width: float = 0.25) -> SonarCalibration:
    """The noise in bands `width` m wide, of all files together; UserError for what a person can mend."""
    if not NARROWEST <= width <= WIDEST:
        raise UserError(f"--band {width:g} is no width of bands; choose one from {NARROWEST:g} to {WIDEST:g} m")
    for place, path in enumerate(paths):
        if path.resolve() in [other.resolve() for other in paths[:place]]:
            raise UserError(f"{path} is named twice; name each file once, or its intervals would be too narrow")
    sets = np.concatenate([repeats_of(path) for path in paths])
    heard = np.isfinite(sets)
    farthest = float(np.max(sets, where=heard, initial=0.0))
    bands = fit_bands(sets, width * np.arange(int(farthest / width) + 2))
    if not bands:
        raise UserError("no echo was heard, so that nothing is learned; bring walls nearer to the sonar")
    n_silent = int(np.sum(np.mean(heard, axis=1) < 0.5))
    return SonarCalibration(bands, len(sets), sets.shape[1], n_silent)


def repeats_of(path: Path) -> np.ndarray:
    """The sets (n, repeats) of readings in m that a file holds; FormatError where it holds none."""
    content = read_bytes(path)
    if content.strip() and not is_ev3(content):
        raise FormatError(path, 1, "is no log of repeated sonar readings", REMEDY)
    ranges = read_ev3(path).ranges
    return ranges.reshape(-1, ranges.shape[2])


def row_of(band: SonarNoise) -> tuple[str, ...]:
    """A band as texts."""
    texts = [f"{band.nearest:.2f} to {band.farthest:.2f}", f"{band.n_sets}"]
    parts = ((band.sigma, 1e3, 1), (band.outliers, 1e2, 2), (band.silence, 1e2, 2))
    for (value, factor, digits), (low, high) in zip(parts, band.intervals, strict=True):
        interval = f"{factor * low:.{digits}f} to {factor * high:.{digits}f}" if band.has_intervals else "-"
        texts += [f"{factor * value:.{digits}f}", interval]
    return tuple(texts)
