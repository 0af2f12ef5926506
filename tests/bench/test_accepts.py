"""The harm done to frames is of its kind, and what is counted as taken for good is neither everything nor nothing."""

import numpy as np
import pytest

from bench import accepts
from bench.corruption import KINDS, burst, flip_bits, line_of, lose_bytes, pieces_of, splice
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
    assert found["obeyed"] == 0
    assert found["believed"] <= found["telemetry_crc"] < 20  # one in 65,536 is expected


def test_what_is_whole_is_obeyed_and_believed():
    board = accepts.Board(1)
    whole = [frame[:-1] for frame in accepts.commands(RNG, board.now_ms)]
    assert board.hear(whole) == (len(whole), len(whole))
    pieces = [frame[:-1] for frame in FRAMES]
    assert accepts.heard(iter([pieces])) == {"telemetry": 2000, "telemetry_crc": 2000, "believed": 2000}


def test_a_right_crc16_alone_moves_nothing():
    board = accepts.Board(2)
    forged = []
    for data in accepts.commands(RNG, board.now_ms)[:5000]:
        [frame] = Decoder().feed(data)
        payload = bytearray(frame.payload)
        for bit in RNG.integers(0, 8 * len(payload), 1 + RNG.poisson(1.0)):
            payload[bit // 8] ^= 1 << bit % 8
        if bytes(payload) != frame.payload:
            forged.append(encode(frame._replace(payload=bytes(payload)))[:-1])
    assert len(forged) > 4900
    assert board.hear(forged) == (len(forged), 0)
