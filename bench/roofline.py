"""What this machine can do at best in a second, measured, and how long a piece of work must take therefore.

After Williams, Waterman and Patterson, *Roofline*, CACM 52(4), 2009, with two more ceilings that bind a particle
filter: look-ups in tables that lie in the first cache, and calls of log, exp, sin and cos. The ceilings overlap, so
that the longest of the four times is the bound.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numba import njit

COPIED = 8_000_000  # float64 per array that is copied: out of every cache
CACHED = 2048  # float64, or look-ups, that stay in the first cache
TABLE = 4096  # bytes of a table of labels, in the first cache
REPEATS = 50  # of some milliseconds; the best counts


class Ceilings(NamedTuple):
    """What some threads do at best in a second: bytes moved, look-ups, floating-point operations, function calls."""

    bytes: float
    lookups: float
    flops: float
    calls: float


class Work(NamedTuple):
    """What something must at least do: bytes moved to or from memory, look-ups, operations, calls of functions."""

    bytes: float = 0.0
    lookups: float = 0.0
    flops: float = 0.0
    calls: float = 0.0

    def seconds(self, ceilings: Ceilings) -> tuple[float, str]:
        """The shortest time that it can take, and what binds it."""
        times = [part / most for part, most in zip(self, ceilings, strict=True)]
        longest = int(np.argmax(times))
        return times[longest], self._fields[longest]


@njit(cache=True, nogil=True)
def copy(source, target):
    """STREAM's copy (McCalpin 1995)."""
    for i in range(source.size):
        target[i] = source[i]


@njit(cache=True, nogil=True)
def look_up(table, places, rounds):
    """Independent look-ups of one byte each."""
    total = 0
    for _ in range(rounds):
        for i in range(places.size):
            total += table[places[i]]
    return total


@njit(cache=True, nogil=True, fastmath={"contract"})
def multiply_and_add(values, rounds):
    """Fifteen multiplications and additions of each value, for which vectors and fused operations can be used."""
    a, b = 0.999, 0.001
    for _ in range(rounds):
        for i in range(values.size):
            x = values[i]
            x = ((x * a + b) * a + b) * a + b
            x = ((x * a + b) * a + b) * a + b
            x = ((x * a + b) * a + b) * a + b
            x = ((x * a + b) * a + b) * a + b
            values[i] = ((x * a + b) * a + b) * a + b


@njit(cache=True, nogil=True)
def call(values, rounds):
    """log, exp, sin and cos of each value."""
    total = 0.0
    for _ in range(rounds):
        for i in range(values.size):
            x = values[i]
            total += math.log(x) + math.exp(x) + math.sin(x) + math.cos(x)
    return total


def best_time(task: Callable[..., Any], arguments: list[tuple[Any, ...]]) -> float:
    """Seconds of task(*arguments) on as many threads as there are arguments; compiled before, the best of some.

    The slowest thread's processor time counts, so that other work on the machine does little to it.
    """

    def timed(job: tuple[Any, ...]) -> float:
        before = time.thread_time()
        task(*job)
        return time.thread_time() - before

    with ThreadPoolExecutor(len(arguments)) as pool:
        times = [max(pool.map(timed, arguments)) for _ in range(REPEATS + 1)]
    return min(times[1:])


@functools.cache
def ceilings(threads: int = 1) -> Ceilings:
    """Measure them; once in a process."""
    rng = np.random.default_rng(0)
    each = range(threads)
    arrays = [(np.zeros(COPIED), np.zeros(COPIED)) for _ in each]
    tables = [
        (rng.integers(-1, 2, TABLE).astype(np.int8), rng.integers(0, TABLE, CACHED).astype(np.uint32)) for _ in each
    ]
    values = [rng.uniform(0.5, 2.0, CACHED) for _ in each]
    return Ceilings(
        threads * 16.0 * COPIED / best_time(copy, arrays),
        threads * 1000.0 * CACHED / best_time(look_up, [(*table, 1000) for table in tables]),
        threads * 30.0 * 2000.0 * CACHED / best_time(multiply_and_add, [(part, 2000) for part in values]),
        threads * 4.0 * 100.0 * CACHED / best_time(call, [(part, 100) for part in values]),
    )
