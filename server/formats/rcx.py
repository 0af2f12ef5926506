"""The data log of a LEGO RCX that ran the paper's program: counts of both wheels, a pair of 16-bit integers a stage.

Stages come in the program's order, drive, back up, turn, again and again; counters begin at zero in each (Dye, Mapping
with only a bumper, part 2). As text the integers stand one or two in a line, as `nqc -datalog` prints them, with `#`
for comments; or they are bytes, the low one first. A drive ends at a bump: the log has no other.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from server.formats.cart_log import CartLog
from server.formats.errors import FormatError, read_bytes
from slam.cart_odometry import BACK, DRIVE, MIDDLE, TURN, CartParams, Stage

CYCLE = (DRIVE, BACK, TURN)
NAMES = ("drive", "back up", "turn")
LIMIT = 1 << 15  # of a signed integer of 16 bits
REMEDY = "the log is pairs of left and right counts: of a drive, of backing up, of a turn, and so on"
LOST = "a value was lost; cut the log there, or download it again"


def is_rcx(content: bytes) -> bool:
    """Whether the beginning of a file reads like such a log in text: one or two integers in its first line."""
    lines = content.decode("utf-8", errors="replace").splitlines()
    first = next((line for line in map(bare, lines) if line), "")
    fields = first.split()
    return 1 <= len(fields) <= 2 and all(is_count(field) for field in fields)


def bare(line: str) -> str:
    """A line without its comment, commas as spaces."""
    return line.partition("#")[0].replace(",", " ").strip()


def is_count(field: str) -> bool:
    """Whether a field is an integer of 16 bits, signed or not."""
    return field.lstrip("-").isdecimal() and -LIMIT <= int(field) < 2 * LIMIT


def read_rcx(path: Path | str, params: CartParams | None = None) -> CartLog:
    """The whole run; FormatError names the line (or byte) that cannot be. A cut last pair is left out."""
    path = Path(path)
    content = read_bytes(path, REMEDY)
    if not content.strip():
        raise FormatError(path, None, "is empty", REMEDY)
    numbers, places = text_of(path, content) if is_text(content) else bytes_of(content)
    stages = []
    for pair in range(len(numbers) // 2):
        left, right = (number - 2 * LIMIT * (number >= LIMIT) for number in numbers[2 * pair : 2 * pair + 2])
        kind = CYCLE[pair % len(CYCLE)]
        if (kind == DRIVE and left + right < 0) or (kind == BACK and left + right > 0):
            raise FormatError(path, places[2 * pair], f"{left} {right} is the wrong way to {NAMES[kind]}", LOST)
        stages.append(Stage(kind, left, right, MIDDLE if kind == DRIVE else 0))
    if not stages:
        raise FormatError(path, None, "holds not one pair of counts", REMEDY)
    truncated_at = places[-1] if len(numbers) % 2 else None
    return CartLog(path, stages, params or CartParams(), np.full(len(stages), np.nan), truncated_at)


def is_text(content: bytes) -> bool:
    """Whether there is nothing in it that a text has not; the counts' high bytes are 0 or 255 as a rule."""
    try:
        return "\0" not in content.decode("utf-8")
    except UnicodeDecodeError:
        return False


def text_of(path: Path, content: bytes) -> tuple[list[int], list[int]]:
    """The integers, and the line of each."""
    numbers, places = [], []
    for number, line in enumerate(content.decode("utf-8").splitlines(), 1):
        fields = bare(line).split()
        for field in fields:
            if not is_count(field):
                raise FormatError(path, number, f"{field!r} is no integer of 16 bits", REMEDY)
            numbers.append(int(field))
            places.append(number)
        if len(fields) > 2:
            raise FormatError(path, number, f"{len(fields)} integers where one or two belong", REMEDY)
    if not numbers:
        raise FormatError(path, None, "holds no integer", REMEDY)
    return numbers, places


def bytes_of(content: bytes) -> tuple[list[int], list[int]]:
    """The integers, and the offset of each; an odd last byte is left out."""
    numbers = np.frombuffer(content[: len(content) // 2 * 2], "<i2")
    return numbers.tolist(), list(range(0, 2 * len(numbers), 2))
