"""SCIP 2.0, what Hokuyo's laser scanners speak over serial lines: requests out, sweeps and particulars in.

After the document C-42-03320B of Hokuyo's. An answer echoes its request in a first line; status, data and time stamp
follow in lines that each end in a check, and an empty line ends it. A sweep is told in blocks of 64 characters, three
to a range. Knows no transport: bytes come in as they arrive, in whatever pieces, and what is not whole is counted.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from slam.laser_scan import LaserParams

CHARACTERS = 3  # of a range
BLOCK = 64  # characters of data before a check
LEAST = 20  # mm; smaller numbers are codes of what went wrong
STAMP_WRAP = 1 << 24  # ms
WINDOW = 30.0  # s in which some sweep comes without being held up
ON_THE_WAY = "99"  # status of a sweep
LONGEST = 8192  # bytes of an answer; what is longer is noise without empty lines


class Sweep(NamedTuple):
    """One turn of the laser: its time stamp in ms (24 bits), its first step, and ranges (n,) in m, nan for none."""

    time_ms: int
    first: int
    ranges: np.ndarray


class Answer(NamedTuple):
    """What was said to another request: the request as echoed, the status, and the lines without their checks."""

    request: str
    status: str
    lines: tuple[str, ...]


def start(first: int, last: int, cluster: int = 1, skip: int = 0) -> bytes:
    """The request for sweeps without end, of steps `first` to `last`, `cluster` merged into one, `skip` left out.

    ValueError where the numbers do not fit.
    """
    if not (0 <= first < last <= 9999 and 1 <= cluster <= 99 and 0 <= skip <= 9):
        raise ValueError(f"no laser tells steps {first} to {last}, {cluster} together, {skip} turns left out")
    return f"MD{first:04d}{last:04d}{cluster:02d}{skip}00\n".encode()


def checksum(text: str) -> str:
    """The check of a line."""
    return chr((sum(map(ord, text)) & 0x3F) + 0x30)


def decoded(text: str, characters: int = CHARACTERS) -> np.ndarray:
    """The numbers that groups of characters stand for, 6 bits in each; ValueError for others and for what is over."""
    sixes = np.frombuffer(text.encode("latin-1"), np.uint8).astype(np.int64) - 0x30
    if sixes.size % characters or np.any((sixes < 0) | (sixes > 0x3F)):
        raise ValueError("no groups of characters")
    weights = 64 ** np.arange(characters - 1, -1, -1)
    return sixes.reshape(-1, characters) @ weights


class Decoder:
    """Takes bytes as they come; gives sweeps and answers, and counts by its reason what it could not use."""

    def __init__(self) -> None:
        self.buffer = bytearray()
        self.rejected: Counter[str] = Counter()

    def feed(self, data: bytes) -> Iterator[Sweep | Answer]:
        """What the bytes complete."""
        self.buffer += data
        while True:
            end = self.buffer.find(b"\n\n")
            if end < 0:
                break
            text = self.buffer[:end].decode("latin-1").lstrip("\n")
            del self.buffer[: end + 2]
            if text:
                yield from self.take(text.split("\n"))
        if len(self.buffer) > LONGEST:
            self.buffer.clear()
            self.rejected["endless"] += 1

    def take(self, lines: list[str]) -> Iterator[Sweep | Answer]:
        """The meaning of an answer's lines."""
        if len(lines) < 2:
            self.rejected["cut"] += 1
            return
        request = lines[0]
        is_sweep = request.startswith("MD")
        checked = [unchecked(line, is_sweep) for line in lines[1:]]
        if any(line is None for line in checked):
            self.rejected["check"] += 1
            return
        status, *rest = [line or "" for line in checked]
        if is_sweep and status == ON_THE_WAY:
            sweep = sweep_of(request, rest)
            if sweep is None:
                self.rejected["length"] += 1
            else:
                yield sweep
        else:
            yield Answer(request, status, tuple(rest))


def unchecked(line: str, is_data: bool) -> str | None:
    """A line without its check, and, unless it is data, without the semicolon before it; None where that is wrong."""
    text, check = line[:-1], line[-1:]
    if not is_data and text.endswith(";"):
        text = text[:-1]
    return text if check == checksum(text) else None


def sweep_of(request: str, lines: list[str]) -> Sweep | None:
    """The sweep that a time stamp and blocks of data tell; None where it is not what was asked for."""
    try:
        first, last, cluster = int(request[2:6]), int(request[6:10]), max(1, int(request[10:12]))
        [stamp] = decoded(lines[0], 4)
        if any(len(line) != BLOCK for line in lines[1:-1]):
            return None
        millimetres = decoded("".join(lines[1:]))
    except (ValueError, IndexError):
        return None
    if len(millimetres) != (last - first) // cluster + 1:
        return None
    return Sweep(int(stamp), first, np.where(millimetres < LEAST, np.nan, millimetres / 1000.0))


def laser_of(answer: Answer) -> LaserParams:
    """The laser that tells its particulars (PP); ValueError where it leaves out one that is needed.

    Steps count from the right; step AFRT looks ahead. A range beyond DMAX is no return.
    """
    try:
        first, last, ahead, turn, reach = numbers_of(answer, "AMIN", "AMAX", "AFRT", "ARES", "DMAX")
        step = 360.0 / turn
        return LaserParams(
            beams=last - first + 1, first_deg=(first - ahead) * step, step_deg=step, max_range=reach / 1000.0
        )
    except (KeyError, ValueError, ZeroDivisionError) as error:
        raise ValueError(f"the laser's particulars cannot be read ({error})") from None


def steps_of(answer: Answer) -> tuple[int, int]:
    """The first and the last step that a laser with these particulars (PP) tells ranges of."""
    first, last = numbers_of(answer, "AMIN", "AMAX")
    return first, last


def numbers_of(answer: Answer, *keys: str) -> list[int]:
    """What particulars tell of these keys; KeyError for one that is left out, ValueError for one that is no number."""
    told = dict(line.split(":", 1) for line in answer.lines if ":" in line)
    return [int(told[key]) for key in keys]


class Stamps:
    """A laser's time stamps, which wrap, as seconds since its first, and as the host's time.

    A sweep cannot arrive before it ended: the least delay of the last half minute is the line's, and what comes later
    was held up. It is no longer than that because no two clocks run alike: 100 ppm are 3 ms in that time.
    """

    def __init__(self) -> None:
        self.last: int | None = None
        self.seconds = 0.0
        self.delays: deque[tuple[float, float]] = deque()  # arrivals, and the host's time less the laser's, ascending

    def to_host(self, time_ms: int, arrival: float) -> float:
        """The host's time (s) of a stamp that arrived at `arrival`."""
        if self.last is not None:
            self.seconds += ((time_ms - self.last) % STAMP_WRAP) * 1e-3
        self.last = time_ms
        delay = arrival - self.seconds
        while self.delays and self.delays[-1][1] >= delay:
            self.delays.pop()
        self.delays.append((arrival, delay))
        while arrival - self.delays[0][0] > WINDOW:
            self.delays.popleft()
        return self.seconds + self.delays[0][1]
