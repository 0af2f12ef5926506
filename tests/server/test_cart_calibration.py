"""`crunch calibrate cart`: a recording and a map in, the cart's build out; and maps that are none are refused."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from firmware.virtual.worlds import BUILT_IN
from server.__main__ import app
from server.cart_calibration import CartCalibration
from server.errors import UserError
from server.robots.bumper_cart import area_named
from slam.cart_calibration import BY_MAP, Learned
from slam.cart_odometry import CartParams

ROOM = BUILT_IN / "cut-rectangle.toml"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("walls = [", "not TOML|TOML"),
        ("", "wall"),
        ("walls = [[[0, 0], [1, 0], [1, 1], [0, 1]]]", "closed|open|outline"),
        ("segments = [[0, 0, 1, 1]]", "closed|open|outline"),
    ],
)
def test_what_is_no_map_is_refused(tmp_path, text, said):
    path = tmp_path / "room.toml"
    path.write_text(f'name = "room"\nstart = [0.2, 0.2, 0.0]\n{text}\n')
    with pytest.raises(UserError, match=said):
        area_named(str(path))


def test_a_map_is_a_world_by_its_name_or_its_file(tmp_path):
    np.testing.assert_array_equal(area_named("cut-rectangle").walls, area_named(str(ROOM)).walls)
    with pytest.raises(UserError, match=r"map nowhere: .*built-in"):
        area_named("nowhere")


def test_what_was_learned_is_told_and_becomes_settings():
    values = np.arange(1.0, len(BY_MAP) + 1.0)
    learned = Learned(BY_MAP, values, np.column_stack([0.9 * values, 1.1 * values]), 3.0)
    found = CartCalibration(learned, CartParams(), 99, [])
    assert len(found.rows()) == len(BY_MAP) + 1
    assert found.rows()[1] == ("wheelbase", "1", "0.9 to 1.1", "0.064", "m")
    assert "from 99 bumps" in found.toml()
    assert "\nwheelbase = 1  # m\n" in found.toml()


def test_a_run_that_is_too_short_is_refused(tmp_path):
    log = tmp_path / "run.rlog"
    made = CliRunner().invoke(
        app, ["simulate", "--robot", "bumper_cart", "--world", "cut-rectangle", "--plan", "bump", "--duration", "30",
              "--out", str(log)],
    )  # fmt: skip
    assert made.exit_code == 0
    result = CliRunner().invoke(app, ["calibrate", "cart", str(log), "--map", str(ROOM)])
    assert result.exit_code != 0
    assert "too few bumps" in str(result.exception) + result.output
