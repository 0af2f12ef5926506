"""EV3 stops: 13 bearings by 25 repeats in metres; broken rows are told with their line."""

from __future__ import annotations

import math

import numpy as np
import pytest

from server.formats import FormatError
from server.formats.ev3 import COLUMNS, is_ev3, read_ev3


def row(*pose: float, ranges: float = 50.0) -> str:
    return " ".join(f"{part:g}" for part in [*pose, *[ranges] * (COLUMNS - 3)]) + "\n"


def test_a_row_is_a_stop(tmp_path):
    path = tmp_path / "ev3.log"
    fields = np.array([10.0, -20.0, 7.0, *np.arange(13 * 25)])
    path.write_text(row(0, 0, 0, ranges=255) + " ".join(f"{field:g}" for field in fields) + "\n\n")
    assert is_ev3(path.read_bytes())
    log = read_ev3(path)
    np.testing.assert_allclose(log.poses[1], [0.1, -0.2, 7.0 - 2.0 * math.pi])
    assert log.ranges.shape == (2, 13, 25)
    assert np.all(np.isinf(log.ranges[0]))
    assert log.ranges[1, 2, 3] == pytest.approx(0.53), "25 repeats of one bearing follow each other"
    assert np.isinf(log.ranges[1].ravel()[255:]).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        (row(0, 0, 0) + "1 2 3\n", ":2: 3 fields where 328 belong"),
        (row(0, 0, 0).replace("50", "fifty", 1), ":1: a field is not a number"),
        (row(0, 0, math.nan), ":1: a field is not finite"),
        (row(0, 0, 0, ranges=-1), "a range is negative"),
    ],
)
def test_broken_logs_are_told_with_their_line(tmp_path, text, words):
    path = tmp_path / "ev3.log"
    path.write_text(text)
    with pytest.raises(FormatError, match=words):
        read_ev3(path)


def test_other_files_are_not_taken_for_it():
    assert not is_ev3(b"")
    assert not is_ev3(b"ODOM 1 2 3\n")
    assert not is_ev3(b"1 2 3\n")
