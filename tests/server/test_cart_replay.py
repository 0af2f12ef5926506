"""A bumper cart's recording becomes poses on a map that is known, or a map of its own; others' logs do as well."""

from __future__ import annotations

import csv
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from server.__main__ import app
from server.formats.logs import read_log
from server.formats.tum import read_tum
from server.maps import swept_map
from server.recorded import open_log
from server.replay import Options, replay
from server.robots.bumper_cart import BumperCart, BumperCartParams
from slam.bump_mapper import BumpMapperParams
from slam.evaluate import absolute_error
from slam.pose import between

DATA = Path(os.environ.get("CRUNCH_DATA", "data"))
OUTPUTS = {"trajectory.tum", "map.pgm", "map.yaml", "map.png", "map.json", "path.g2o", "profile.csv", "report.json"}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    log = tmp_path_factory.mktemp("cart") / "run.rlog"
    made = CliRunner().invoke(
        app, ["simulate", "--robot", "bumper_cart", "--world", "cut-rectangle", "--plan", "bump", "--duration", "400",
              "--seed", "2", "--drift", "low", "--out", str(log)],
    )  # fmt: skip
    assert made.exit_code == 0, made.output
    return log


def mapped(log, out, **settings):
    return replay(log, out, Options(robot="bumper_cart", seed=1, flags={"bumper_cart": settings}))


def late_errors(log, out, share=0.5):
    """Where the end of the path is off the truth: m and rad at the readings of the last share."""
    times, poses = read_tum(out / "trajectory.tum")
    true_times, truth = read_tum(log.with_name(log.name + ".truth.tum"))
    rows = np.searchsorted(true_times, times).clip(0, len(truth) - 1)
    late = slice(int(len(times) * share), None)
    apart = between(poses[late], truth[rows[late]])
    return np.hypot(apart[:, 0], apart[:, 1]), np.abs(apart[:, 2])


def test_on_a_map_that_is_known_it_is_found_and_the_same_seed_gives_the_same_bytes(run, tmp_path):
    report = mapped(run, tmp_path / "one", map="cut-rectangle")
    assert {file.name for file in (tmp_path / "one").iterdir()} == {*OUTPUTS, "clusters.csv"}
    off, turned = late_errors(run, tmp_path / "one")
    assert np.median(off) < 0.05
    assert np.median(turned) < math.radians(8.0)
    assert (report.robot, report.vertices > 20) == ("bumper_cart", True)
    mapped(run, tmp_path / "two", map="cut-rectangle")
    for name in sorted({*OUTPUTS, "clusters.csv"} - {"report.json", "map.png"}):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes(), name


def test_where_it_may_have_been_is_told_bump_by_bump(run, tmp_path):
    report = mapped(run, tmp_path, map="cut-rectangle")
    with (tmp_path / "clusters.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {int(row["vertex"]) for row in rows} == set(range(report.vertices))
    for vertex in range(report.vertices):
        places = [row for row in rows if int(row["vertex"]) == vertex]
        shares = [float(row["share"]) for row in places]
        assert shares == sorted(shares, reverse=True)
        assert sum(shares) <= 1.0 + 1e-3 * len(shares)
        assert [int(row["place"]) for row in places] == list(range(len(places)))
        assert all(row["localized"] == places[0]["localized"] for row in places)
        assert shares[0] >= 0.95 or places[0]["localized"] == "0"
    assert report.localization is not None
    assert report.localization.localized
    since = report.localization.since_vertex
    assert since is not None
    is_found = [row["localized"] == "1" for row in rows if row["place"] == "0"]
    assert all(is_found[since:])
    assert since == 0 or not is_found[since - 1]
    assert report.localization.shares == [
        float(row["share"]) for row in rows if int(row["vertex"]) == len(is_found) - 1
    ]


def test_without_a_map_it_makes_one_and_its_path_is_better_than_its_counters(run, tmp_path):
    report = mapped(run, tmp_path)
    times, poses = read_tum(tmp_path / "trajectory.tum")
    true_times, truth = read_tum(run.with_name(run.name + ".truth.tum"))
    truth = truth[np.searchsorted(true_times, times).clip(0, len(truth) - 1)]
    log = open_log(run)
    robot = BumperCart(BumperCartParams())
    reckoned = []
    for message in log.messages():
        before = robot.now
        robot.step(message)
        if robot.now is not before:
            reckoned.append(robot.odometry)
    found = absolute_error(poses, truth).translation.rmse
    assert found < 0.5 * absolute_error(np.array(reckoned), truth).translation.rmse
    assert json.loads((tmp_path / "map.json").read_text())["walls"]
    assert report.particles == BumpMapperParams().n_particles
    assert report.localization is None
    assert not (tmp_path / "clusters.csv").exists()


def test_a_map_that_cannot_be_used_is_told(run, tmp_path):
    for robot, log, said in (("bumper_cart", run, "map nowhere"), ("crunch", run, "found on a map")):
        outcome = CliRunner().invoke(
            app, ["replay", str(log), "--robot", robot, "--map", "nowhere", "--out", str(tmp_path / "m")]
        )
        assert outcome.exit_code != 0
        assert said in str(outcome.exception) + outcome.output


def test_an_rcx_log_is_replayed_like_any_other(tmp_path):
    log = tmp_path / "run.txt"
    log.write_text("\n".join("300 310\n-40 -40\n60 -58" for _ in range(12)) + "\n")
    assert mapped(log, tmp_path / "out", mapper={"n_particles": 200}).kind == "rcx"
    assert read_log(log).robot == "bumper_cart"


@pytest.mark.skipif(not (DATA / "roomba").is_dir(), reason="needs other people's recordings in CRUNCH_DATA")
@pytest.mark.parametrize(
    ("name", "kind"), [("roomba/DataTest1a.txt", "roomba"), ("neato/avoid_obstacles.bag", "neato")]
)
def test_logs_of_vacuum_robots_are_replayed(name, kind, tmp_path):
    report = mapped(DATA / name, tmp_path, mapper={"n_particles": 200})
    assert report.kind == kind
    assert report.vertices > 0


def test_what_was_swept_is_free_and_walls_are_not():
    way = np.column_stack([np.linspace(0.0, 1.0, 101), np.zeros((101, 2))])
    grid = swept_map(way, [np.array([[1.09, -0.5], [1.09, 0.5]])], 0.08, 0.09)
    place = lambda x, y: grid.cells[round((y - grid.origin[1]) / 0.01 - 0.5), round((x - grid.origin[0]) / 0.01 - 0.5)]  # noqa: E731
    assert place(0.505, 0.005) == place(0.505, 0.035) == place(1.055, 0.005) == 0
    assert place(1.095, 0.305) == 100
    assert place(0.505, 0.105) == place(-0.105, 0.005) == -1
