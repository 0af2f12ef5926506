"""What a bad link does to frames, thousands at a time: each kind of harm once to every frame of a stretch of line.

Chance comes in as a generator. What comes out is what a receiver sees: the pieces between delimiters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from server.link import DELIMITER

LONGEST_BURST = 32  # bits
MOST_LOST = 8  # bytes


class Line(NamedTuple):
    """Encoded frames in a row: their bytes (n,), and where each begins and how long it is, its delimiter included."""

    octets: np.ndarray
    starts: np.ndarray
    sizes: np.ndarray


def line_of(frames: Sequence[bytes]) -> Line:
    """The frames one after the other."""
    sizes = np.array([len(frame) for frame in frames])
    return Line(np.frombuffer(b"".join(frames), np.uint8).copy(), np.cumsum(sizes) - sizes, sizes)


def flip_bits(line: Line, rng: np.random.Generator, rate: float) -> np.ndarray:
    """One bit of every frame, and each other one at the rate."""
    octets, bits = line.octets.copy(), 8 * line.sizes
    flips = 1 + rng.binomial(bits - 1, rate)
    for i in range(int(flips.max())):
        hit = flips > i
        places = rng.integers(0, bits[hit])
        octets[line.starts[hit] + places // 8] ^= (1 << places % 8).astype(np.uint8)
    return octets


def burst(line: Line, rng: np.random.Generator) -> np.ndarray:
    """A run of 2 to 32 bits of every frame, of which the first and the last are flipped and half of the others."""
    octets, bits = line.octets.copy(), 8 * line.sizes
    lengths = rng.integers(2, LONGEST_BURST + 1, bits.size)
    first = rng.integers(0, bits - lengths + 1)
    pattern = rng.integers(0, 1 << LONGEST_BURST, bits.size) & ((1 << lengths) - 1) | 1 | 1 << (lengths - 1)
    pattern <<= first % 8
    for i in range(LONGEST_BURST // 8 + 1):
        hit = pattern >> 8 * i > 0
        octets[line.starts[hit] + first[hit] // 8 + i] ^= (pattern[hit] >> 8 * i & 0xFF).astype(np.uint8)
    return octets


def lose_bytes(line: Line, rng: np.random.Generator) -> np.ndarray:
    """1 to 8 bytes of every frame in a row, but never all of it."""
    lost = rng.integers(1, np.minimum(MOST_LOST, line.sizes - 1) + 1)
    return without(line, rng.integers(0, line.sizes - lost + 1), lost)


def splice(line: Line, rng: np.random.Generator) -> np.ndarray:
    """Of every two frames the first one's head with the second one's tail: what a lost chunk leaves."""
    is_head = np.arange(line.sizes.size) % 2 == 0
    cuts = rng.integers(1, line.sizes)
    return without(line, np.where(is_head, cuts, 0), np.where(is_head, line.sizes - cuts, cuts))


def replace(line: Line, rng: np.random.Generator) -> np.ndarray:
    """Noise as long as every frame, with its delimiter."""
    octets = rng.integers(0, 256, line.octets.size, np.uint8)
    octets[line.starts + line.sizes - 1] = 0
    return octets


def without(line: Line, first: np.ndarray, count: np.ndarray) -> np.ndarray:
    """The line without `count` bytes of each frame, from its `first` on."""
    offsets = np.arange(line.octets.size) - np.repeat(line.starts, line.sizes)
    first, count = np.repeat(first, line.sizes), np.repeat(count, line.sizes)
    return line.octets[(offsets < first) | (offsets >= first + count)]


def pieces_of(octets: np.ndarray, sent: set[bytes]) -> list[bytes]:
    """What lies between the delimiters, but for nothing and for frames that were sent so."""
    return [piece for piece in octets.tobytes().split(DELIMITER) if piece and piece not in sent]


KINDS: dict[str, Callable[[Line, np.random.Generator], np.ndarray]] = {
    "bit errors, 1e-3": partial(flip_bits, rate=1e-3),
    "bit errors, 1e-2": partial(flip_bits, rate=1e-2),
    "bit errors, 5e-2": partial(flip_bits, rate=5e-2),
    "bursts of 2 to 32 bits": burst,
    "1 to 8 bytes lost": lose_bytes,
    "heads with others' tails": splice,
    "noise alone": replace,
}
