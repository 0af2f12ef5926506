"""The real boards over each bad radio for a short while: they stand, obey only what was sent, and the host sees true.

The bench does it for ten minutes; here faults come every 12 s.
"""

from __future__ import annotations

import math
import struct

import pytest

from bench import radio
from bench.board_watch import BoardWatch, Sent
from firmware.virtual import Radio
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
    watch.sent[number] = Sent(watch.sent[number].wish, drive.robot.time - 1.5)
    poke(watch, "supervisor.wish.speed", speed)
    watch.judge(watch.sent[number])  # the right wish, too old
    assert watch.wrong == 3
    assert not watch.has_fallen
    poke(watch, "supervisor.state", 2)
    watch.look()
    assert watch.has_fallen
