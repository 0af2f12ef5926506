"""The drives of the benchmarks are what their names say."""

from __future__ import annotations

import numpy as np
import pytest

from bench import recordings
from firmware.virtual import corridor_cycle, corridor_plan
from server.formats.tum import read_tum
from slam.evaluate import path_length, revisit_pairs
from slam.pose import wrap


@pytest.mark.parametrize(("is_reversed", "turned"), [(False, 0.0), (True, np.pi)])
def test_a_reversed_second_lap_comes_back_the_other_way(monkeypatch, tmp_path, is_reversed, turned):
    monkeypatch.setattr(recordings, "CACHE", tmp_path)
    drive = recordings.cycle(3, "none", 1.8, is_reversed, length=20.0)
    truth = read_tum(recordings.truth_of(drive))[1]
    truth = truth[path_length(truth) < 38.0]  # two laps; what follows goes the second lap's way
    later, earlier = revisit_pairs(truth, 0.4, 4.0)
    apart = np.abs(wrap(truth[later, 2] - truth[earlier, 2] - turned))
    assert later.size > 20
    assert np.quantile(apart, 0.9) < 0.6


@pytest.mark.parametrize("width", [1.8, 2.4, 3.0])
def test_a_corridor_is_as_wide_as_asked(width):
    world, points = corridor_cycle(1, 50.0, width), corridor_plan(1, 50.0, 1.0, wobble=0.0).points
    across = np.zeros(len(points))
    heading = np.arctan2(*np.gradient(points, axis=0).T[::-1])
    for side in (0.5 * np.pi, -0.5 * np.pi):
        across += world.cast(points[:, 0], points[:, 1], heading + side)
    assert np.median(across) == pytest.approx(width, abs=0.1)  # doors and alcoves only here and there


def test_drives_of_different_kinds_do_not_share_a_file(monkeypatch, tmp_path):
    monkeypatch.setattr(recordings, "CACHE", tmp_path)
    kinds = [(1.8, False), (1.8, True), (2.1, False), (None, False)]
    assert len({recordings.cycle(0, "none", *kind, length=30.0) for kind in kinds}) == 4
