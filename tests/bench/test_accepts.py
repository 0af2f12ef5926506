"""The harm done to frames is of its kind, and what is counted as taken for good is neither everything nor nothing."""

import math
from collections import Counter

import numpy as np
import pytest

from bench import accepts
from bench.benchmark import Row
from bench.corruption import KINDS, burst, flip_bits, line_of, lose_bytes, pieces_of, splice
from server.channels import ADJUST_COMMAND, DRIVE, SENSOR, VERBS, addressee, encode_command
from server.commands import AdjustCommand, ArmCommand
from server.link import DELIMITER, Decoder, encode

RNG = np.random.default_rng(1)
FRAMES = accepts.telemetry(1)[:2000]
SENT = {frame[:-1] for frame in FRAMES}


def changed_bits(octets: np.ndarray) -> list[np.ndarray]:
    """Where each frame's bits differ from what was sent."""
    line = line_of(FRAMES)
    return [
        np.flatnonzero(bits)
        for bits in np.split(np.unpackbits(np.bitwise_xor(octets, line.octets)), 8 * line.starts[1:])
    ]


def test_flipped_bits_are_as_many_as_named():
    flips = np.array([bits.size for bits in changed_bits(flip_bits(line_of(FRAMES), RNG, 0.01))])
    expected = 1.0 + 0.01 * (8 * line_of(FRAMES).sizes.mean() - 1.0)
    assert flips.mean() == pytest.approx(expected, rel=0.1)
    assert np.mean(flips > 0) > 0.99  # a bit drawn twice is as it was


def test_a_burst_is_short_and_hits_every_frame():
    for bits in changed_bits(burst(line_of(FRAMES), RNG)):
        assert bits.size >= 2
        assert bits[-1] - bits[0] < 40  # 32 bits in a row touch at most five bytes, whose bits run the other way


def test_bytes_are_lost_and_nothing_else_changes():
    line = line_of([bytes(range(10, 30)) + DELIMITER])
    for _ in range(200):
        left = lose_bytes(line, RNG).tobytes()
        missing = 21 - len(left)
        assert 1 <= missing <= 8
        sent = line.octets.tobytes()
        assert any(left == sent[:i] + sent[i + missing :] for i in range(21))


def test_a_splice_is_a_head_and_a_tail():
    line = line_of([b"abcdefgh" + DELIMITER, b"ABCDEFGHIJ" + DELIMITER])
    for _ in range(200):
        piece = splice(line, RNG).tobytes()
        head = piece.rstrip(b"ABCDEFGHIJ\0")
        assert head
        assert b"abcdefgh\0".startswith(head)
        assert (b"ABCDEFGHIJ" + DELIMITER).endswith(piece[len(head) :])


def test_what_was_sent_is_no_corruption():
    assert pieces_of(line_of(FRAMES).octets, SENT) == []


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_corrupted_is_obeyed_and_little_believed(kind, monkeypatch):
    monkeypatch.setattr(accepts, "PIECES", 20_000)
    found = accepts.run(kind, 1)
    assert min(found["telemetry"], found["commands"]) >= 20_000
    assert found["obeyed"] == found["adjusted"] == 0
    assert found["believed"] <= found["telemetry_crc"] < 20  # one in 65,536 is expected


def test_what_is_whole_is_obeyed_and_believed():
    boards = accepts.Boards(1)
    given = [accepts.command_of(RNG) for _ in range(5000)]
    moving = [command for command in given if not isinstance(command, AdjustCommand)]
    asked = [command for command in given if isinstance(command, AdjustCommand) and command.verb == "ask"]
    assert boards.hear(encoded(moving, boards)) == (len(moving), len(moving), 0)
    assert boards.hear(encoded(asked, boards)) == (len(asked), 0, len(asked))
    assert {command.board for command in asked} == {"drive", "sensor"}
    pieces = [frame[:-1] for frame in FRAMES]
    assert accepts.heard(iter([pieces])) == {"telemetry": 2000, "telemetry_crc": 2000, "believed": 2000}


def encoded(given, boards):
    """Commands that are fresh, without their delimiters."""
    echoes = [boards.now_ms[addressee(command)] for command in given]
    return [encode(encode_command(command, 0, echo))[:-1] for command, echo in zip(given, echoes, strict=True)]


@pytest.mark.parametrize("board", ["drive", "sensor"])
@pytest.mark.parametrize("verb", VERBS)
def test_an_adjustment_that_is_done_is_counted_answered_or_not(verb, board):
    boards = accepts.Boards(1)
    boards.hear(encoded([ArmCommand(False)], boards))  # so that it may learn the gyro's zero
    before = boards.adjusted()
    assert boards.hear(encoded([AdjustCommand(board, verb, "sonar_ms", 400.0)], boards)) == (1, 0, 1)
    is_silent = verb == "store" or (verb, board) == ("zero gyro", "drive")  # until it is done
    assert (boards.adjusted() != before) == (is_silent or verb == "set")


def test_half_of_what_is_harmed_are_adjustments_of_both_boards():
    boards = accepts.Boards(1)
    frames = Decoder().feed(b"".join(accepts.commands(RNG, boards.now_ms)))
    adjustments = Counter(frame.payload[0] for frame in frames if frame.channel == ADJUST_COMMAND)
    assert set(adjustments) == {DRIVE, SENSOR}
    for count in adjustments.values():
        assert count / len(frames) == pytest.approx(0.25, abs=4.0 * math.sqrt(0.25 * 0.75 / len(frames)))
    crc, obeyed, adjusted = boards.hear([encode(frame)[:-1] for frame in frames])
    assert crc == len(frames)
    assert obeyed == len(frames) - sum(adjustments.values())
    assert 0.5 * sum(adjustments.values()) < adjusted <= sum(adjustments.values())  # to store is answered later


def test_the_verdict_counts_what_was_taken():
    clean = {"obeyed": 0, "adjusted": 0}
    assert not list(accepts.verdict([Row("fine", [clean])]))
    assert list(accepts.verdict([Row("a", [clean, {"obeyed": 2, "adjusted": 3}])])) == [
        "a: 2 corrupted commands were obeyed",
        "a: 3 corrupted adjustments were done or answered",
    ]


def test_a_right_crc16_alone_moves_nothing():
    boards = accepts.Boards(2)
    forged = []
    for data in accepts.commands(RNG, boards.now_ms)[:5000]:
        [frame] = Decoder().feed(data)
        payload = bytearray(frame.payload)
        for bit in RNG.integers(0, 8 * len(payload), 1 + RNG.poisson(1.0)):
            payload[bit // 8] ^= 1 << bit % 8
        if bytes(payload) != frame.payload:
            forged.append(encode(frame._replace(payload=bytes(payload)))[:-1])
    assert len(forged) > 4900
    assert boards.hear(forged) == (len(forged), 0, 0)
