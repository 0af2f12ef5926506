import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from server import channels
from server.link import MAX_ENCODED, MAX_PAYLOAD, Decoder, Frame, encode

FRAMES = st.builds(
    Frame,
    st.integers(0, 3),
    st.integers(0, 63),
    st.integers(0, 255),
    st.integers(0, 65535),
    st.binary(max_size=MAX_PAYLOAD),
)


def some_frames(n, seed):
    rng = random.Random(seed)
    return [
        Frame(rng.randrange(4), rng.randrange(64), i % 256, i * 20 % 65536, rng.randbytes(rng.randrange(25)))
        for i in range(n)
    ]


def test_the_bytes_of_a_frame():
    frame = Frame(source=1, channel=2, sequence=3, time_ms=0x0405, payload=b"ab\0c")
    assert encode(frame) == b"\x07B\x03\x05\x04ab\x04c\xdc\xe7\x00"


@given(FRAMES)
def test_a_frame_comes_back_as_it_went_and_costs_eight_bytes(frame):
    data = encode(frame)
    assert Decoder().feed(data) == [frame]
    assert len(data) == len(frame.payload) + 8 <= MAX_ENCODED
    assert data.index(0) == len(data) - 1


@pytest.mark.parametrize(
    "frame",
    [
        Frame(4, 0, 0, 0, b""),
        Frame(0, 64, 0, 0, b""),
        Frame(0, 0, 256, 0, b""),
        Frame(0, 0, 0, 65536, b""),
        Frame(0, 0, 0, 0, bytes(MAX_PAYLOAD + 1)),
    ],
)
def test_what_does_not_fit_a_frame_is_a_mistake(frame):
    with pytest.raises(ValueError, match="does not fit a frame"):
        encode(frame)


@given(st.lists(FRAMES, max_size=8), st.lists(st.integers(1, 40), max_size=40))
def test_any_slicing_gives_the_same_frames(frames, sizes):
    stream = b"".join(map(encode, frames))
    decoder, heard, at = Decoder(), [], 0
    for size in [*sizes, len(stream)]:
        heard += decoder.feed(stream[at : at + size])
        at += size
    assert heard == frames
    assert decoder.rejected == 0


@given(st.binary(max_size=200), st.lists(st.integers(1, 60), max_size=20))
def test_any_slicing_of_noise_gives_the_same_counts(noise, sizes):
    whole, sliced, at = Decoder(), Decoder(), 0
    expected = whole.feed(noise)
    heard = []
    for size in [*sizes, len(noise)]:
        heard += sliced.feed(noise[at : at + size])
        at += size
    assert (heard, sliced.rejected, sliced.pending) == (expected, whole.rejected, whole.pending)


def test_a_good_stream_cut_at_every_offset_loses_one_frame_at_most():
    frames = some_frames(12, seed=1)
    stream = b"".join(map(encode, frames))
    for cut in range(len(stream) + 1):
        decoder = Decoder()
        before, after = decoder.feed(stream[:cut]), Decoder().feed(stream[cut:])
        assert before + decoder.feed(stream[cut:]) == frames
        assert before == frames[: len(before)]
        assert after == frames[len(frames) - len(after) :]
        assert len(before) + len(after) >= len(frames) - 1


def test_a_frame_is_delivered_with_its_last_byte():
    decoder = Decoder()
    for frame in some_frames(50, seed=2):
        *most, last = encode(frame)
        assert [heard for byte in most for heard in decoder.feed(bytes((byte,)))] == []
        assert decoder.feed(bytes((last,))) == [frame]


@pytest.mark.parametrize("seed", range(200))
def test_after_noise_the_first_frame_may_be_lost_and_the_second_is_not(seed):
    rng = random.Random(seed)
    decoder = Decoder()
    decoder.feed(rng.randbytes(rng.randrange(1, 300)))
    first, second = some_frames(2, seed)
    heard = decoder.feed(encode(first))
    assert heard in ([], [first])
    assert decoder.feed(encode(second)) == [second]


def test_a_corrupted_byte_costs_the_frames_it_touches_and_no_other():
    frames = some_frames(5, seed=3)
    pieces = [encode(frame) for frame in frames]
    stream = b"".join(pieces)
    for at in range(len(stream)):
        for bit in range(8):
            broken = stream[:at] + bytes((stream[at] ^ 1 << bit,)) + stream[at + 1 :]
            heard = Decoder().feed(broken + b"\0")
            assert set(heard) <= set(frames)
            assert len(heard) >= 3  # a broken delimiter takes both its neighbours


def test_a_million_bytes_of_noise():
    rng = random.Random(4)
    decoder = Decoder()
    passed = believed = 0
    for _ in range(1000):
        for frame in decoder.feed(rng.randbytes(1000)):
            passed += 1
            try:
                channels.read(frame)
            except channels.Refused:
                continue
            believed += 1
        assert len(decoder.pending) <= MAX_ENCODED
    # Noise has a delimiter every 256 bytes, so 3906 pieces; COBS and the length leave some 400 for the checksum.
    assert 3500 < decoder.rejected + passed < 4300
    assert passed <= 1
    assert believed == 0


def test_noise_without_a_delimiter_does_not_grow_the_buffer():
    decoder = Decoder()
    for _ in range(100):
        assert decoder.feed(b"\x55" * 10_000) == []
        assert len(decoder.pending) <= MAX_ENCODED
    frame = Frame(1, 2, 3, 4, b"good")
    assert decoder.feed(b"\0" + encode(frame)) == [frame]
    assert decoder.rejected == 1


def test_idle_delimiters_are_no_errors():
    decoder = Decoder()
    assert decoder.feed(bytes(1000)) == []
    assert decoder.rejected == 0
