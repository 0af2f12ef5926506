"""`crunch calibrate cart`: a recording and a map in, the cart's build out; and maps that are none are refused."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from firmware.virtual.worlds import BUILT_IN
from server.__main__ import app
from server.cart_calibration import UNITS, CartCalibration, calibrate, clock_offset
from server.config import load
from server.errors import UserError
from server.formats.tum import read_tum, write_tum
from server.replay import Options
from server.robots.bumper_cart import area_named
from slam.cart_odometry import CartParams
from slam.pose import compose
from slam.posterior import Learned

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
    names = tuple(UNITS)
    values = 0.01 * np.arange(1.0, len(names) + 1.0)
    left = np.where(np.array(names) == "play", 0.9, 0.1)
    learned = Learned(names, values, np.column_stack([0.9 * values, 1.1 * values]), 3.0, left)
    found = CartCalibration(learned, CartParams(), 99, [])
    assert len(found.rows()) == len(names) + 1
    assert found.rows()[1] == ("wheelbase", "0.01", "0.009 to 0.011", "0.064", "m", "")
    assert [row[0] for row in found.rows() if "hardly" in row[-1]] == ["play"]
    assert "from 99 bumps" in found.toml()
    assert "\nwheelbase = 0.01  # m\n" in found.toml()
    assert found.found.wheelbase == 0.01


def test_a_cameras_clock_is_laid_on_the_carts():
    rng = np.random.default_rng(5)
    turns = rng.uniform(-3.0, 3.0, 60)
    ends = np.cumsum(rng.uniform(1.0, 4.0, 60))
    times = np.arange(0.0, ends[-1] + 5.0, 0.04)
    heading = np.interp(times, np.column_stack([ends - 0.9, ends - 0.2]).ravel(),
                        np.column_stack([np.cumsum(turns) - turns, np.cumsum(turns)]).ravel())  # fmt: skip
    poses = np.column_stack([np.zeros((len(times), 2)), heading + 0.01 * rng.standard_normal(len(times))])
    assert clock_offset(ends, turns, times + 1000.0, poses) == pytest.approx(1000.0, abs=0.3)


def test_a_cameras_path_in_a_frame_and_a_time_of_its_own_calibrates(tmp_path):
    log, camera, plot, output = (tmp_path / name for name in ("run.rlog", "camera.tum", "paths.png", "cart.toml"))
    made = CliRunner().invoke(
        app, ["simulate", "--robot", "bumper_cart", "--world", "cut-rectangle", "--plan", "bump", "--duration", "200",
              "--seed", "3", "--out", str(log)],
    )  # fmt: skip
    assert made.exit_code == 0
    times, poses = read_tum(tmp_path / "run.rlog.truth.tum")
    write_tum(camera, times + 777.0, compose(np.array([3.0, -2.0, 1.0]), poses))
    result = CliRunner().invoke(
        app, ["calibrate", "cart", str(log), "--path", str(camera), "--plot", str(plot), "--output", str(output)]
    )
    assert result.exit_code == 0, result.output
    assert plot.read_bytes().startswith(b"\x89PNG")
    learned = load(file=output).bumper_cart.build
    assert learned.wheelbase == pytest.approx(0.0624, rel=0.015)  # of the cart with this seed
    assert learned.veer != 0.0


def test_a_log_needs_a_path_of_its_own(tmp_path):
    with pytest.raises(UserError, match="one --path for each log"):
        calibrate([tmp_path / "run.rlog"], None, Options("bumper_cart", 0, 1, None, None, None, {}, ()), [ROOM, ROOM])


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
    result = CliRunner().invoke(app, ["calibrate", "cart", str(log)])
    assert result.exit_code != 0
    assert "it takes 50 bumps" in str(result.exception) + result.output
