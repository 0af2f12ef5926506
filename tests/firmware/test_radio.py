"""The radio's statistics: rate, order, delay, loss and flipped bits, and the same again for the same seed."""

import numpy as np
import pytest

from firmware.virtual.radio import Air, Radio

DOWN, UP = 0, 1


def run(radio, seed=1, seconds=60.0, down=b"", up=b"", beat=0.02):
    """Bytes that arrived down and up when `down` and `up` are handed over each beat, and the air."""
    air = Air(radio, seed)
    arrived = [bytearray(), bytearray()]
    for i in range(round(seconds / beat)):
        air.put(DOWN, down)
        air.put(UP, up)
        air.run(i * beat, (i + 1) * beat)
        for direction in (DOWN, UP):
            arrived[direction] += air.directions[direction].arrived((i + 1) * beat)
    return arrived[DOWN], arrived[UP], air


def test_a_good_radio_keeps_every_byte_in_order():
    data = bytes(range(30))
    down, up, _ = run(Radio(latency=0.01), down=data, up=b"ab")
    assert bytes(down) == (data * 3000)[: len(down)]
    assert len(down) > 30 * 2990
    assert bytes(up) == (b"ab" * 3000)[: len(up)]


def test_nothing_comes_before_its_time():
    air = Air(Radio(latency=0.05), 1)
    air.put(DOWN, bytes(64))
    air.run(0.0, 0.02)
    takes = 64 * 10 / 38400 + 0.05
    assert air.directions[DOWN].arrived(takes - 0.001) == b""
    assert len(air.directions[DOWN].arrived(takes + 0.001)) == 64


def test_both_ways_share_the_line():
    down, up, _ = run(Radio(turnaround=0.0), down=bytes(100), up=bytes(100))  # 10,000 B/s wanted
    assert (len(down) + len(up)) / 60.0 == pytest.approx(3840, rel=0.03)
    assert len(down) == pytest.approx(len(up), rel=0.05)


def test_lost_chunks_are_as_many_as_named():
    _, _, air = run(Radio(chunk_loss=0.1), seconds=120.0, down=bytes(34))
    one = air.directions[DOWN]
    assert one.lost / one.sent == pytest.approx(0.1, abs=4 * np.sqrt(0.09 / one.sent))


def test_flipped_bits_are_as_many_as_named():
    down, _, _ = run(Radio(bit_error_rate=1e-3), down=bytes(34))
    flipped = np.unpackbits(np.frombuffer(bytes(down), np.uint8)).sum()
    bits = 8 * len(down)
    assert flipped / bits == pytest.approx(1e-3, abs=4 * np.sqrt(1e-3 / bits))


def test_the_same_seed_makes_the_same_noise():
    noisy = Radio(chunk_loss=0.2, bit_error_rate=1e-3)
    first, second, third = (run(noisy, seed, 5.0, bytes(40))[0] for seed in (4, 4, 5))
    assert first == second != third


@pytest.mark.parametrize("values", [{"chunk_loss": 1.5}, {"bit_error_rate": -0.1}, {"latency": -1.0}, {"baud": 0}])
def test_impossible_radios_are_refused(values):
    with pytest.raises(ValueError, match="radio"):
        Radio(**values)
