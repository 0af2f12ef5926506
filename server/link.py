"""Frames on the wire: COBS, CRC-16/MCRF4XX, and a header of source, channel, sequence and board time.

The layout is told in firmware/link/channels.h and docs/wire.md. Nothing here knows what a payload means. Byte stuffing
and the checksum are borrowed (cobs, fastcrc); firmware/link/frame.c does the same in C, and each is judged by the other
in the tests.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from cobs import cobs
from fastcrc import crc16

SOURCE_SHIFT = 6
CHANNEL_MASK = 0x3F
MAX_PAYLOAD = 24
HEADER = struct.Struct("<BBH")
CHECK = struct.Struct("<H")
MIN_FRAME = HEADER.size + CHECK.size
MAX_STUFFED = MIN_FRAME + MAX_PAYLOAD + 1  # COBS adds one byte
MAX_ENCODED = MAX_STUFFED + 1  # and a zero ends the frame
DELIMITER = b"\0"


class Frame(NamedTuple):
    """One packet of one board: who, which channel, the sender's count and time (16 bits of ms), and the payload."""

    source: int
    channel: int
    sequence: int
    time_ms: int
    payload: bytes


def encode(frame: Frame) -> bytes:
    """The frame's bytes with their delimiter; ValueError if a field does not fit its bits."""
    if not (0 <= frame.source <= 3 and 0 <= frame.channel <= CHANNEL_MASK and len(frame.payload) <= MAX_PAYLOAD):
        raise ValueError(f"source, channel or payload does not fit a frame: {frame}")
    if not (0 <= frame.sequence <= 0xFF and 0 <= frame.time_ms <= 0xFFFF):
        raise ValueError(f"sequence or time does not fit a frame: {frame}")
    body = HEADER.pack(frame.source << SOURCE_SHIFT | frame.channel, frame.sequence, frame.time_ms) + frame.payload
    return cobs.encode(body + CHECK.pack(crc16.mcrf4xx(body))) + DELIMITER


def parse(stuffed: bytes) -> Frame | None:
    """The frame in the bytes between two delimiters, or None if there is none."""
    if len(stuffed) > MAX_STUFFED:
        return None
    try:
        packet = cobs.decode(stuffed)
    except cobs.DecodeError:
        return None
    if len(packet) < MIN_FRAME:
        return None
    body = packet[:-2]
    if crc16.mcrf4xx(body) != packet[-2] | packet[-1] << 8:
        return None
    who, sequence, time_ms = HEADER.unpack_from(body)
    return Frame(who >> SOURCE_SHIFT, who & CHANNEL_MASK, sequence, time_ms, body[HEADER.size :])


class Decoder:
    """Turns any slicing of the byte stream into the same frames.

    A frame is handed out as soon as its delimiter has come; whatever was wrong before a delimiter is over after it.
    `rejected` counts the pieces between delimiters that were no frame.
    """

    def __init__(self) -> None:
        self.pending = b""
        self.rejected = 0

    def feed(self, data: bytes) -> list[Frame]:
        """The good frames that these bytes complete, in order."""
        *pieces, rest = (self.pending + data).split(DELIMITER)
        self.pending = rest[: MAX_STUFFED + 1]  # noise cannot grow the buffer, and one byte too long stays too long
        frames = []
        for piece in pieces:
            if not piece:
                continue
            frame = parse(piece)
            if frame is None:
                self.rejected += 1
            else:
                frames.append(frame)
        return frames
