"""Restarts come when no path leads, keep the likeliest, and are told in the report."""

from __future__ import annotations

import json
from typing import Any

import pytest

from server.recorded import open_log
from server.replay import Options, doubts, replay, run_log
from server.restarts import decided
from slam.hypotheses import DECIDED, Hypothesis, Verdict, verdict
from tests.replay.test_golden_islands import HERE, SEED, params_of
from tests.slam.test_hypotheses import bent, square


class Found:
    """An estimator that comes to certain hypotheses, and counts what it was given."""

    def __init__(self, *hypotheses: Hypothesis):
        self.hypotheses = list(hypotheses)
        self.n_vertices = 0
        self.is_refined = False

    def extend(self, pose, walls, travelled):
        self.n_vertices += 1

    def refine(self):
        self.is_refined = True


RIGHT, WRONG, OTHER = Hypothesis(128.0, square()), Hypothesis(93.0, bent(square(), 0.6)), Hypothesis(
    91.6, bent(square(), -0.8)
)  # fmt: skip


@pytest.fixture
def restarted(monkeypatch):
    """Estimators that restarts get, in turn, and the seeds that they were made with."""
    queue, seeds = [], []

    def make(params, seed, threads):
        seeds.append(seed)
        return queue[len(seeds) - 1]

    monkeypatch.setattr("server.restarts.make_estimator", make)
    return queue, seeds


class Params:
    """All that is asked of a robot's."""

    restarts = 3


class Keyframe:
    """A vertex."""

    pose = walls = travelled = None


def judged(first: Any, keyframes: Any) -> tuple[Any, Verdict]:
    """What comes of an estimator, with stand-ins for all that restarts only hand on."""
    params: Any = Params()
    return decided(first, keyframes, params, 1, 1)


def test_a_path_that_leads_is_not_doubted(restarted):
    first = Found(RIGHT, WRONG)
    assert judged(first, [Keyframe()]) == (first, verdict(first.hypotheses))
    assert restarted[1] == []


def test_restarts_go_on_until_a_path_leads_over_all_that_were_found(restarted):
    queue, seeds = restarted
    first, second = Found(WRONG, OTHER), Found(OTHER)
    third = Found(RIGHT, Hypothesis(60.0, WRONG.path))
    queue.extend([second, third])
    best, found = judged(first, [Keyframe()] * 5)
    assert best is third
    assert found == Verdict(RIGHT.score - WRONG.score, agreeing=1, of=5, restarts=2)
    assert second.n_vertices == third.n_vertices == 5
    assert second.is_refined
    assert len({1, *seeds}) == 3, "every restart has a seed of its own"


def test_what_stays_open_is_said(restarted):
    restarted[0].extend([Found(OTHER), Found(OTHER), Found(OTHER)])
    first = Found(WRONG, OTHER)
    best, found = judged(first, [])
    assert best is first
    assert found.is_open
    assert found.restarts == Params.restarts
    [word] = doubts(found)
    assert "3 restarts" in word
    assert "crunch.restarts" in word
    assert doubts(Verdict(lead=DECIDED)) == []


def test_an_undecided_drive_is_filtered_again_by_other_islands(monkeypatch):
    """With the track too wide islands differ; where no lead is enough, every restart that is allowed comes."""
    log, params = open_log(HERE / "lap.rlog"), params_of().model_copy(update={"restarts": 1})
    monkeypatch.setattr("slam.hypotheses.DECIDED", 5.0)
    plain = run_log(log, params, SEED)
    assert plain.verdict.of == 4
    assert plain.verdict.restarts == 0, "one island leads"
    monkeypatch.setattr("slam.hypotheses.DECIDED", 1e9)
    told: list[int] = []
    again = run_log(log, params, SEED, progress=told.append)
    assert 0 in told[1:], "the bar begins again with a restart"
    assert again.verdict.restarts == 1
    assert again.verdict.of == 8
    assert again.trajectory.tobytes() == run_log(log, params, SEED, threads=2).trajectory.tobytes()


def test_the_report_tells_who_agrees(tmp_path, monkeypatch):
    monkeypatch.setattr("slam.hypotheses.DECIDED", 1e9)
    flags = {"crunch": {"track": 0.27, "restarts": 0, "filter": {"particles": 5000}}}
    report = replay(HERE / "lap.rlog", tmp_path, Options(seed=SEED, threads=1, flags=flags))
    written = json.loads((tmp_path / "report.json").read_text())["hypotheses"]
    assert written == report.hypotheses.model_dump()
    assert written["of"] == 4
    assert written["agreeing"] < 4
    assert written["lead_nats"] > 5.0
    assert any("another map" in warning for warning in report.warnings)
