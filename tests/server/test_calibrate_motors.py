"""`crunch calibrate motors` finds the curves of trials, tells how sure they are, and what is wrong with a file."""

from __future__ import annotations

import numpy as np
import pytest

from server.__main__ import run
from server.config import load
from server.errors import UserError
from server.motor_calibration import calibrate
from slam.motor_curve import MotorCurve

PAPER = MotorCurve(0.090149, 6.44209)


def write(path, rows, header="power,distance,time"):
    path.write_text("\n".join([header, *rows, ""]))
    return path


def trials(curve=PAPER, powers=(0.12, 0.2, 0.3, 0.5, 0.8), noise=0.0, seed=0, ending=""):
    rng = np.random.default_rng(seed)
    speeds = [float(curve.speed(power)) * (1.0 + noise * rng.standard_normal()) for power in powers]
    return [f"{power},{5.0 * speed:.6f},5{ending}" for power, speed in zip(powers, speeds, strict=True)]


def test_one_curve_for_both_or_one_for_each_and_settings_that_are_read(tmp_path):
    both = calibrate([write(tmp_path / "a.csv", trials())])
    assert both.fits["both"].curve == pytest.approx(PAPER, rel=1e-4)
    weak = MotorCurve(0.11, 7.0)
    rows = [*trials(ending=",left"), *trials(weak, ending=",right")]
    each = calibrate([write(tmp_path / "b.csv", rows, "Power, Distance ,time,wheel")])
    (tmp_path / "robot.toml").write_text(each.toml())
    motors = load(file=tmp_path / "robot.toml").maze_runner.motors
    assert motors.standing == pytest.approx((0.090149, 0.11), rel=1e-3)
    assert motors.growth == pytest.approx((6.44209, 7.0), rel=1e-3)


def test_intervals_hold_the_truth_as_often_as_they_say(tmp_path):
    held = 0
    for seed in range(200):
        found = calibrate([write(tmp_path / "a.csv", trials(noise=0.03, seed=seed))])
        low, high = found.rows()[1][5].split(" to ")
        held += float(low) <= PAPER.growth <= float(high)
    assert 0.88 < held / 200 < 0.995


def test_the_command_prints_curves_and_residuals_and_draws_them(tmp_path, capsys):
    path = write(tmp_path / "a.csv", trials(noise=0.02))
    assert run(["calibrate", "motors", str(path), "--plot", str(tmp_path / "a.png")], is_debug=False) == 0
    told = capsys.readouterr().out
    assert "A " in told
    assert told.count("both") == 6
    assert "[maze_runner.motors]" in told
    assert f"{tmp_path / 'a.png'}: written\n" in told
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("name", "begins"), [("a.jpg", b"\xff\xd8"), ("a.SVG", b"<?xml"), ("a.pdf", b"%PDF")])
def test_a_picture_is_of_the_kind_that_its_name_says(tmp_path, name, begins):
    path = write(tmp_path / "a.csv", trials())
    assert run(["calibrate", "motors", str(path), "--plot", str(tmp_path / name)], is_debug=False) == 0
    assert (tmp_path / name).read_bytes().startswith(begins)


@pytest.mark.parametrize("name", ["a", "a.bmp", "a.csv"])
def test_a_picture_of_no_kind_is_refused(tmp_path, name, capsys):
    path = write(tmp_path / "a.csv", trials())
    before = path.read_bytes()
    assert run(["calibrate", "motors", str(path), "--plot", str(tmp_path / name)], is_debug=False) == 2
    assert "let it end in .png, .jpg, .svg, .pdf" in capsys.readouterr().err
    assert path.read_bytes() == before


def test_a_file_that_begins_with_a_mark_of_its_encoding_is_read(tmp_path):
    plain = write(tmp_path / "a.csv", trials())
    (tmp_path / "b.csv").write_text(plain.read_text(), encoding="utf-8-sig")
    assert calibrate([tmp_path / "b.csv"]).toml() == calibrate([plain]).toml()


@pytest.mark.parametrize(
    ("rows", "header", "told"),
    [
        (["0.2,0.5,5"], "power,way,time", "a.csv:1: has no column distance"),
        (["0.2,0.5,5", "0.3,x,5"], "power,distance,time", "a.csv:3: a field is not a number"),
        (["0.2,0.5"], "power,distance,time", "a.csv:2: a field is not a number"),
        (["0.2,0.5,inf"], "power,distance,time", "a.csv:2: cannot be read"),
        (["0.2,0.5,5,front"], "power,distance,time,wheel", "a wheel is left or right"),
        ([], "power,distance,time", "holds no trial"),
        (["0.2,0.5,5"], "power,distance,time", "trials of at least two speeds"),
        (["0.2,0.0,5", "0.3,1,5"], "power,distance,time", "leave out trials in which the wheel stood"),
        (["20,0.5,5", "30,1,5"], "power,distance,time", "powers must be above 0 and at most 1"),
        (["0.2,1,5", "0.3,0.5,5"], "power,distance,time", "more power was not faster"),
        (["0.2,1,5,left", "0.3,1.5,5,left"], "power,distance,time,wheel", "of the left wheel only"),
        (["0.2,1,5,left", "0.3,1.5,5,"], "power,distance,time,wheel", "give all of them a wheel"),
    ],
)
def test_what_is_wrong_with_a_file_is_told(tmp_path, rows, header, told):
    with pytest.raises(UserError) as error:
        calibrate([write(tmp_path / "a.csv", rows, header)])
    assert told in str(error.value)


def test_a_file_named_twice_is_told(tmp_path):
    path = write(tmp_path / "a.csv", trials())
    with pytest.raises(UserError, match="named twice"):
        calibrate([path, path])
