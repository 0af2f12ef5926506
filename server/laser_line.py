"""The line of a laser that speaks SCIP 2.0: sweeps in, and the requests that make it tell them.

A laser that says nothing is asked for its particulars, and, where they are those of the robot's settings, for sweeps
without end; one that was plugged out or switched off is asked again. Asks no clock.
"""

from __future__ import annotations

import math
from collections import Counter

from server import scip
from server.formats.laser import SENSOR
from server.messages import Ranges
from slam.laser_scan import LaserParams

LONG = 3.0  # s of silence that people are told of
SILENCE = 1.0  # s without a sweep after which it is asked, and asked again
PARTICULARS = b"QT\nSCIP2.0\nPP\n"  # whatever it does, it is to end it; an old one is told to speak 2.0
TOLERANCE = 1e-3  # degrees


class LaserLine:
    """One laser: `receive` gives its sweeps, `requests` what is to be said to it now."""

    name = "laser"  # of its sweeps among the session's frames

    def __init__(self, laser: LaserParams):
        self.laser = laser
        self.decoder = scip.Decoder()
        self.stamps = scip.Stamps()
        self.heard = self.asked = -math.inf  # when a sweep came last, and when it was last asked for something
        self.steps: tuple[int, int] | None = None  # that it is to tell of, as soon as somebody asks
        self.fault = ""
        self.begun = math.inf  # when somebody first waited for it
        self.refused: Counter[str] = Counter()

    def receive(self, data: bytes, t: float) -> list[Ranges]:
        """The sweeps that the bytes complete; those of other beams than the robot's are counted and passed over."""
        sweeps = []
        for said in self.decoder.feed(data):
            if isinstance(said, scip.Answer):
                self.learn(said)
            elif len(said.ranges) != self.laser.beams:
                self.refused["beams"] += 1
            else:
                self.heard, self.fault = t, ""
                sweeps.append(Ranges(self.stamps.to_host(said.time_ms, t), SENSOR, said.ranges))
        return sweeps

    def learn(self, answer: scip.Answer) -> None:
        """Take its particulars up, if that is what it answers with."""
        if answer.request.startswith("MD") and answer.status != "00":
            self.fault = f"the laser refuses to sweep (status {answer.status}): see its manual"
        if not answer.request.startswith("PP"):
            return
        try:
            found, self.steps = scip.laser_of(answer), scip.steps_of(answer)
        except ValueError as error:
            self.refused["particulars"] += 1
            self.fault = str(error)
            return
        ours = self.laser
        apart = max(abs(found.first_deg - ours.first_deg), abs(found.step_deg - ours.step_deg))
        if found.beams != ours.beams or apart > TOLERANCE:
            self.steps = None
            self.fault = (
                f"the laser has {found.beams} beams from {found.first_deg:.4f} on every {found.step_deg:.6f} degrees; "
                "say so in maze_runner.laser: beams, first_deg, step_deg"
            )

    @property
    def rejected(self) -> int:
        """What it said that could not be read."""
        return self.decoder.rejected.total()

    def requests(self, t: float) -> bytes:
        """What is to be said to it at time t; mostly nothing."""
        if t - self.heard < SILENCE:
            self.steps = None
            return b""
        self.begun = min(self.begun, t)
        if t - max(self.heard, self.begun) > LONG and not self.fault:
            self.fault = "the laser says nothing: is it the right line, and is it switched on?"
        if self.steps is not None:
            request, self.steps = scip.start(*self.steps), None
        elif t - self.asked >= SILENCE:
            request = PARTICULARS
        else:
            return b""
        self.asked = t
        return request
