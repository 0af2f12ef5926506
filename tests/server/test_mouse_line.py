"""A mouse's line: packets in any slicing, after noise and lost bytes, and what overflows and silences are taken for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware.virtual.mice import packet
from server.mouse_line import SILENCE, Decoder, MouseLine

COUNTS = st.tuples(st.integers(-127, 127), st.integers(-127, 127))


@given(st.lists(COUNTS, max_size=30), st.integers(1, 7), st.integers(0, 7))
def test_packets_come_back_in_any_slicing_whatever_buttons_are_held(counts, size, buttons):
    data = b"".join(bytes([packet(*each)[0] | buttons]) + packet(*each)[1:] for each in counts)
    decoder = Decoder()
    found = [decoder.feed(data[at : at + size]) for at in range(0, len(data), size)]
    assert sum(each.x for each in found) == sum(x for x, _ in counts)
    assert sum(each.y for each in found) == sum(y for _, y in counts)
    assert sum(each.packets for each in found) == len(counts)
    assert not any(each.skipped or each.unsound for each in found)


@given(COUNTS)
def test_a_packet_is_told_with_its_last_byte(counts):
    decoder = Decoder()
    assert [decoder.feed(bytes([byte])).packets for byte in packet(*counts)] == [0, 0, 1]


@given(st.lists(st.binary(max_size=40), max_size=20), COUNTS)
def test_noise_never_raises_and_every_byte_of_it_is_accounted_for(pieces, counts):
    decoder = Decoder()
    found = [decoder.feed(piece) for piece in pieces]
    known = sum(each.skipped + 3 * (each.packets + each.unsound) for each in found) + len(decoder.pending)
    assert known == sum(map(len, pieces))
    assert len(decoder.pending) < 3
    line = MouseLine(0)
    for piece in pieces:
        line.receive(piece, 1.0)
    [told] = line.receive(packet(*counts), 1.0 + 2.0 * SILENCE)
    assert (told.x, told.y) == counts, "no noise reaches over a silence"


@pytest.mark.parametrize("seed", range(20))
def test_after_a_lost_byte_a_moving_mouse_is_soon_understood_again(seed):
    rng = np.random.default_rng(seed)
    counts = np.round(rng.normal((40.0, -10.0), 8.0, (200, 2))).astype(int).clip(-127, 127)
    packets = [packet(int(x), int(y)) for x, y in counts]
    decoder, lost = Decoder(), int(rng.integers(3))
    found = [decoder.feed(packets[0][:lost] + packets[0][lost + 1 :])] + [decoder.feed(each) for each in packets[1:]]
    wrong = [
        number
        for number, (each, told) in enumerate(zip(found, counts, strict=True))
        if (each.x, each.y) != tuple(told) and number > 0
    ]
    assert len(wrong) <= 6
    assert sum(each.skipped for each in found) == 2


def test_a_packet_with_an_overflow_is_counted_and_not_believed():
    line = MouseLine(3)
    [told] = line.receive(packet(5, 6) + bytes([0x48, 200, 3]) + packet(-7, 8), 1.0)
    assert (told.mouse, told.x, told.y, told.is_whole) == (3, -2, 14, False)
    assert line.refused["unsound"] == 1
    assert line.rejected == 0
    [told] = line.receive(packet(1, 1), 1.01)
    assert told.is_whole


def test_overflows_without_end_are_a_beginning_sought_at_the_wrong_place():
    decoder = Decoder()
    data = (packet(-8, 0) * 20)[1:]  # bytes of -8 look like the first of an overflow
    assert decoder.feed(data).packets >= 17


def test_a_packet_that_never_ended_is_forgotten_and_the_counts_are_told_not_to_be_whole():
    line = MouseLine(0)
    assert line.receive(packet(100, 100)[:2], 1.0) == []
    [told] = line.receive(packet(3, 4), 1.0 + 2.0 * SILENCE)
    assert (told.x, told.y, told.is_whole) == (3, 4, False)
    assert line.rejected == 2


def test_nothing_is_ever_said_to_a_mouse():
    assert MouseLine(0).requests(5.0) == b""
