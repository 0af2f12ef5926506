"""`crunch calibrate sonar`: what repeats of a sonar's readings tell, as a table, and one line for every mistake."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from server.formats.ev3 import COLUMNS
from server.sonar_calibration import calibrate
from slam.local_map import LocalMapParams
from tests.server.test_cli import assert_mendable, crunch  # noqa: F401

EV3 = Path(os.environ.get("CRUNCH_DATA", "data")) / "ev3" / "ev3.log"


def write_stops(path: Path, sigma: float, silent: int = 0, n: int = 30, seed: int = 0) -> None:
    """A log of n stops whose readings spread by `sigma` m; the last `silent` bearings of each hear nothing."""
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(0.5, 1.5, (n, 13, 1)) + rng.normal(0.0, sigma, (n, 13, 25))
    ranges[:, 13 - silent :] = 2.55
    rows = np.concatenate([np.zeros((n, 3)), 100.0 * ranges.reshape(n, -1)], axis=1)
    assert rows.shape[1] == COLUMNS
    np.savetxt(path, rows, "%.3f")


def test_noise_that_went_in_is_printed_with_its_interval(crunch, tmp_path):  # noqa: F811
    write_stops(tmp_path / "stops.log", 0.006, silent=2)
    outcome = crunch("calibrate", "sonar", "stops.log", "--band", "0.5")
    assert (outcome.code, outcome.err) == (0, "")
    table, notes = outcome.out.split("\n\n")
    bands = [line.split("  ") for line in table.splitlines()]
    assert [row[0] for row in bands] == ["range (m)   ".strip(), "0.50 to 1.00", "1.00 to 1.50"]
    for row in bands[1:]:
        sigma, interval = [text.strip() for text in row if text.strip()][2:4]
        low, high = map(float, interval.split(" to "))
        assert low <= float(sigma) <= high
        assert float(sigma) == pytest.approx(6.0, abs=0.3)
    assert "60 of 390 sets of 25 were silent in most repeats" in notes
    assert "sonar_arc = 0.04 m holds" in notes


def test_a_band_of_few_sets_is_printed_without_intervals(crunch, tmp_path):  # noqa: F811
    for n_sets in (9, 10):
        middles = np.linspace(0.55, 0.95, 13)[None, :, None]  # of 13 sets; all but n_sets go to a band of their own
        middles = np.where(np.arange(13)[None, :, None] < n_sets, middles, middles + 0.5)
        ranges = middles + np.random.default_rng(n_sets).normal(0.0, 0.006, (1, 13, 25))
        np.savetxt(tmp_path / "stop.log", np.concatenate([np.zeros(3), 100.0 * ranges.ravel()])[None], "%.3f")
        outcome = crunch("calibrate", "sonar", "stop.log", "--band", "0.5")
        assert (outcome.code, outcome.err) == (0, "")
        table, notes = outcome.out.split("\n\n")
        near, far = ([cell.strip() for cell in line.split("  ") if cell.strip()] for line in table.splitlines()[1:])
        assert (near[1], far[1]) == (f"{n_sets}", f"{13 - n_sets}")
        assert [far[place] for place in (3, 5, 7)] == ["-"] * 3
        assert ([near[place] for place in (3, 5, 7)] == ["-"] * 3) == (n_sets == 9)
        assert "bands of fewer than 10 sets have no intervals" in notes
        judged = "is not judged: no band has an interval" if n_sets == 9 else "sigma of every band with an interval"
        assert judged in notes


def test_files_count_together_and_settings_are_judged(tmp_path):
    for name, seed in (("a.log", 1), ("b.log", 2)):
        write_stops(tmp_path / name, 0.006, seed=seed)
    both, one = (calibrate([tmp_path / name for name in names]) for names in (("a.log", "b.log"), ("a.log",)))
    assert both.n_sets == 2 * one.n_sets
    assert any("is less than" in note for note in both.notes(LocalMapParams(sonar_arc=0.01)))


def test_mistakes_are_one_line(crunch, tmp_path):  # noqa: F811
    write_stops(tmp_path / "stops.log", 0.006)
    write_stops(tmp_path / "silent.log", 0.006, silent=13)
    (tmp_path / "other.log").write_text("ODOM 0 0 0\n")
    (tmp_path / "empty.log").write_text("")
    told = ("calibrate", "sonar")
    assert_mendable(crunch(*told, "missing.log"), "missing.log: no such file")
    assert_mendable(crunch(*told, "other.log"), "other.log:1: is no log of repeated sonar readings")
    assert_mendable(crunch(*told, "empty.log"), "empty.log: is empty")
    assert_mendable(crunch(*told, "silent.log"), "no echo was heard")
    assert_mendable(crunch(*told, "stops.log", "stops.log"), "is named twice")
    for width in ("0", "1e-09", "-1", "inf", "-inf", "nan", "1e+300"):
        refused = crunch(*told, "stops.log", f"--band={width}")
        assert_mendable(refused, f"--band {width} is no width of bands; choose one from 0.01 to 10 m")
    assert_mendable(crunch(*told), "Missing argument")


@pytest.mark.skipif(not EV3.is_file(), reason="needs other people's recordings in CRUNCH_DATA")
def test_a_real_sonar_is_exact_to_millimetres_and_strays_more_often_farther_away():
    found = calibrate([EV3], 0.5)
    assert found.n_sets == 734 * 13
    for band in found.bands:
        assert 0.001 < band.sigma < 0.004
        assert band.silence < 0.01
    near, far = found.bands[0], found.bands[2]
    assert near.intervals[1, 1] < far.intervals[1, 0]
