"""A small run of each benchmark that needs neither recordings nor a browser: its records fill every declared column."""

from __future__ import annotations

import functools

import pytest

from bench import ablation, calibration, cycle, kernels, odometry, recordings, scale
from bench.benchmark import Bench, Crew, Record, Row
from bench.recordings import WIDTHS
from server.formats.logs import read_log
from tests.server.logs import write_room_log


@pytest.fixture(autouse=True)
def small_cycle(monkeypatch, tmp_path_factory):
    """A lap of 22 m instead of 50, kept for all tests of this file."""
    monkeypatch.setattr(recordings, "CACHE", tmp_path_factory.getbasetemp() / "drives")
    small = functools.partial(recordings.cycle, length=22.0)
    for module in (ablation, calibration, cycle, kernels, odometry, scale):
        monkeypatch.setattr(module, "cycle", small)


def assert_filled(bench: Bench, record: Record, *empty: str):
    """Every column has a text, but those of which nothing is known here."""
    row = Row("row", [record])
    assert {column.title for column in bench.columns if column.text(row) == "-"} == set(empty)


def test_cycle():
    record = cycle.run(cycle.Cycle("low", WIDTHS[0]), 0)
    assert_filled(cycle.BENCH, record)
    assert 0.0 < record["ate"] < 1.0
    assert record["of_oracle"] == pytest.approx(record["ate"] / record["oracle_ate"])


def test_calibration():
    for name, record in calibration.run("low", 0).items():
        assert_filled(calibration.BENCH, record)
        assert record["held_50"] <= record["held_68"] <= record["held_90"] <= record["held_95"] <= 100.0, name


def test_odometry():
    drives = [odometry.run("medium", seed) for seed in range(2)]
    for record in odometry.judged("medium", 0, drives).values():
        assert_filled(odometry.BENCH, record)
        assert record["low"] <= record["estimate"] <= record["high"]
        assert record["fall"] >= 0.0


def test_ablation(monkeypatch):
    monkeypatch.setattr(ablation, "CYCLES", ("medium",))
    monkeypatch.setattr(ablation, "BUILDINGS", ())
    monkeypatch.setattr(ablation, "LOG_SEEDS", 0)
    names = [ablation.WHOLE, "hindsight", ablation.ODOMETRY]
    monkeypatch.setattr(ablation, "INGREDIENTS", {name: ablation.INGREDIENTS[name] for name in names[:2]})
    with Crew(1) as crew:
        whole, without, thesis, odometry = ablation.rows(crew)
    [record] = whole.records
    missing = ("high", "round", "parallel", "intel", "aces", "five")
    others = {f"{drive}_{key}": 1.0 for drive in missing for key in ("ate", "closed")}
    assert_filled(ablation.BENCH, record | others | {"buildings_cost": 1.0, "logs_cost": 1.0})
    assert record["cycles_cost"] == 1.0
    assert without.records[0]["medium_ate"] != record["medium_ate"]
    bent = odometry.records[0]["medium_ate"] / record["medium_ate"]
    assert odometry.records[0]["cycles_cost"] == pytest.approx(bent)
    assert bent > 1.0
    assert thesis.records[0]["refinement_ms"] < record["refinement_ms"]


def test_scale():
    record = scale.run(scale.Size(300), 0)
    assert_filled(scale.BENCH, record)
    assert record["nodes"] >= record["vertices"]
    assert record["vertex_ms"] <= record["worst_ms"]


def test_kernels(monkeypatch):
    monkeypatch.setattr(kernels, "PARTICLES", 3000)
    monkeypatch.setattr(kernels, "VERTICES", 55)
    monkeypatch.setattr("bench.roofline.REPEATS", 1)
    found = kernels.run(0)
    for name, record in found.items():
        assert_filled(kernels.BENCH, record)
        assert record["ratio"] == pytest.approx(record["ns"] / record["bound_ns"]), name
    assert found["compare a pair"]["n"] <= 3 * 3000


def test_the_ablation_hears_a_log_s_own_senses(monkeypatch, tmp_path):
    path = tmp_path / "room.log"
    times, truth = write_room_log(path)
    monkeypatch.setattr(ablation, "five_directions", lambda: (read_log(path), times, truth))
    found = ablation.run(ablation.FIVE, 0, [ablation.WHOLE, ablation.THESIS_ITSELF, ablation.ODOMETRY])
    assert found[ablation.WHOLE]["ate"] < 0.5 * found[ablation.ODOMETRY]["ate"]
