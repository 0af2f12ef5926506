"""The loop's pulse: quantiles of how late its beats came, of the last of them only."""

from server.pulse import BEATS, Lateness, Pulse


def test_nothing_is_late_before_the_first_beat():
    assert Pulse().lateness() == Lateness(0.0, 0.0, 0.0)


def test_the_tail_shows_what_stood_in_the_way():
    pulse = Pulse()
    for _ in range(97):
        pulse.beat(0.001)
    for _ in range(3):
        pulse.beat(0.25)
    late = pulse.lateness()
    assert late.p50 == 0.001
    assert late.p99 == late.worst == 0.25


def test_an_early_beat_is_not_late_and_old_ones_are_forgotten():
    pulse = Pulse()
    pulse.beat(5.0)
    for _ in range(BEATS):
        pulse.beat(-0.001)
    assert pulse.lateness().worst == 0.0
