"""Restarts come when no path leads, keep the likeliest, and are told in the report.

The drive is the lap of the golden replays with a track so much too wide that only one island in four finds the way. It
is short: its right path leads by about 11 nats, so that tests say how much lead is enough.
"""

from __future__ import annotations

import functools
import json

import numpy as np
import pytest

from server.recorded import open_log
from server.replay import Options, Result, doubts, replay, run_log
from slam.hypotheses import DECIDED, Verdict
from tests.replay.test_golden_islands import HERE, SEED, params_of

UNLUCKY = 1  # a seed whose first islands find a likely path only


@pytest.fixture
def enough(monkeypatch):
    """Sets the lead (nats) that counts."""
    return lambda lead: monkeypatch.setattr("slam.hypotheses.DECIDED", lead)


@functools.cache
def lap():
    """The recording."""
    return open_log(HERE / "lap.rlog")


def mapped(seed: int, restarts: int, **how) -> Result:
    """The lap with at most so many restarts."""
    return run_log(lap(), params_of().model_copy(update={"restarts": restarts}), seed, **how)


def test_a_path_that_leads_is_not_doubted(enough):
    enough(5.0)
    found = mapped(SEED, 3).verdict
    assert (found.of, found.restarts) == (4, 0)
    assert doubts(found._replace(lead=DECIDED)) == []


def test_restarts_go_on_until_a_path_leads(enough):
    enough(11.0)
    first, found = mapped(UNLUCKY, 0), mapped(UNLUCKY, 3)
    assert first.verdict.is_open
    assert not found.verdict.is_open
    assert found.verdict.lead > first.verdict.lead
    assert 1 <= found.verdict.restarts < 3
    assert found.verdict.of == 4 * (1 + found.verdict.restarts)
    assert np.max(np.abs(found.trajectory - first.trajectory)) > 0.1, "the path of the restart is told"


def test_a_restart_that_finds_nothing_likelier_changes_nothing(enough):
    enough(1e9)
    assert mapped(SEED + 1, 1).trajectory.tobytes() == mapped(SEED + 1, 0).trajectory.tobytes()


def test_restarts_are_the_same_on_any_number_of_threads(enough):
    enough(1e9)
    one, two = (mapped(UNLUCKY, 2, threads=threads) for threads in (1, 2))
    assert one.trajectory.tobytes() == two.trajectory.tobytes()
    assert one.verdict == two.verdict


def test_the_bar_begins_again_with_every_restart(enough):
    enough(1e9)
    told: list[int] = []
    mapped(SEED, 2, progress=told.append)
    assert told[1:].count(0) == 2
    assert max(told) <= lap().n_odometry


def test_what_stays_open_is_said(enough):
    enough(1e9)
    found = mapped(SEED, 2).verdict
    assert found.is_open
    [word] = doubts(found)
    assert "2 restarts" in word
    assert "crunch.restarts" in word
    assert doubts(Verdict()) == []


def test_the_report_tells_who_agrees(tmp_path, enough):
    enough(1e9)
    flags = {"crunch": {"track": 0.27, "restarts": 0, "filter": {"particles": 5000}}}
    report = replay(HERE / "lap.rlog", tmp_path, Options(seed=SEED, threads=1, flags=flags))
    written = json.loads((tmp_path / "report.json").read_text())["hypotheses"]
    assert written == report.hypotheses.model_dump()
    assert written["of"] == 4
    assert written["agreeing"] < 4
    assert written["lead_nats"] > 5.0
    assert any("another map" in warning for warning in report.warnings)
