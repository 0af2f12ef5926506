"""A laser's line: what it is asked, what it answers, and what becomes of lasers that fall silent or are others."""

from __future__ import annotations

import numpy as np
import pytest

from firmware.virtual.mazes import maze
from firmware.virtual.urg import VirtualUrg
from server.laser_line import PARTICULARS, SILENCE, LaserLine
from slam.laser_scan import LaserParams

STEP = 0.02  # s


class Wired:
    """The virtual laser on a line, and a clock."""

    def __init__(self, laser: LaserParams | None = None):
        world = maze("small", 0)
        self.laser = VirtualUrg(world, lambda t: np.array(world.start), seed=1)
        self.line = LaserLine(laser or LaserParams())
        self.t = 0.0
        self.sweeps, self.asked = [], []

    def run(self, seconds: float, is_heard: bool = True) -> None:
        for _ in range(round(seconds / STEP)):
            self.t += STEP
            said = self.laser.advance(round(1000 * STEP))
            if is_heard:
                self.sweeps += self.line.receive(said, self.t)
            request = self.line.requests(self.t)
            if request:
                self.asked.append(request)
                self.laser.write(request)


def test_it_is_asked_for_its_particulars_and_then_for_sweeps_without_end():
    wired = Wired()
    wired.run(2.0)
    assert wired.asked == [PARTICULARS, b"MD0044072501000\n"]
    assert 18 <= len(wired.sweeps) <= 20
    assert len(wired.sweeps[0].ranges) == 682
    assert np.diff([sweep.t for sweep in wired.sweeps]) == pytest.approx(0.1, abs=1e-6)


def test_one_that_falls_silent_is_asked_again():
    wired = Wired()
    wired.run(2.0)
    wired.laser.write(b"QT\n")
    before = len(wired.sweeps)
    wired.run(2.0 * SILENCE + 0.5)
    assert len(wired.sweeps) > before + 5
    assert wired.asked[2:] == wired.asked[:2]


def test_one_that_does_not_answer_is_asked_once_a_second():
    wired = Wired()
    wired.run(5.2, is_heard=False)
    assert wired.asked == [PARTICULARS] * 6


@pytest.mark.parametrize("other", [{"beams": 1081}, {"first_deg": -90.0}, {"step_deg": 0.25}])
def test_one_that_is_another_than_the_settings_have_is_told_with_the_remedy(other):
    wired = Wired(LaserParams(**other))
    wired.run(3.0)
    assert wired.sweeps == []
    assert "682 beams from -119.5312 on every 0.351562 degrees" in wired.line.fault
    assert "maze_runner.laser" in wired.line.fault
    assert set(wired.asked) == {PARTICULARS}


def test_sweeps_of_other_beams_are_counted():
    wired = Wired()
    wired.laser.write(b"MD0100050001000\n")
    assert wired.line.receive(wired.laser.advance(550), 0.5) == []
    assert wired.line.refused["beams"] == 5
    wired.run(2.5)
    assert len(wired.sweeps) > 5, "it is asked for the whole"


def test_noise_is_survived():
    rng = np.random.default_rng(2)
    wired = Wired()
    for _ in range(60):
        wired.run(0.05)
        wired.line.receive(rng.integers(0, 256, 40, dtype=np.uint8).tobytes() + b"\n\n", wired.t)
    assert wired.line.decoder.rejected.total() > 20
    assert len(wired.sweeps) > 5


def test_particulars_that_make_no_sense_are_counted_and_told():
    wired = Wired()
    wired.line.receive(b"PP\n00P\n\n", 0.1)
    assert wired.line.refused["particulars"] == 1
    assert "cannot be read" in wired.line.fault
