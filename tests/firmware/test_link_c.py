"""The link in C and in Python judge each other, and the borrowed primitives judge both."""

import random
import shutil
import subprocess
import zlib
from typing import Any

import pytest
from cobs import cobs
from fastcrc import crc16
from hypothesis import given
from hypothesis import strategies as st

from server import link
from tests.firmware.link_library import FLAGS, LINK, SOURCES, link_library
from tests.tools import miss

FFI, C = link_library()
FRAMES = st.builds(
    link.Frame,
    st.integers(0, 3),
    st.integers(0, 63),
    st.integers(0, 255),
    st.integers(0, 65535),
    st.binary(max_size=link.MAX_PAYLOAD),
)


class CDecoder:
    """The C decoder with the Python one's face."""

    def __init__(self):
        self.state: Any = FFI.new("struct frame_decoder *")
        self.out: Any = FFI.new("struct frame *")
        C.frame_decoder_init(self.state)

    @property
    def rejected(self):
        return self.state.rejected

    def feed(self, data):
        return [self.frame() for byte in data if C.frame_decoder_feed(self.state, byte, self.out)]

    def frame(self):
        out = self.out
        payload = bytes(FFI.buffer(out.payload, out.size))
        return link.Frame(out.source, out.channel, out.sequence, out.time_ms, payload)


def c_encode(frame):
    out = FFI.new("uint8_t[]", link.MAX_ENCODED)
    return bytes(FFI.buffer(out, C.frame_encode(out, *frame, len(frame.payload))))


@given(st.binary(max_size=255))
def test_checksums_are_the_published_ones(data):
    crc = 0xFFFF
    for byte in data:
        crc = C.crc16_update(crc, byte)
    assert crc == crc16.mcrf4xx(data)
    assert C.crc32_of(data, len(data)) == zlib.crc32(data)


@given(st.binary(max_size=253))
def test_stuffing_equals_the_library_s(packet):
    out = FFI.new("uint8_t[]", 254)
    assert bytes(FFI.buffer(out, C.cobs_encode(out, packet, len(packet)))) == cobs.encode(packet)


@given(st.binary(max_size=255))
def test_unstuffing_accepts_and_refuses_what_the_library_does(stuffed):
    out, written = FFI.new("uint8_t[]", 255), FFI.new("uint8_t *")
    is_good = C.cobs_decode(out, written, stuffed, len(stuffed))
    try:
        expected = cobs.decode(stuffed)
    except cobs.DecodeError:
        assert not is_good
    else:
        assert is_good
        assert bytes(FFI.buffer(out, written[0])) == expected


@given(FRAMES)
def test_both_encoders_write_the_same_bytes_and_both_decoders_read_them(frame):
    data = link.encode(frame)
    assert c_encode(frame) == data
    assert CDecoder().feed(data) == [frame] == link.Decoder().feed(data)


def test_the_c_encoder_refuses_what_does_not_fit():
    out = FFI.new("uint8_t[]", link.MAX_ENCODED)
    payload = bytes(link.MAX_PAYLOAD + 1)
    assert C.frame_encode(out, 1, 2, 3, 4, payload, len(payload)) == 0
    assert C.frame_encode(out, 4, 2, 3, 4, payload, 0) == 0
    assert C.frame_encode(out, 1, 64, 3, 4, payload, 0) == 0


@given(st.lists(st.one_of(FRAMES.map(link.encode), st.binary(max_size=80), st.just(b"\0")), max_size=12))
def test_both_decoders_agree_on_any_stream(pieces):
    stream = b"".join(pieces)
    in_c, in_python = CDecoder(), link.Decoder()
    assert in_c.feed(stream) == in_python.feed(stream)
    assert in_c.rejected == in_python.rejected


def test_both_decoders_agree_on_corrupted_streams():
    rng = random.Random(5)
    frames = [link.Frame(i % 3, i % 19, i % 256, i * 7 % 65536, rng.randbytes(i % 25)) for i in range(2000)]
    stream = bytearray(b"".join(map(link.encode, frames)))
    for _ in range(1000):
        stream[rng.randrange(len(stream))] ^= 1 << rng.randrange(8)
    in_c, in_python = CDecoder(), link.Decoder()
    survivors = in_python.feed(bytes(stream))
    assert in_c.feed(stream) == survivors
    assert in_c.rejected == in_python.rejected > 500
    assert set(survivors) <= set(frames)


def test_the_count_of_rejects_stays_at_its_maximum():
    decoder = CDecoder()
    decoder.feed(b"\x05\0" * 70_000)
    assert decoder.rejected == 0xFFFF


@pytest.mark.parametrize("optimisation", ["-Os", "-O2"])
def test_the_link_compiles_for_the_board(tmp_path, optimisation):
    if shutil.which("avr-gcc") is None:
        miss("avr-gcc is not installed (apt-get install gcc-avr avr-libc)")
    for source in SOURCES:
        flags = [*FLAGS, optimisation, "-mmcu=atmega32"]
        subprocess.run(["avr-gcc", *flags, "-c", source, "-o", tmp_path / f"{source.stem}.o"], check=True)


HARNESS = """
#include "frame.h"
#include <stdio.h>
int main(void)
{
    struct frame_decoder decoder;
    struct frame frame;
    uint8_t out[LINK_MAX_ENCODED];
    long good = 0;
    frame_decoder_init(&decoder);
    for (int byte; (byte = getchar()) != EOF;)
        if (frame_decoder_feed(&decoder, (uint8_t)byte, &frame)) {
            good++;
            if (frame_encode(out, frame.source, frame.channel, 0, frame.time_ms, frame.payload, frame.size) == 0)
                return 2;
        }
    printf("%ld", good);
    return 0;
}
"""


def test_noise_breaks_no_rule_of_c(tmp_path):
    source, program = tmp_path / "harness.c", tmp_path / "harness"
    source.write_text(HARNESS)
    sanitizers = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    build = [*FLAGS, *sanitizers, f"-I{LINK}", "-o", program, source, *SOURCES]
    if subprocess.run(["cc", *build], capture_output=True).returncode != 0:
        miss("this compiler has no sanitizers")
    rng = random.Random(6)
    frames = [link.encode(link.Frame(1, i % 64, i % 256, i, rng.randbytes(i % 25))) for i in range(1000)]
    noise = b"".join(frame + b"\0" + rng.randbytes(rng.randrange(100)) + b"\0" for frame in frames)
    done = subprocess.run([program], input=noise, capture_output=True, check=True)
    assert int(done.stdout) >= 1000


def test_every_header_of_the_link_stands_alone(tmp_path):
    for header in LINK.glob("*.h"):
        source = tmp_path / f"{header.stem}.c"
        source.write_text(f'#include "{header}"\nint nothing(void);\n')
        subprocess.run(["cc", *FLAGS, "-fsyntax-only", source], check=True)
