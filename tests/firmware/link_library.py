"""The link's C, compiled for this machine and bound by cffi's ABI mode."""

import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cffi

from firmware.virtual.native import flags

LINK = Path(__file__).parents[2] / "firmware" / "link"
SOURCES = [LINK / name for name in ("crc.c", "cobs.c", "frame.c")]
FLAGS = ["-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-ffp-contract=off"]

DECLARATIONS = """
uint16_t crc16_update(uint16_t crc, uint8_t byte);
uint32_t crc32_of(const uint8_t *bytes, uint8_t size);
uint8_t cobs_encode(uint8_t *out, const uint8_t *packet, uint8_t size);
bool cobs_decode(uint8_t *out, uint8_t *written, const uint8_t *stuffed, uint8_t size);
struct frame { uint8_t source, channel, sequence, size; uint16_t time_ms; uint8_t payload[24]; };
struct frame_decoder { uint8_t pending[31]; uint8_t size; bool overflowed; uint16_t rejected; };
uint8_t frame_encode(uint8_t *out, uint8_t source, uint8_t channel, uint8_t sequence, uint16_t time_ms,
                     const void *payload, uint8_t size);
void frame_decoder_init(struct frame_decoder *decoder);
bool frame_decoder_feed(struct frame_decoder *decoder, uint8_t byte, struct frame *out);
"""


@cache
def link_library() -> tuple[cffi.FFI, Any]:
    """(ffi, library); loaded once, and its file is gone as soon as it is mapped."""
    ffi = cffi.FFI()
    ffi.cdef(DECLARATIONS)
    with TemporaryDirectory() as directory:
        library = Path(directory) / "liblink.so"
        subprocess.run(["cc", *FLAGS, *flags(), "-o", library, *SOURCES], check=True)
        return ffi, ffi.dlopen(str(library))
