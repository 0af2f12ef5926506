"""The line of an optical mouse, as Linux tells it at /dev/input/mouseN: packets of three bytes, as PS/2 mice send them.

    buttons, signs    bit 3 is always set, bits 4 and 5 are the signs of x and y, bits 6 and 7 say that they overflowed
    x                 counts to the right, two's complement
    y                 counts ahead

Linux keeps both within -127 and 127, so that each sign bit is its byte's highest. That, and bit 3, is all there is to
find a packet's beginning by; but no packet lies on both sides of a silence. Asks no clock.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from server.messages import MouseCounts

PACKET = 3  # bytes
ALWAYS, X_SIGN, Y_SIGN, OVERFLOWS = 0x08, 0x10, 0x20, 0xC0  # bits of the first
SILENCE = 0.05  # s after which a packet does not go on; a mouse sends all of one at once


class Found(NamedTuple):
    """What bytes hold: counts to the right and ahead, from so many packets; bytes and packets that are not believed."""

    x: int = 0
    y: int = 0
    packets: int = 0
    skipped: int = 0  # bytes
    unsound: int = 0  # packets with an overflow


class Decoder:
    """Finds packets in any slicing of the bytes."""

    def __init__(self) -> None:
        self.pending = b""
        self.was_unsound = False  # the packet before; two such after one another are none: the beginning is elsewhere

    def feed(self, data: bytes) -> Found:
        """What the packets that the bytes complete add up to."""
        data = self.pending + data
        at = x = y = packets = skipped = unsound = 0
        while len(data) - at >= PACKET:
            first, right, ahead = data[at : at + PACKET]
            if first & ALWAYS and first & OVERFLOWS and not self.was_unsound:
                self.was_unsound = True
                unsound += 1
            elif is_packet(first, right, ahead):
                self.was_unsound = False
                packets, x, y = packets + 1, x + signed(right), y + signed(ahead)
            else:
                skipped += 1
                at += 1
                continue
            at += PACKET
        self.pending = data[at:]
        return Found(x, y, packets, skipped, unsound)

    def drop(self) -> int:
        """Forget the beginning of a packet that never ended; how many bytes it had."""
        dropped, self.pending = len(self.pending), b""
        return dropped


class MouseLine:
    """One mouse: `receive` gives what it counted."""

    name = "mouse"  # of its packets among the session's frames
    fault = ""

    def __init__(self, mouse: int):
        """`mouse` is its number among the robot's."""
        self.mouse = mouse
        self.decoder = Decoder()
        self.t = 0.0  # when it was heard last
        self.skipped = 0  # bytes
        self.refused: Counter[str] = Counter()

    def receive(self, data: bytes, t: float) -> list[MouseCounts]:
        """The counts of the packets that the bytes complete, as one message; none where they complete none."""
        skipped = self.decoder.drop() if t - self.t > SILENCE else 0
        self.t = t
        found = self.decoder.feed(data)
        skipped += found.skipped
        self.skipped += skipped
        self.refused["unsound"] += found.unsound
        if not (found.packets or found.unsound):
            return []
        return [MouseCounts(t, self.mouse, found.x, found.y, is_whole=not (skipped or found.unsound))]

    def requests(self, t: float) -> bytes:
        """Nothing: a mouse speaks unasked."""
        del t
        return b""

    @property
    def rejected(self) -> int:
        """Bytes that were of no packet."""
        return self.skipped


def is_packet(first: int, right: int, ahead: int) -> bool:
    """Whether three bytes are a packet of Linux's."""
    signs_fit = bool(first & X_SIGN) == (right > 127) and bool(first & Y_SIGN) == (ahead > 127)
    return bool(first & ALWAYS) and not first & OVERFLOWS and signs_fit


def signed(byte: int) -> int:
    """A byte's two's complement."""
    return byte - 256 if byte > 127 else byte
