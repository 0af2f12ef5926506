import random
from itertools import pairwise

import pytest

from server.clock import BoardClock, nearest

LATENCY = 0.012  # s, the fixed part that no clock can tell from offset


class Board:
    """A board with its own idea of a second, heard over a radio that delays in order."""

    def __init__(self, seed=0, drift=0.0, boot=0.0, jitter=0.010):
        self.rng = random.Random(seed)
        self.drift, self.boot, self.jitter = drift, boot, jitter
        self.arrival = 0.0

    def uptime_ms(self, t):
        return int((t - self.boot) * 1000 * (1 + self.drift))

    def say(self, t):
        """(16-bit time, arrival) of a frame sampled at true time t."""
        delay = LATENCY + self.rng.expovariate(1 / self.jitter) if self.jitter else LATENCY
        self.arrival = max(self.arrival, t + delay)
        return self.uptime_ms(t) % 65536, self.arrival


def listen(board, times, clock=None):
    clock = clock or BoardClock()
    return [clock.to_host(*board.say(t)) for t in times]


def every(seconds, start, end):
    return [start + i * seconds for i in range(int((end - start) / seconds))]


@pytest.mark.parametrize("drift", [0.0, 50e-6, -200e-6, 0.01, -0.02])
@pytest.mark.parametrize("seed", range(3))
def test_times_are_right_within_the_way_s_jitter(drift, seed):
    times = every(0.02, 5.0, 200.0)
    hosts = listen(Board(seed, drift, boot=-1234.5), times)
    errors = [host - t - LATENCY for host, t in zip(hosts, times, strict=True)]
    settled = errors[3000:]
    assert max(map(abs, settled)) < 0.004  # of a jitter with mean 10 ms; frames count whole ms
    assert max(map(abs, errors)) < 0.150


def test_steps_between_frames_are_kept_while_arrivals_come_in_bursts():
    board = Board(jitter=0.0)
    clock = BoardClock()
    times = every(0.02, 0.0, 60.0)
    hosts = []
    for start in range(0, len(times), 10):  # a radio that sends ten frames at once
        arrival = times[min(start + 9, len(times) - 1)] + 0.01
        hosts += [clock.to_host(board.uptime_ms(t) % 65536, arrival) for t in times[start : start + 10]]
    steps = [b - a for a, b in pairwise(hosts)]
    assert all(0.018 < step < 0.022 for step in steps[500:])


@pytest.mark.parametrize("seed", range(20))
def test_time_never_runs_backwards_nor_passes_the_arrival(seed):
    rng = random.Random(seed)
    board = Board(seed, drift=rng.uniform(-0.01, 0.01), jitter=0.05)
    clock, t, last = BoardClock(), 0.0, -1.0
    for _ in range(2000):
        t += rng.choice((0.0, 0.02, 0.02, 0.04, 0.5, 3.0 * rng.random(), 100.0 * (rng.random() < 0.01)))
        time_ms, arrival = board.say(t)
        host = clock.to_host(time_ms, arrival)
        assert last <= host <= arrival
        last = host


def test_a_sample_that_is_sent_late_finds_its_place_between_its_neighbours():
    board, clock = Board(jitter=0.0), BoardClock()
    heard = {}
    for t in every(0.04, 0.0, 30.0):
        heard[t] = clock.to_host(*board.say(t))
        if t > 0.1:  # a sonar sweep that began 70 ms ago
            time_ms, _ = board.say(t - 0.07)
            heard[t - 0.07] = clock.to_host(time_ms, board.arrival)
    in_order = [heard[t] for t in sorted(heard)]
    assert in_order == sorted(in_order)
    assert all(host - t == pytest.approx(LATENCY, abs=0.0015) for t, host in heard.items() if t > 5.0)


@pytest.mark.parametrize("silence", [1.0, 40.0, 64.0, 66.0, 200.0, 3600.0])
def test_silences_longer_than_the_counter_are_bridged(silence):
    board, clock = Board(drift=1e-4, jitter=0.0), BoardClock()
    listen(board, every(0.02, 0.0, 60.0), clock)
    [host] = listen(board, [60.0 + silence], clock)
    assert host == pytest.approx(60.0 + silence + LATENCY, abs=0.002 + 2e-5 * silence)


def test_a_host_that_slept_learns_the_time_from_the_uptime():
    board, clock = Board(jitter=0.0), BoardClock()
    uptime = board.uptime_ms
    for t in every(0.02, 0.0, 30.0):
        clock.to_host(uptime(t) % 65536, t)
    assert not clock.status(uptime(30.0) % 65536, uptime(30.0), 1, 30.0)
    slept = 100.0  # during which the host's monotonic clock stood still
    for t in every(0.02, 130.0, 131.0):
        assert clock.to_host(uptime(t) % 65536, t - slept) <= t - slept
    assert not clock.status(uptime(131.0) % 65536, uptime(131.0), 1, 31.0)
    assert clock.ticks == 131_000
    assert clock.to_host(uptime(131.02) % 65536, 31.02) == pytest.approx(31.02)


@pytest.mark.parametrize("first_uptime", [100, 15_000, 70_000])
def test_a_reboot_is_recognised_and_time_goes_on(first_uptime):
    old, clock = Board(jitter=0.0), BoardClock()
    assert not clock.status(0, 0, 1, LATENCY)
    listen(old, every(0.02, 0.1, 80.0), clock)
    new = Board(boot=90.0 - first_uptime / 1000, jitter=0.0)
    before = clock.to_host(*new.say(89.99))
    time_ms, arrival = new.say(90.0)
    assert clock.status(time_ms, new.uptime_ms(90.0), 2, arrival)
    assert clock.reboots == 1
    assert before <= clock.to_host(time_ms, arrival) == pytest.approx(90.0 + LATENCY)
    times = every(0.02, 90.02, 120.0)
    assert listen(new, times, clock) == pytest.approx([t + LATENCY for t in times], abs=0.002)


def test_a_reboot_without_a_new_count_shows_by_the_uptime():
    clock = BoardClock()
    assert not clock.status(200_000 % 65536, 200_000, 7, 1.0)
    clock.to_host(200_000 % 65536, 1.0)
    assert clock.status(1_000, 1_000, 7, 2.0)


def test_statuses_of_a_healthy_board_change_nothing():
    board, plain, told = Board(3, drift=1e-4), BoardClock(), BoardClock()
    for i, t in enumerate(every(0.02, 100.0, 300.0)):
        time_ms, arrival = board.say(t)
        if i % 50 == 0:
            assert not told.status(time_ms, board.uptime_ms(t), 1, arrival)
        assert plain.to_host(time_ms, arrival) == told.to_host(time_ms, arrival)
    assert told.reboots == 0


def test_a_stalled_link_does_not_bend_the_clock():
    board, clock = Board(jitter=0.002), BoardClock()
    listen(board, every(0.02, 0.0, 60.0), clock)
    board.arrival = 63.0  # three seconds come at once
    times = every(0.02, 60.0, 70.0)
    hosts = listen(board, times, clock)
    assert hosts == pytest.approx([t + LATENCY for t in times], abs=0.004)


def test_a_way_that_became_longer_for_good_is_believed():
    board, clock = Board(jitter=0.0), BoardClock()
    listen(board, every(0.02, 0.0, 60.0), clock)
    hosts = [clock.to_host(board.uptime_ms(t) % 65536, t + 1.0) for t in every(0.02, 60.0, 90.0)]
    assert hosts[-1] == pytest.approx(90.0 - 0.02 + 1.0, abs=0.01)


def test_the_echo_is_the_newest_time_of_the_board():
    clock = BoardClock()
    assert clock.newest_ms == 0
    for time_ms, arrival in ((65_500, 1.0), (4, 1.1), (65_530, 1.12)):
        clock.to_host(time_ms, arrival)
    assert clock.newest_ms == 4


def test_nearest_keeps_the_low_bits_and_is_nearest():
    rng = random.Random(1)
    for _ in range(1000):
        time_ms, expected = rng.randrange(65536), rng.randrange(10**7)
        count = nearest(time_ms, expected)
        assert count % 65536 == time_ms
        assert abs(count - expected) <= 32768
