"""The sensor board's pure C: which sonars fire when, which echoes count, and the middle of three readings."""

import statistics

from hypothesis import given
from hypothesis import strategies as st

from firmware.virtual.native import native

FFI, LIB, _ = native()
NO_RETURN = 0xFFFF


class Schedule:
    """The C schedule, ticked every ms."""

    def __init__(self):
        self.state = FFI.new("struct sonar_schedule *")
        self.done = FFI.new("struct sonar_payload *")
        self.done_ms = FFI.new("uint32_t *")
        self.is_done = FFI.new("bool *")
        LIB.sonar_schedule_init(self.state)

    def tick(self, now):
        fired = LIB.sonar_schedule_tick(self.state, now, self.done, self.done_ms, self.is_done)
        return fired, list(self.done.echo_us) if self.is_done[0] else None


def test_two_groups_fire_forty_ms_apart_all_eight_in_turn():
    schedule = Schedule()
    fired = {now: mask for now in range(1000) if (mask := schedule.tick(now)[0])}
    assert list(fired) == list(range(0, 1000, 40))
    assert set(list(fired.values())[::2]) == {0b01010101}
    assert set(list(fired.values())[1::2]) == {0b10101010}


def test_a_sweep_is_stamped_with_its_first_slot_and_forgets_the_last_one():
    schedule = Schedule()
    sweeps = {}
    for now in range(5, 400):
        _, sweep = schedule.tick(now)
        if sweep:
            sweeps[schedule.done_ms[0]] = (now, sweep)
        if now == 10:
            LIB.sonar_schedule_echo(schedule.state, 2, 5000)
        if now == 50:
            LIB.sonar_schedule_echo(schedule.state, 3, 7000)
    assert [(first, told) for first, (told, _) in sweeps.items()] == [(5, 85), (85, 165), (165, 245), (245, 325)]
    assert sweeps[5][1] == [NO_RETURN, NO_RETURN, 5000, 7000] + 4 * [NO_RETURN]
    assert sweeps[85][1] == 8 * [NO_RETURN]


def test_only_the_first_echo_of_a_sonar_that_fired_counts():
    schedule = Schedule()
    schedule.tick(0)
    for sonar, echo in ((0, 100), (0, 6000), (0, 9000), (1, 6000), (4, 40000), (8, 6000)):
        LIB.sonar_schedule_echo(schedule.state, sonar, echo)
    assert list(schedule.state.sweep.echo_us) == [6000] + 7 * [NO_RETURN]


@given(st.lists(st.integers(0, 1023), min_size=24, max_size=24))
def test_infrared_frames_hold_the_middle_of_three_readings(readings):
    infrared = FFI.new("struct infrared *")
    done, done_ms = FFI.new("struct infrared_payload *"), FFI.new("uint32_t *")
    LIB.infrared_init(infrared)
    sets = [readings[i : i + 8] for i in (0, 8, 16)]
    taken = []
    for now in range(75, 115):
        if LIB.infrared_tick(infrared, now):
            is_done = LIB.infrared_add(infrared, sets[len(taken)], done, done_ms)
            taken.append((now, bool(is_done)))
    assert taken == [(80, False), (82, False), (84, True)]
    assert done_ms[0] == 80
    assert list(done.counts) == [statistics.median(column) for column in zip(*sets, strict=True)]
