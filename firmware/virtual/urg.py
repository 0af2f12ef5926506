"""A virtual Hokuyo URG-04LX: turns ten times a second in a world, and speaks SCIP 2.0 over its own line.

Ranges err as its sheet says (10 mm up to a metre, 1 % beyond); some beams come back with an error's code, more of them
at grazing angles and from far off. A beam is measured where the robot is when the laser looks that way, so that fast
turns bend what it sees. After the document C-42-03320B of Hokuyo's; knows nothing of the host's side.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from firmware.virtual.worlds import World

FIRST, LAST, AHEAD, TURN = 44, 725, 384, 1024  # steps: of the first and last range, straight ahead, in a circle
PERIOD_MS = 100
REACH, NEAREST = 5.6, 0.06  # m
NOISE, NOISE_SHARE = 0.010, 0.01  # m, and of the range
DROPOUTS, FAR_DROPOUTS = 0.002, 0.06  # of the beams from next to the laser, and at the end of its reach
BLOCK = 64
TOO_WEAK, NOTHING = 1, 0  # codes in place of a range
SEGMENTS = 16  # of a turn, in each of which the robot is taken to stand

Place = Callable[[float], np.ndarray]  # the laser's pose (3,) at a time (s)


def coded(number: int, characters: int) -> str:
    """A number in groups of six bits."""
    return "".join(chr((number >> 6 * place & 0x3F) + 0x30) for place in range(characters - 1, -1, -1))


def checked(line: str) -> str:
    """A line with its check."""
    return line + chr((sum(map(ord, line)) & 0x3F) + 0x30)


def marked(line: str) -> str:
    """A line about the laser itself, which a semicolon ends; the check leaves that out."""
    return f"{line};{checked(line)[-1]}"


class VirtualUrg:
    """The laser: `write` requests to it, `advance` it; `place(t)` tells where it is (or was) at a time."""

    def __init__(self, world: World, place: Place, seed: int = 0):
        self.world = world
        self.place = place
        self.rng = np.random.default_rng([seed, 0x0461])
        self.buffer = b""
        self.answers = b""
        self.now_ms = 0
        self.request = ""  # of the sweeps that it tells; empty while it tells none
        self.first, self.last, self.cluster, self.skip, self.left = FIRST, LAST, 1, 0, 0
        self.is_lit = False

    def write(self, data: bytes) -> None:
        """Bytes from the host; requests end with a line feed or a carriage return."""
        self.buffer = (self.buffer + data).replace(b"\r", b"\n")
        *lines, self.buffer = self.buffer.split(b"\n")
        for line in lines:
            if line:
                self.obey(line.decode("latin-1"))
        self.buffer = self.buffer[-64:]

    def obey(self, request: str) -> None:
        """Answer one request."""
        kind = request[:2]
        if kind == "MD":
            self.begin(request)
        elif kind == "BM":
            self.say(request, "02" if self.is_lit else "00")
            self.is_lit = True
        elif kind == "QT":
            self.is_lit, self.request = False, ""
            self.say(request, "00")
        elif kind == "PP":
            self.answers += "\n".join([request, checked("00"), *map(marked, particulars()), "", ""]).encode("latin-1")
        elif request in ("SCIP2.0", "VV", "II", "RS"):
            self.say(request, "00")
        else:
            self.say(request, "0E")

    def begin(self, request: str) -> None:
        """Sweeps are asked for: 99 of them at most, or, with none told, without end."""
        numbers = [request[2:6], request[6:10], request[10:12], request[12:13], request[13:15]]
        if len(request) != 15 or not all(number.isdigit() for number in numbers):
            self.say(request, "0C")
            return
        first, last, cluster, skip, count = map(int, numbers)
        if last > TURN or first >= last:
            self.say(request, "04" if last > TURN else "05")
            return
        self.request, self.first, self.last = request, first, last
        self.cluster, self.skip, self.left = max(1, cluster), skip, count if count else -1
        self.is_lit = True
        self.say(request, "00")

    def say(self, request: str, status: str, *lines: str) -> None:
        """An answer: the request, its status, and lines with their checks."""
        self.answers += "\n".join([request, checked(status), *map(checked, lines), "", ""]).encode("latin-1")

    def advance(self, ms: int) -> bytes:
        """What it says in so many milliseconds."""
        for _ in range(ms):
            self.now_ms += 1
            if self.request and self.now_ms % (PERIOD_MS * (1 + self.skip)) == 0:
                self.tell()
        said, self.answers = self.answers, b""
        return said

    def tell(self) -> None:
        """The sweep that ends now."""
        millimetres = self.sweep(self.now_ms * 1e-3)[self.first : self.last + 1]
        n = (self.last - self.first) // self.cluster + 1
        padded = np.pad(millimetres, (0, n * self.cluster - len(millimetres)), mode="edge").reshape(n, self.cluster)
        valid = np.where(padded >= 20, padded, np.iinfo(padded.dtype).max).min(axis=1)
        merged = np.where(valid == np.iinfo(padded.dtype).max, padded[:, 0], valid)
        data = "".join(coded(int(value), 3) for value in merged)
        blocks = [data[at : at + BLOCK] for at in range(0, len(data), BLOCK)]
        self.left -= self.left > 0
        echo = self.request[:13] + f"{max(0, self.left):02d}"
        self.say(echo, "99", coded((self.now_ms - PERIOD_MS) % (1 << 24), 4), *blocks)
        if self.left == 0:
            self.request = ""

    def sweep(self, end: float) -> np.ndarray:
        """Millimetres (1025,) or codes of every step of the turn that ends at a time (s); blind ones see nothing."""
        steps = np.arange(FIRST, LAST + 1)
        bearings = (steps - AHEAD) * (2.0 * math.pi / TURN)
        true = np.empty(len(steps))
        for part in np.array_split(np.arange(len(steps)), SEGMENTS):
            moment = end - 1e-3 * PERIOD_MS * (1.0 - float(steps[part].mean()) / TURN)
            x, y, heading = self.place(moment)
            true[part] = self.world.cast(x, y, heading + bearings[part], REACH + 1.0)
        noise = np.maximum(NOISE, NOISE_SHARE * np.where(np.isfinite(true), true, 0.0)) / 3.0  # a bound of three sigmas
        found = true + noise * self.rng.standard_normal(len(steps))
        lost = self.rng.random(len(steps)) < DROPOUTS + FAR_DROPOUTS * (np.minimum(true, REACH) / REACH) ** 4
        told = np.where(lost | (found < NEAREST), TOO_WEAK, np.round(1000.0 * np.where(np.isfinite(found), found, 0.0)))
        whole = np.full(TURN + 1, NOTHING, np.int64)
        whole[FIRST : LAST + 1] = np.where(found > REACH, NOTHING, told)
        return whole


def particulars() -> list[str]:
    """What it says of itself."""
    return [
        "MODL:URG-04LX (virtual)", "DMIN:20", f"DMAX:{round(1000 * REACH)}", f"ARES:{TURN}", f"AMIN:{FIRST}",
        f"AMAX:{LAST}", f"AFRT:{AHEAD}", "SCAN:600",
    ]  # fmt: skip
