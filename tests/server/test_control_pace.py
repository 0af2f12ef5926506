"""How often the radio hears of what a driver wishes, and that nothing moves by what it has not heard."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.control import Control, ControlParams
from server.messages import Drive, Goal, Message, Stop
from server.words import ArmWord
from tests.server.control_words import FORWARD, STILL, control, drive, goal, plain

REFRESH, TURN = ControlParams().refresh, 0.02  # s; the second is one turn of the loop
EXACT = 1e-9  # s of round-off


class Radio:
    """What a helm lets the radio hear, with the time, while the loop turns every 20 ms and somebody speaks."""

    def __init__(self, helm: Control):
        self.helm = helm
        self.t, self.turned = 0.0, 0.0
        self.heard: list[tuple[float, Message]] = []

    def wait(self, seconds: float) -> None:
        """Time passes."""
        end = self.t + seconds
        while self.turned + TURN <= end + EXACT:
            self.turned += TURN
            self.heard += [(self.turned, message) for message in self.helm.tick(self.turned)]
        self.t = end

    def say(self, wish: tuple[float, float]) -> list[tuple[float, float]]:
        """The driver's word, and what goes out at once."""
        sent = self.helm.hear("a", drive(self.t, wish), self.t)
        self.heard += [(self.t, message) for message in sent]
        return [(message.speed, message.turn) for message in sent if isinstance(message, Drive)]

    def busiest(self, seconds: float) -> int:
        """Drive commands in the window that has most of them; it holds its start and not its end."""
        times = [t for t, message in self.heard if isinstance(message, Drive)]
        return max(sum(start <= t < start + seconds - EXACT for t in times) for start in times)


@pytest.mark.parametrize("period", [0.005, 0.02, 0.08, 0.12])
def test_however_often_a_driver_speaks_the_radio_hears_the_newest_wish_ten_times_a_second(period):
    radio, words = Radio(control()), []
    for n in range(round(3.0 / period)):
        wish = (0.1 + 1e-4 * n, 0.0)
        radio.say(wish)
        words.append((radio.t, wish[0]))
        radio.wait(period)
    radio.wait(0.15)
    assert radio.busiest(1.0) <= 10
    for t, message in radio.heard:
        assert isinstance(message, Drive)
        assert message.speed >= max([speed for said, speed in words if said < t - EXACT], default=0.0), "the newest"
    for said, speed in words:
        heard = min(t for t, message in radio.heard if isinstance(message, Drive) and message.speed >= speed)
        assert heard - said <= REFRESH + TURN + EXACT


def test_a_press_and_a_halt_wait_for_nothing():
    radio = Radio(control())
    for hold, gap in ((0.07, 0.14), (0.33, 0.05), (0.5, 0.03), (0.11, 2.0), (1.0, 0.3)):
        assert radio.say(FORWARD) == [FORWARD]
        for _ in range(round(hold / 0.02)):
            radio.wait(0.02)
            radio.say(FORWARD)
        assert radio.say(STILL) == [STILL]
        radio.wait(gap)
    for word in (plain("stop"), plain("cancel"), ArmWord(type="arm", armed=False)):
        helm = control()
        helm.hear("a", drive(0.0), 0.0)
        assert Stop(0.01) in helm.hear("a", word, 0.01)
        helm.hear("a", plain("resume"), 0.01)
        helm.hear("a", drive(0.02), 0.02)
        assert helm.tick(0.1) == [Drive(0.1, *FORWARD)], "who begins anew that soon waits for the refresh"


def test_a_press_takes_over_at_once_from_what_steers_to_a_goal():
    helm = control()
    helm.hear("a", goal(0.0), 0.0)
    assert [helm.may_steer(t) for t in (0.0, 0.04, 0.08, 0.12)] == [True, False, False, True]
    assert helm.hear("a", drive(0.13), 0.13) == [Drive(0.13, *FORWARD)]
    assert not helm.may_steer(0.3), "a person's wish is repeated, and bent on the way if it is shared"


@given(st.lists(st.tuples(st.integers(0, 120), st.sampled_from([FORWARD, STILL, (-0.2, 0.0), (0.0, 1.0)])), min_size=1))
def test_whatever_a_driver_says_halts_are_heard_at_once_and_the_line_is_not_flooded(story):
    """Even one who presses and lets go all the time is not heard more than twenty times a second, and a few."""
    radio = Radio(control())
    for milliseconds, wish in story:
        radio.wait(1e-3 * milliseconds)
        radio.say(wish)
        newest = radio.heard[-1][1]
        assert isinstance(newest, Drive)
        if wish == STILL:
            assert (newest.speed, newest.turn) == STILL
    for seconds in (0.1, 0.3, 1.0):
        assert radio.busiest(seconds) <= 20.0 * seconds + 3
    radio.wait(REFRESH + TURN)
    assert isinstance(newest := radio.heard[-1][1], Drive)
    assert (newest.speed, newest.turn) == story[-1][1]


def test_a_program_that_flutters_is_heard_twice_in_every_refresh_at_most():
    for period in (0.005, 0.01, 0.02, 0.05, 0.1):
        radio = Radio(control())
        for n in range(round(4.0 / period)):
            radio.say(STILL if n % 2 else FORWARD)
            radio.wait(period)
        assert radio.busiest(2.0) <= 42


def test_a_goal_that_was_driven_over_without_a_word_on_the_radio_ends_with_its_driver():
    """A press, a goal, and a press so soon after the first that it waits; then its driver has gone."""
    helm = control()
    helm.hear("a", drive(0.00), 0.00)
    assert isinstance(helm.hear("a", goal(0.05), 0.05)[0], Goal)
    assert helm.hear("a", drive(0.06), 0.06) == []
    assert helm.hear("a", drive(0.07, STILL), 0.07) == [Drive(0.07, 0.0, 0.0)]  # it ends what the robot was told
    helm.hear("a", goal(0.08), 0.08)
    assert helm.hear("a", drive(0.09), 0.09) == []
    assert helm.leave("a", 0.10) == [Stop(0.10)]


def test_what_the_robot_was_never_told_needs_no_stop():
    helm = control()
    helm.hear("a", drive(0.00), 0.00)
    helm.hear("a", drive(0.01, STILL), 0.01)
    for n in range(50):
        t = 0.02 + 1e-3 * n
        assert helm.hear("a", drive(t), t) == []
        assert helm.hear("a", plain("cancel"), t) == []
