"""The real boards over each bad radio for a short while: they stand, obey only what was sent, and the host sees true.

The bench does it for ten minutes; here faults come every 12 s.
"""

from __future__ import annotations

import math
import struct

import pytest

from bench import radio
from bench.benchmark import Row
from bench.board_watch import BoardWatch
from firmware.virtual import Radio
from server.commands import StopCommand
from tests.firmware.avr_tools import need_simavr

MINUTES = 0.25
DRIVE_COMMAND_BYTES = 18
LATE = "1.2 s late once it stands"


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    """Faults and settled clocks come soon."""
    need_simavr()
    monkeypatch.setattr(radio, "SETTLED", 5.0)
    for name, second in (("FAULT_PERIOD", 12), ("FAULT_BEGIN", 4), ("FAULT_END", 7)):
        monkeypatch.setattr(radio, name, second)


def arriving(bad: Radio, replays: int) -> float:
    """How many of so many commands come through the radio whole, at the least: four deviations below the mean."""
    share = (1.0 - bad.chunk_loss) * (1.0 - bad.bit_error_rate) ** (8 * DRIVE_COMMAND_BYTES)
    return replays * share - 4.0 * math.sqrt(replays * share * (1.0 - share))


@pytest.mark.parametrize("case", radio.CASES)
def test_it_stands_obeys_what_was_sent_and_is_known(case):
    found = radio.run(case, 3, MINUTES)
    assert found["stood"]
    assert found["lean"] < 15.0
    assert found["wrong"] == 0
    assert found["false"] == 0
    assert found["collisions"] == 0
    assert found["replays"] > 10
    assert found["refused"] >= arriving(radio.CASES[case].radio, found["replays"] - 2)  # two may be under way still
    if case == LATE:
        assert found["obeyed"] <= 3  # but for stops
    else:
        assert found["obeyed"] > 0.4 * found["commands"]
        assert found["oldest"] < 1000.0
    assert found["heard"] > 40.0
    assert found["clock_worst"] < 150.0
    if "silent" in case or "reset" in case:
        assert found["back"] < 0.5


def poke(watch: BoardWatch, name: str, value: float) -> None:
    """Another value in the running board's memory."""
    address, code = watch.memory.places[name]
    for i, byte in enumerate(struct.pack(code, value)):
        watch.robot.lib.microcontroller_poke(watch.robot.robot.drive, address + i, byte)


def test_a_watch_finds_what_was_never_sent_or_long_ago():
    drive = radio.Drive(radio.CASES["good"], 1)
    drive.arm()
    drive.drive(2.0)
    watch = drive.watch
    assert watch.obeyed > 10
    assert watch.wrong == 0
    number, speed = watch.heard[0], watch.read("supervisor.wish.speed")
    steps = (
        ("supervisor.acknowledged", 200),  # nobody sent that
        ("supervisor.wish.speed", 0.123),
        ("supervisor.acknowledged", number),  # the right number with another wish
    )
    for wrong, (name, value) in zip((1, 1, 2), steps, strict=True):
        poke(watch, name, value)
        watch.look()  # sees it
        watch.look()  # and judges it
        assert watch.wrong == wrong
    poke(watch, "supervisor.wish.speed", speed)
    age = watch.oldest
    assert 0.0 < age < 1.0
    watch.judge(watch.sent[number]._replace(time=drive.robot.time - 1.5))  # the right wish, too old
    assert watch.wrong == 3
    assert watch.oldest > age
    assert watch.old_stops == 0
    assert not watch.has_fallen
    poke(watch, "supervisor.state", 2)
    watch.look()
    assert watch.has_fallen


def test_a_stop_is_obeyed_however_old_and_counted_by_itself():
    drive = radio.Drive(radio.CASES["good"], 1)
    drive.arm()
    drive.motion = StopCommand()
    for _ in range(10):
        drive.say(drive.motion)
        drive.live(0.1)
    watch = drive.watch
    stop = watch.sent[watch.heard[0]]
    assert stop.is_stop
    assert (watch.wrong, watch.old_stops, watch.oldest) == (0, 0, 0.0)
    late = stop._replace(time=drive.robot.time - 1.5)
    watch.judge(late)
    assert (watch.wrong, watch.old_stops, watch.oldest) == (0, 1, 0.0)
    watch.judge(late._replace(is_stop=False))  # to drive at no speed
    assert (watch.wrong, watch.old_stops) == (1, 1)
    poke(watch, "supervisor.wish.speed", 0.123)
    watch.judge(late)  # and the board goes on
    assert (watch.wrong, watch.old_stops) == (2, 1)


def test_a_late_radio_lets_stops_through_and_nothing_else(monkeypatch):
    monkeypatch.setattr(radio, "STOPS", 1.0)
    found = radio.run(LATE, 3, 0.1)
    assert found["old_stops"] > 10
    assert found["wrong"] == 0
    assert found["oldest"] < 1000.0


def test_the_verdict_names_what_no_robot_may_do():
    good = {"stood": True, "wrong": 0, "collisions": 0}
    bad = [good | change for change in ({}, {"stood": False}, {"wrong": 2}, {"collisions": 3})]
    assert not list(radio.verdict([Row("fine", [good])]))
    assert list(radio.verdict([Row("a", bad), Row("fine", [good])])) == [
        "a: a robot fell", "a: 2 commands were obeyed wrongly", "a: 3 bytes of the two boards overlapped",
    ]  # fmt: skip


SOUND = {"stood": True, "wrong": 0, "collisions": 0, "obeyed": 900, "back": 0.06}


@pytest.mark.parametrize("harm", [{"stood": False}, {"wrong": 1}, {"collisions": 2}, {"obeyed": 0}, {"back": math.inf}])
def test_the_verdict_tells_each_harm_once(harm):
    assert not list(radio.verdict([Row("good", [SOUND, {**SOUND, "back": None}])]))
    assert len(list(radio.verdict([Row("bad", [SOUND, {**SOUND, **harm}])]))) == 1
