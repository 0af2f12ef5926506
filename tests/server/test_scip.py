"""SCIP 2.0: what a Hokuyo says is understood in whatever pieces it comes, and damage is counted, never believed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from server.channels import Calibration
from server.laser_line import LaserLine
from server.messages import Ranges
from server.scip import (
    BLOCK,
    LONGEST,
    STAMP_WRAP,
    Answer,
    Decoder,
    Stamps,
    Sweep,
    checksum,
    decoded,
    laser_of,
    start,
    steps_of,
)
from server.session import Session
from slam.laser_scan import LaserParams

PARTICULARS = {
    "MODL": "URG-04LX(Hokuyo Automatic Co., Ltd.)", "DMIN": "20", "DMAX": "5600", "ARES": "1024", "AMIN": "44",
    "AMAX": "725", "AFRT": "384", "SCAN": "600",
}  # fmt: skip


def coded(number: int, characters: int) -> str:
    return "".join(chr((number >> 6 * place & 0x3F) + 0x30) for place in range(characters - 1, -1, -1))


def said(request: str, *lines: str) -> bytes:
    return "\n".join([request, *(line + checksum(line) for line in lines), "", ""]).encode("latin-1")


def told(millimetres: list[int], time_ms: int = 0, first: int = 44) -> bytes:
    """A sweep as a laser says it."""
    data = "".join(coded(value, 3) for value in millimetres)
    blocks = [data[at : at + BLOCK] for at in range(0, len(data), BLOCK)]
    return said(f"MD{first:04d}{first + len(millimetres) - 1:04d}01000", "99", coded(time_ms, 4), *blocks)


def test_the_documents_examples_are_decoded():
    assert decoded("1Dh").tolist() == [5432]  # three characters
    assert decoded("CB", 2).tolist() == [1234]  # two
    assert decoded("m2@0", 4).tolist() == [16000000]  # four
    assert start(44, 725) == b"MD0044072501000\n"
    assert checksum("00") == "P"
    assert checksum("99") == "b"


@settings(max_examples=60)
@given(st.lists(st.integers(0, 5600), min_size=2, max_size=300), st.integers(0, STAMP_WRAP - 1), st.integers(1, 60))
def test_sweeps_are_the_same_in_any_pieces(millimetres, time_ms, size):
    data, decoder, found = told(millimetres, time_ms), Decoder(), []
    for at in range(0, len(data), size):
        found += decoder.feed(data[at : at + size])
    [sweep] = found
    assert isinstance(sweep, Sweep)
    assert (sweep.time_ms, sweep.first) == (time_ms, 44)
    expected = np.array(millimetres, float) / 1000.0
    expected[np.array(millimetres) < 20] = np.nan
    np.testing.assert_allclose(sweep.ranges, expected)
    assert not decoder.rejected


def test_answers_come_with_their_status_and_lines():
    decoder = Decoder()
    lines = [f"{key}:{value};" for key, value in PARTICULARS.items()]
    data = (
        said("BM", "00") + "\n".join(["PP", "00P", *(line + checksum(line[:-1]) for line in lines), "", ""]).encode()
    )  # the check of such a line is of what stands before the semicolon
    begun, particulars = decoder.feed(data)
    assert begun == Answer("BM", "00", ())
    assert isinstance(particulars, Answer)
    laser = laser_of(particulars)
    assert (laser.beams, laser.max_range) == (682, 5.6)
    assert laser.bearings[340] == pytest.approx(0.0)
    assert np.degrees(laser.bearings[[0, -1]]) == pytest.approx([-119.53125, 119.8828125])
    assert steps_of(particulars) == (44, 725)


def test_particulars_that_lack_something_are_told():
    for lines in (
        (),
        ("AMIN:44", "AMAX:725"),
        tuple(f"{key}:{'0' if key == 'ARES' else value}" for key, value in PARTICULARS.items()),
    ):
        with pytest.raises(ValueError, match="cannot be read"):
            laser_of(Answer("PP", "00", lines))


def test_one_wrong_character_is_never_believed():
    rng, millimetres = np.random.default_rng(2), list(range(500, 900, 3))
    good = told(millimetres, 1234)
    expected = np.array(millimetres) / 1000.0
    believed = rejected = 0
    for _ in range(1500):
        data = bytearray(good)
        at = rng.integers(len(data))
        data[at] ^= 1 << rng.integers(7)
        decoder = Decoder()
        for found in decoder.feed(bytes(data) + good):
            if isinstance(found, Sweep):
                believed += not np.array_equal(found.ranges, expected) and found.first == 44
        rejected += sum(decoder.rejected.values())
    assert believed == 0
    assert rejected > 1000


def test_noise_is_survived_and_the_next_sweep_is_read():
    rng, good = np.random.default_rng(3), told([1000] * 100)
    for _ in range(100):
        decoder = Decoder()
        noise = rng.integers(0, 256, rng.integers(1, 400), dtype=np.uint8).tobytes()
        found = list(decoder.feed(noise + b"\n\n" + good))
        assert isinstance(found[-1], Sweep)
        assert sum(isinstance(each, Sweep) for each in found) == 1


def test_what_never_ends_is_thrown_away():
    decoder = Decoder()
    assert list(decoder.feed(b"x" * (LONGEST + 1))) == []
    assert decoder.rejected["endless"] == 1
    assert len(decoder.buffer) == 0
    assert len(list(decoder.feed(b"\n\n" + told([1000] * 3)))) == 1


def test_a_sweep_of_another_length_than_was_asked_for_is_rejected():
    decoder, data = Decoder(), told([1000] * 50).replace(b"MD00440093", b"MD00440094")
    assert list(decoder.feed(data)) == []
    assert decoder.rejected == {"length": 1}


@pytest.mark.parametrize("steps", [(44, 44), (-1, 5), (0, 10000), (5, 4)])
def test_requests_that_no_laser_understands_are_not_made(steps):
    with pytest.raises(ValueError, match="no laser"):
        start(*steps)


class Ear:
    """A robot that keeps what it is told."""

    def __init__(self):
        self.heard = []

    def step(self, message):
        self.heard.append(message)
        return []


def test_a_session_hands_the_robot_sweeps_of_its_laser_and_counts_those_of_another():
    ear = Ear()
    session = Session(ear, Calibration(), lines={"laser": LaserLine(LaserParams(beams=50))})
    data = told([1000] * 50, 100) + told([1000] * 60, 200) + told([2000] * 50, 300)
    for at in range(0, len(data), 7):
        session.receive("laser", data[at : at + 7], 5.0 + 1e-3 * at)
    first, second = ear.heard
    assert all(isinstance(message, Ranges) and message.sensor == "laser" for message in ear.heard)
    assert (first.ranges.tolist(), second.ranges.tolist()) == ([1.0] * 50, [2.0] * 50)
    assert second.t - first.t == pytest.approx(0.2)
    health = session.health(6.0)
    assert (health["frames"], health["refused"], health["rejected"]) == ({"laser": 2}, {"beams": 1}, 0)


def test_stamps_become_the_hosts_time_without_the_lines_jitter():
    rng, stamps, errors = np.random.default_rng(4), Stamps(), []
    for sweep in range(300):
        true = 100.0 + 0.1 * sweep
        time_ms = (STAMP_WRAP - 5000 + 100 * sweep) % STAMP_WRAP
        errors.append(stamps.to_host(time_ms, true + 0.002 + float(rng.exponential(0.005))) - true)
    assert np.abs(np.array(errors[50:]) - 0.002).max() < 0.001


@pytest.mark.parametrize("ppm", [-200.0, 200.0])
def test_a_laser_whose_clock_runs_wrong_is_followed(ppm):
    rng, stamps, errors = np.random.default_rng(5), Stamps(), []
    for sweep in range(36_000):
        true = 0.1 * sweep
        told = round(1e3 * true * (1.0 + 1e-6 * ppm)) % STAMP_WRAP
        errors.append(stamps.to_host(told, true + 0.002 + float(rng.exponential(0.005))) - true)
    assert np.abs(np.array(errors[50:])).max() < 0.012
