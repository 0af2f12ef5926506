"""The bumper cart's pure C: the states of its program, and the stages that it records."""

from __future__ import annotations

import numpy as np
import pytest

from firmware.virtual.native import native
from slam.cart_odometry import BACK, DRIVE, LEFT, MIDDLE, RIGHT, TURN, Stage

FFI, LIB, _ = native()
STAND, DRIVES, BACKS = range(3)
DRIVE_MS, BACK_MS, TURN_MS, REST_MS, CLOSED_MS = 20_000, 3000, 4000, 250, 15
BACK_TICKS, LEAST_TURN, MOST_TURN = 94, 30, 117


class Bench:
    """The program by itself, with counters and switches that the test moves."""

    def __init__(self, bumps=0, seed=1, is_matched=False):
        self.program = FFI.new("struct cart_program *")
        self.sensed = FFI.new("struct cart_sensed *")
        self.ended = FFI.new("struct cart_stage *")
        self.stages: list[Stage] = []
        LIB.cart_program_init(self.program)
        LIB.cart_program_start(self.program, FFI.new("struct cart_orders *", (bumps, seed, is_matched, False)))

    def pass_ms(self, ms=1, bumper=0, left=0, right=0):
        """Let time pass with the wheels at so many ticks in each ms."""
        for _ in range(ms):
            self.sensed.bumper = bumper
            for side, ticks in enumerate((left, right)):
                self.sensed.ticks[side] = (self.sensed.ticks[side] + ticks) % 65536
            if LIB.cart_program_step(self.program, self.sensed, self.ended):
                stage = self.ended
                self.stages.append(Stage(stage.kind, stage.left, stage.right, stage.bumper))

    @property
    def powers(self):
        return tuple(self.program.wanted)

    def follow(self, ms=1):
        """Let the wheels obey: a tick each 10 ms towards where they are driven."""
        for _ in range(ms):
            signs = [int(np.sign(power)) for power in self.powers] if self.program.stage_ms % 10 == 9 else [0, 0]
            self.pass_ms(1, 0, *signs)

    def bump(self, bumper=MIDDLE):
        self.pass_ms(CLOSED_MS, bumper)
        self.pass_ms(REST_MS)


def test_it_drives_until_a_switch_is_closed_and_records_the_ticks_of_its_rest_as_well():
    made = Bench()
    made.pass_ms(100, 0, 1, 2)
    assert made.program.state == DRIVES
    assert made.powers == (6000, 6000)
    made.pass_ms(CLOSED_MS - 1, MIDDLE, 1, 1)
    assert made.powers == (6000, 6000)
    made.pass_ms(1, MIDDLE, 1, 1)
    assert made.powers == (0, 0)
    made.pass_ms(20, 0, -1, 0)
    made.pass_ms(REST_MS, 0)
    assert made.stages == [Stage(DRIVE, 100 + CLOSED_MS - 20, 200 + CLOSED_MS, MIDDLE)]
    assert made.program.state == BACKS


def test_a_switch_that_bounces_ends_nothing():
    made = Bench()
    for _ in range(100):
        made.pass_ms(CLOSED_MS - 1, RIGHT)
        made.pass_ms(1, 0)
    assert (made.program.state, made.stages) == (DRIVES, [])


def test_all_switches_that_close_while_it_comes_to_stand_are_recorded():
    made = Bench()
    made.pass_ms(CLOSED_MS, LEFT)
    made.pass_ms(50, RIGHT)
    made.pass_ms(REST_MS, 0)
    assert made.stages[0].bumper == LEFT | RIGHT


def test_it_backs_up_turns_and_drives_off():
    made = Bench()
    made.bump()
    assert (made.program.state, made.powers) == (BACKS, (0, 0))
    made.pass_ms(1)
    assert made.powers == (-6000, -6000)
    made.follow(1500)
    kinds = [stage.kind for stage in made.stages]
    assert kinds == [DRIVE, BACK, TURN][: len(kinds)]
    back = made.stages[1]
    assert BACK_TICKS <= -(back.left + back.right) <= BACK_TICKS + 2
    made.follow(1500)
    turn = made.stages[2]
    assert turn.kind == TURN
    assert LEAST_TURN <= abs(turn.right - turn.left) <= MOST_TURN + 2
    assert abs(turn.left + turn.right) <= 1
    assert (made.program.state, made.powers) == (DRIVES, (6000, 6000))


def turns_of(seed, count=400):
    made = Bench(seed=seed)
    turns = []
    while len(turns) < count:
        made.pass_ms(1)
        made.pass_ms(CLOSED_MS, MIDDLE)
        made.pass_ms(REST_MS)
        made.pass_ms(1, 0, -BACK_TICKS // 2, -BACK_TICKS // 2)
        made.pass_ms(REST_MS)
        turns.append(int(made.program.turn_ticks))
        made.pass_ms(1, 0, -MOST_TURN, MOST_TURN)
        made.pass_ms(REST_MS)
    return np.array(turns)


def test_turns_are_random_to_both_sides_and_over_their_whole_range():
    turns = turns_of(7)
    assert abs(np.mean(turns > 0) - 0.5) < 4 * 0.5 / np.sqrt(len(turns))
    sizes = np.abs(turns)
    assert (sizes.min(), sizes.max()) >= (LEAST_TURN, LEAST_TURN)
    assert sizes.min() < LEAST_TURN + 5
    assert MOST_TURN - 5 < sizes.max() <= MOST_TURN
    middle, spread = 0.5 * (LEAST_TURN + MOST_TURN), (MOST_TURN - LEAST_TURN) / np.sqrt(12)
    assert abs(sizes.mean() - middle) < 4 * spread / np.sqrt(len(turns))
    assert abs(np.corrcoef(turns[:-1], turns[1:])[0, 1]) < 4 / np.sqrt(len(turns))


def test_the_same_seed_turns_alike_and_seed_0_is_one_too():
    assert np.array_equal(turns_of(3, 20), turns_of(3, 20))
    assert not np.array_equal(turns_of(3, 20), turns_of(4, 20))
    assert len(set(turns_of(0, 20))) > 5


@pytest.mark.parametrize(
    ("until", "limit", "kind"),
    [(0, DRIVE_MS, DRIVE), (1, BACK_MS, BACK), (2, TURN_MS, TURN)],
    ids=["drive", "back", "turn"],
)
def test_a_stage_that_does_not_end_fails_in_time(until, limit, kind):
    made = Bench()
    if until > 0:
        made.bump()
    if until > 1:
        made.pass_ms(1, 0, -BACK_TICKS // 2, -BACK_TICKS // 2)
        made.pass_ms(REST_MS)
    before = len(made.stages)
    made.pass_ms(limit - 1)
    assert made.powers != (0, 0)
    made.pass_ms(1)
    assert made.powers == (0, 0)
    made.pass_ms(REST_MS)
    assert len(made.stages) == before + 1
    assert made.stages[-1] == Stage(kind, 0, 0, 0)


def test_the_last_bump_ends_the_run():
    made = Bench(bumps=2)
    made.bump()
    made.follow(3000)
    assert made.program.state == DRIVES
    made.bump()
    assert (made.program.state, made.powers) == (STAND, (0, 0))
    made.pass_ms(1000, MIDDLE, 1, 1)
    assert [stage.kind for stage in made.stages] == [DRIVE, BACK, TURN, DRIVE]


def test_counts_beyond_sixteen_bits_stay_at_their_limits():
    made = Bench()
    made.pass_ms(1000, 0, 40, -40)
    made.bump()
    assert made.stages == [Stage(DRIVE, 32_767, -32_768, MIDDLE)]


@pytest.mark.parametrize("is_matched", [True, False])
def test_matched_wheels_are_kept_at_the_same_count_and_others_are_not(is_matched):
    """The wheels are as unlike as a tenth."""
    made = Bench(is_matched=is_matched)
    ways, shown = np.zeros(2), np.zeros(2, int)
    for _ in range(5000):
        ways += np.array(made.powers) / 6000 * 0.08 * (1.05, 0.95)
        ticks = np.floor(ways).astype(int) - shown
        shown += ticks
        made.pass_ms(1, 0, *(int(each) for each in ticks))
    apart = abs(shown[0] - shown[1])
    assert apart <= 3 if is_matched else apart == pytest.approx(40, abs=2)
