"""`crunch merge`: logs of several carts become one folder; what is no cart's is refused, who is left out is told."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from server.__main__ import app
from server.cart_merging import doubts
from server.formats.tum import read_tum
from slam.bump_merging import MergedMap

NAMES = ("one", "two", "three")


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("carts")
    for seed, name in enumerate(NAMES[:2]):
        made = CliRunner().invoke(
            app, ["simulate", "--robot", "bumper_cart", "--world", "cut-rectangle", "--plan", "bump", "--duration",
                  "90", "--seed", str(seed + 2), "--drift", "low", "--out", str(folder / f"{name}.rlog")],
        )  # fmt: skip
        assert made.exit_code == 0, made.output
    return folder


def test_logs_become_one_map_with_a_path_for_each_cart(logs, tmp_path):
    out = tmp_path / "map"
    made = CliRunner().invoke(
        app, ["merge", str(logs / "one.rlog"), str(logs / "two.rlog"), "--out", str(out), "--set",
              "bumper_cart.mapper.n_particles=500"],
    )  # fmt: skip
    assert made.exit_code == 0, made.output
    report = json.loads((out / "merge.json").read_text())
    merged = [row["run"] for row in report["runs"] if row["is_merged"]]
    assert report["reference"] in merged
    wanted = {"map.pgm", "map.yaml", "map.png", "map.json", "merge.json", *(f"{name}.tum" for name in merged)}
    assert {path.name for path in out.iterdir()} == wanted
    times, poses = read_tum(out / f"{report['reference']}.tum")
    assert len(times) == len(poses) > 5
    assert np.all(np.diff(times) > 0.0)


def test_a_log_that_is_no_carts_is_refused(tmp_path):
    (tmp_path / "note.rlog").write_text("not a recording")
    made = CliRunner().invoke(app, ["merge", str(tmp_path / "note.rlog"), "--out", str(tmp_path / "map")])
    assert made.exit_code != 0
    assert "note.rlog" in str(made.exception)


def test_who_is_left_out_is_told_with_the_reason():
    whole = MergedMap(
        0, [0], [1, 2], np.array([1.0, 0.2, 0.9]), np.array([0.0, 5.0, 3.1]), 0.99, [], np.zeros((0, 10)), [],
        np.zeros((3, 2)),
    )  # fmt: skip
    one, two, alone, turned = doubts(whole, NAMES)
    assert one.startswith("two is left out: 20 % of its bumps")
    assert two.startswith("three is left out: the map explains its bumps 3.1 nats")
    assert "no two maps agree" in alone
    assert "another way round" in turned
