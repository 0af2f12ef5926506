"""A board's 16-bit millisecond counter to host seconds.

Frames carry the low 16 bits of the board's milliseconds, sampled when the sensor was read; the host knows when the
bytes arrived. What separates the two is the clocks' offset and drift, and the way: a fixed part that cannot be told
from offset, and a varying part that only adds. So the line under the cloud of (arrival - board time) is the clock: a
decaying regression as in Klipper's clocksync, over the least value of each second. Everything here is a function of
the frames and their arrival times alone: a recording gives the same times again.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque

WRAP = 1 << 16  # ms
BUCKET = 1.0  # s
DECAY = 29.0 / 30.0  # per bucket: what happened half a minute ago counts little
SLOPE_PRIOR = 25.0  # s^2: (5 ms of jitter / 0.1 % of drift)^2, so that few buckets cannot tell a wild drift
SLEW = 0.05  # largest correction of the output, as a share of the time that passed
JUMP = 0.5  # s: a bucket this far above the line is a stalled link, or, three times in a row, a new truth
HISTORY = 64  # frames in which a late sample finds its place


class Envelope:
    """Decaying straight line through the least (arrival - board time) of each bucket of board time."""

    def __init__(self) -> None:
        self.bucket: int | None = None
        self.least = 0.0  # of the bucket under way
        self.least_at = 0.0
        self.outliers = 0
        self._forget()

    def _forget(self) -> None:
        self.weight = 0.0
        self.mean_at = self.mean = 0.0
        self.spread = self.product = 0.0

    @property
    def slope(self) -> float:
        """Host seconds gained per board second."""
        return self.product / (self.spread + SLOPE_PRIOR)

    def at(self, board: float) -> float:
        """Offset (s) of the host's clock at a board time (s); never above what this second has shown."""
        if self.weight == 0.0:
            return self.least
        return min(self.mean + self.slope * (board - self.mean_at), self.least + self.slope * (board - self.least_at))

    def add(self, board: float, offset: float) -> None:
        """Takes one frame's (arrival - board time)."""
        bucket = int(board // BUCKET)
        if self.bucket is None or bucket > self.bucket:
            if self.bucket is not None:
                self._close()
            self.bucket, self.least, self.least_at = bucket, offset, board
        elif bucket == self.bucket and offset < self.least:  # a late sample of an older second says nothing new
            self.least, self.least_at = offset, board

    def _close(self) -> None:
        if self.weight > 0.0:
            excess = self.least - self.mean - self.slope * (self.least_at - self.mean_at)
            self.outliers = self.outliers + 1 if excess > JUMP else 0
            if 0 < self.outliers < 3:
                return
            if abs(excess) > JUMP:
                self._forget()
        self.outliers = 0
        old = self.weight * DECAY
        self.weight = old + 1.0
        step_at, step = self.least_at - self.mean_at, self.least - self.mean
        share = old / self.weight
        self.mean_at += step_at / self.weight
        self.mean += step / self.weight
        self.spread = DECAY * self.spread + share * step_at * step_at
        self.product = DECAY * self.product + share * step_at * step


class BoardClock:
    """One board's time: unwraps it, and maps it to host seconds that never run backwards and never pass the arrival."""

    def __init__(self) -> None:
        self.reboots = 0
        self.boot_count: int | None = None
        self.ticks: int | None = None  # newest board time (ms), unwrapped from where we came in
        self.before_ticks: int | None = None  # what the board's uptime is ahead of ticks (ms), told by its first status
        self.arrival = 0.0  # when the newest came
        self.envelope = Envelope()
        self.anchors: deque[tuple[int, float]] = deque(maxlen=HISTORY)  # (ticks, host time), both rising
        self.floor = float("-inf")  # newest host time given

    @property
    def newest_ms(self) -> int:
        """The newest frame's 16-bit time: what a command echoes."""
        return 0 if self.ticks is None else self.ticks % WRAP

    @property
    def drift(self) -> float:
        """How much faster the host's clock runs than the board's, as a share."""
        return self.envelope.slope

    def to_host(self, time_ms: int, arrival: float) -> float:
        """Host time (s) of a frame's sample; `arrival` never falls from call to call."""
        return self._map(self._unwrap(time_ms, arrival), arrival)

    def status(self, time_ms: int, uptime_ms: int, boot_count: int, arrival: float) -> bool:
        """Sets the time straight by a status frame; true if the board has booted since it was last heard."""
        uptime = nearest(time_ms, uptime_ms)
        ticks = self._unwrap(time_ms, arrival)
        if self.before_ticks is None:
            self.before_ticks, self.boot_count = uptime - ticks, boot_count
            return False
        ahead = uptime - self.before_ticks - ticks  # a multiple of WRAP
        has_rebooted = ahead < 0 or boot_count != self.boot_count
        if has_rebooted or ahead > 0:  # in a long silence the host's clock stood still, or the board's began anew
            self.reboots += has_rebooted
            self.ticks, self.before_ticks, self.boot_count, self.arrival = uptime, 0, boot_count, arrival
            self.envelope = Envelope()
            self.anchors.clear()
        return has_rebooted

    def _unwrap(self, time_ms: int, arrival: float) -> int:
        """The board's time nearest to what the host's clock lets expect since the last frame."""
        if self.ticks is None:
            return time_ms
        elapsed = 1000.0 * (arrival - self.arrival) / (1.0 + self.envelope.slope)
        return nearest(time_ms, self.ticks + round(elapsed))

    def _map(self, ticks: int, arrival: float) -> float:
        board = ticks * 1e-3
        self.envelope.add(board, arrival - board)
        if self.anchors and ticks <= self.anchors[-1][0]:
            return self._recall(ticks)
        host = min(self._advance(ticks, board + self.envelope.at(board)), arrival)
        self.floor = host = max(host, self.floor)
        self.ticks, self.arrival = ticks, arrival
        self.anchors.append((ticks, host))
        return host

    def _advance(self, ticks: int, target: float) -> float:
        """Moves toward the target no faster than SLEW, unless it is far ahead."""
        if not self.anchors:
            return target
        last_ticks, last_host = self.anchors[-1]
        step = (ticks - last_ticks) * 1e-3 * (1.0 + self.envelope.slope)
        error = target - last_host - step
        if error > JUMP:
            return target
        return last_host + step + min(max(error, -SLEW * step), SLEW * step)

    def _recall(self, ticks: int) -> float:
        """Where a sample older than the newest lies between its neighbours."""
        place = bisect_left(self.anchors, ticks, key=lambda anchor: anchor[0])
        after_ticks, after_host = self.anchors[place]
        if place == 0 or ticks == after_ticks:  # place 0: a board that has booted and not yet said so
            return after_host
        before_ticks, before_host = self.anchors[place - 1]
        return before_host + (after_host - before_host) * (ticks - before_ticks) / (after_ticks - before_ticks)


def nearest(time_ms: int, expected: int) -> int:
    """The count that ends in these 16 bits and is nearest to the expected one."""
    return expected + (time_ms - expected + WRAP // 2) % WRAP - WRAP // 2
