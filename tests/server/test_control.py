"""The driver's lease: silence stops, anyone may stop, one drives, old pictures move nothing."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from server.control import Control, ControlParams, Ended, Refused
from server.messages import Arm, Drive, Goal, Stop
from server.words import WORDS, ArmWord, AutopilotWord, DriveWord, GiveWord, GoalWord, HoldWord, PlainWord
from tests.server.control_words import STILL, control, drive, goal, plain


def test_silence_stops_the_robot_after_the_lease_and_only_once():
    helm = control()
    assert helm.hear("a", drive(1.0), 1.0) == [Drive(1.0, 0.3, 0.0)]
    assert helm.tick(1.29) == [Drive(1.29, 0.3, 0.0)]
    assert helm.tick(1.31) == [Stop(1.31)]
    assert helm.tick(1.40) == []


def test_a_held_stick_is_repeated_to_the_board_at_ten_hertz():
    helm = control()
    sent = []
    for step in range(1, 201):  # 2 s; the page speaks every 80 ms, the loop turns every 10 ms
        t = 0.01 * step
        if step % 8 == 0:
            helm.hear("a", drive(t), t)
        sent += [message for message in helm.tick(t) if isinstance(message, Drive)]
    assert all(isinstance(message, Drive) for message in sent)
    helm.refreshed = -1.0
    assert [type(message) for message in helm.tick(2.05)] == [Drive]


def test_standing_still_and_silent_is_no_reason_to_stop_again():
    helm = control()
    helm.hear("a", drive(0.0, STILL), 0.0)
    assert helm.tick(1.0) == []


def test_a_goal_needs_the_lease_too():
    helm = control()
    assert helm.hear("a", goal(0.0), 0.0) == [Goal(0.0, (2.0, 1.0), 0.3)]
    for step in range(1, 11):
        helm.hear("a", HoldWord(type="hold", seen=0.1 * step), 0.1 * step)
        assert helm.tick(0.1 * step) == []
    assert helm.tick(1.31) == [Stop(1.31)]
    assert helm.goal is None


def test_who_holds_a_goal_that_is_no_more_is_told_so_and_keeps_no_lease():
    """However it ended: reached or given up, taken back, stopped by another, or never there."""
    hold = HoldWord(type="hold", seen=0.1)
    for end in (Control.arrive, lambda helm: helm.hear("a", plain("cancel"), 0.1), lambda helm: helm.stop("b", 0.1)):
        helm = control()
        helm.hear("a", goal(0.0), 0.0)
        end(helm)
        with pytest.raises(Ended):
            helm.hear("a", hold, 0.2)
        assert helm.heard == 0.0
    with pytest.raises(Ended):
        control().hear("a", hold, 0.2)


def test_anyone_may_stop_and_then_nothing_moves_until_the_driver_resumes():
    helm = control()
    helm.hear("a", drive(0.0), 0.0)
    assert helm.hear("b", plain("stop"), 0.1) == [Stop(0.1)]
    for word in (drive(0.2), goal(0.2)):
        with pytest.raises(Refused, match="Resume"):
            helm.hear("a", word, 0.2)
    assert helm.tick(0.25) == []
    with pytest.raises(Refused, match="somebody else"):
        helm.hear("b", plain("resume"), 0.3)
    helm.hear("a", plain("resume"), 0.3)
    assert helm.hear("a", drive(0.4), 0.4) == [Drive(0.4, 0.3, 0.0)]


def shared(t: float) -> DriveWord:
    """As `drive`, with the histogram's help."""
    return DriveWord(type="drive", speed=0.3, turn=0.0, seen=t, shared=True)


def asked_while_driving() -> Control:
    """a drives and b asks for control, at 0.2 s."""
    helm = control()
    helm.hear("a", drive(0.0), 0.0)
    with pytest.raises(Refused, match="ask for control"):
        helm.hear("b", drive(0.1), 0.1)
    assert helm.hear("b", plain("ask"), 0.2) == []
    assert (helm.driver, helm.asked_by) == ("a", "b")
    return helm


def test_whoever_asks_drives_at_once_where_nobody_else_does():
    helm = control()
    assert helm.hear("b", plain("ask"), 0.0) == []
    assert (helm.driver, helm.asked_by) == ("b", None)
    assert helm.hear("a", plain("ask"), 5.1) == []
    assert (helm.driver, helm.asked_by) == ("a", None), "b had long been silent"


def test_the_driver_gives_control_and_the_robot_halts_first():
    helm = asked_while_driving()
    assert helm.hear("a", GiveWord(type="give", to="b"), 0.3) == [Stop(0.3)]
    assert (helm.driver, helm.asked_by) == ("b", None)
    with pytest.raises(Refused, match="ask for control"):
        helm.hear("a", drive(0.4), 0.4)
    assert helm.hear("b", drive(0.4), 0.4) == [Drive(0.4, 0.3, 0.0)]


def test_the_driver_keeps_control_and_drives_on():
    helm = asked_while_driving()
    assert helm.hear("a", plain("keep"), 0.3) == []
    assert (helm.driver, helm.asked_by) == ("a", None)
    assert helm.tick(0.4) == [Drive(0.4, 0.3, 0.0)]


def test_only_the_driver_answers_and_only_to_who_asks():
    helm = asked_while_driving()
    for viewer, word in (
        ("b", GiveWord(type="give", to="b")),
        ("c", plain("keep")),
        ("a", GiveWord(type="give", to="c")),
    ):
        with pytest.raises(Refused):
            helm.hear(viewer, word, 0.3)
    with pytest.raises(Refused, match="before you"):
        helm.hear("c", plain("ask"), 0.3)
    assert (helm.driver, helm.asked_by) == ("a", "b")


def test_a_driver_who_does_not_answer_loses_control_standing_still():
    helm = asked_while_driving()
    t, sent = 0.2, []
    while helm.driver == "a":
        t = round(t + 0.1, 3)
        helm.hear("a", drive(t), t)
        assert helm.answer_time(t) == pytest.approx(max(0.0, 10.2 - t))
        sent = helm.tick(t)
    assert t == pytest.approx(10.2)
    assert sent == [Stop(t)]
    assert (helm.driver, helm.asked_by) == ("b", None)
    assert helm.stops.newest()[0].reason == "handed over to b"


def test_who_asks_follows_a_driver_who_leaves_and_a_new_driver_has_time_to_answer():
    helm = asked_while_driving()
    assert helm.leave("a", 0.3) == [Stop(0.3)]
    assert helm.driver == "b"
    helm = asked_while_driving()
    assert helm.leave("b", 0.3) == []
    assert (helm.driver, helm.asked_by) == ("a", None)
    helm = asked_while_driving()
    helm.hear("c", drive(6.0), 6.0)  # a has been silent: anybody may drive
    assert (helm.driver, helm.asked_by, helm.answer_time(6.0)) == ("c", "b", 10.0)


def test_asking_stops_nothing_while_the_driver_drives():
    helm = asked_while_driving()
    assert helm.tick(0.25) == [Drive(0.25, 0.3, 0.0)]


def test_a_shared_wish_is_repeated_as_one():
    helm = control()
    assert helm.hear("a", shared(0.0), 0.0) == [Drive(0.0, 0.3, 0.0, shared=True)]
    assert helm.tick(0.1) == [Drive(0.1, 0.3, 0.0, shared=True)]
    assert helm.tick(0.4) == [Stop(0.4)]


def test_every_stop_has_its_reason_and_its_author():
    helm = control()
    helm.hear("a", drive(0.0), 0.0)
    helm.tick(0.4)
    helm.hear("a", drive(1.0), 1.0)
    helm.hear("b", plain("stop"), 1.1)
    helm.hear("b", plain("stop"), 1.2)  # the same stop
    helm.hear("a", plain("resume"), 2.0)
    helm.hear("a", drive(2.1), 2.1)
    helm.leave("a", 2.2)
    told = [(entry.t, entry.reason, entry.by) for entry in helm.stops.newest()]
    assert told == [(2.2, "the driver left", "a"), (1.1, "pressed Stop", "b"), (0.4, "the driver fell silent", "a")]


def test_a_driver_who_has_long_been_silent_may_be_followed_without_asking():
    helm = control()
    helm.hear("a", drive(0.0, STILL), 0.0)
    assert helm.hear("b", drive(6.0), 6.0) == [Drive(6.0, 0.3, 0.0)]
    assert helm.driver == "b"


@pytest.mark.parametrize("seen", [3.4, 5.1], ids=["old", "from the future"])
def test_words_in_front_of_another_picture_move_nothing(seen):
    helm = control()
    for word in (DriveWord(type="drive", speed=0.3, turn=0.0, seen=seen), GoalWord(type="goal", x=0, y=0, seen=seen)):
        with pytest.raises(Refused, match="too old"):
            helm.hear("a", word, 5.0)
    assert helm.driver is None


def test_a_silent_robot_is_not_driven_but_stopped():
    helm = control()
    helm.read = 3.4
    for word in (drive(5.0), goal(5.0), HoldWord(type="hold", seen=5.0)):
        if isinstance(word, HoldWord):
            helm.driver, helm.goal = "a", Goal(3.4, (2.0, 1.0), 0.3)
        with pytest.raises(Refused, match="silent"):
            helm.hear("a", word, 5.0)
    assert helm.hear("a", plain("stop"), 5.0) == [Stop(5.0)]
    helm.hear("a", plain("resume"), 5.1)
    helm.read = 5.1
    assert helm.hear("a", drive(5.1), 5.2) == [Drive(5.2, 0.3, 0.0)]


def test_a_driver_who_leaves_stops_the_robot_and_others_do_not():
    helm = control()
    helm.hear("a", drive(0.0), 0.0)
    assert helm.leave("b", 0.1) == []
    assert helm.leave("a", 0.1) == [Stop(0.1)]
    assert helm.driver is None


def test_driving_ends_a_goal_and_a_zero_does_not():
    helm = control()
    helm.hear("a", goal(0.0), 0.0)
    assert helm.hear("a", drive(0.1, STILL), 0.1) == [], "letting go of a key is no wish against the goal"
    assert helm.goal is not None
    helm.hear("a", drive(0.2), 0.2)
    assert helm.goal is None


def test_driving_takes_over_from_the_autopilot_and_stop_ends_it():
    for word in (drive(0.0), goal(0.0), plain("stop")):
        helm = control(autopilot=True)
        helm.hear("a", word, 0.0)
        assert helm.autopilot is False
    helm = control(autopilot=False)
    assert helm.hear("a", AutopilotWord(type="autopilot", on=True), 0.0) == [Arm(0.0, True)]
    assert helm.autopilot is True
    assert helm.hear("a", AutopilotWord(type="autopilot", on=False), 0.1) == [Stop(0.1)]


def test_autopilot_stays_off_where_there_is_none_or_a_stop_holds():
    with pytest.raises(Refused, match="no autopilot"):
        control().hear("a", AutopilotWord(type="autopilot", on=True), 0.0)
    helm = control(autopilot=False)
    helm.hear("b", plain("stop"), 0.0)
    with pytest.raises(Refused, match="Resume"):
        helm.hear("a", AutopilotWord(type="autopilot", on=True), 0.1)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_wishes_are_kept_within_limits(speed, turn):
    sent = control().hear("a", drive(0.0, (speed, turn)), 0.0)
    assert isinstance(sent[0], Drive)
    assert abs(sent[0].speed) <= 0.5
    assert abs(sent[0].turn) <= 1.5


WISHES = st.sampled_from(
    [
        "drive", "zero", "goal", "hold", "stop", "resume", "ask", "give", "keep", "release", "cancel", "leave",
        "disarm", "wait",
    ]
)  # fmt: skip
PAUSES = st.sampled_from([0.0, 0.01, 0.04, 0.09, 0.16, 0.4])  # s


@given(st.lists(st.tuples(st.sampled_from("ab"), WISHES, PAUSES), max_size=40))
def test_whatever_is_said_nothing_moves_longer_than_a_lease_after_the_last_word(story):
    """Nor after its driver has ended it in any way: the last that the robot was told is then nothing that moves."""
    helm, t, moves = control(), 0.0, False
    for viewer, wish, pause in [*story, ("a", "wait", 0.31)]:
        t += pause
        words = {
            "drive": drive(t), "zero": drive(t, STILL), "goal": goal(t), "hold": HoldWord(type="hold", seen=t),
            "give": GiveWord(type="give", to="ab".replace(viewer, "")), "disarm": ArmWord(type="arm", armed=False),
        }  # fmt: skip
        is_driver = viewer == helm.driver
        try:
            if wish == "wait":
                sent = helm.tick(t)
            elif wish == "leave":
                sent = helm.leave(viewer, t)
            else:
                sent = helm.hear(viewer, words.get(wish) or plain(wish), t)
        except Refused:
            continue
        for message in sent:
            if isinstance(message, Drive):
                moves = (message.speed, message.turn) != STILL
            elif isinstance(message, Goal | Stop):
                moves = isinstance(message, Goal)
        if wish == "stop" or (is_driver and wish in ("release", "cancel", "leave", "disarm")):
            assert not moves
    assert not moves


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        "[]",
        "null",
        '{"type": "fly"}',
        '{"type": "drive", "speed": "fast", "turn": 0, "seen": 0}',
        '{"type": "drive", "speed": NaN, "turn": 0, "seen": 0}',
        '{"type": "drive", "speed": 1e999, "turn": 0, "seen": 0}',
        '{"type": "drive", "speed": 0, "turn": 0}',
        '{"type": "stop", "why": "because"}',
        '{"type": "goal", "x": 1e30, "y": 0, "seen": 0}',
        '{"type": "ack", "seq": -1}',
        '{"type": "arm", "armed": 1}',
    ],
)
def test_nonsense_is_no_word(text):
    with pytest.raises(ValidationError):
        WORDS.validate_json(text)


def test_whole_numbers_are_fine_as_javascript_writes_them():
    assert WORDS.validate_json('{"type": "drive", "speed": 0, "turn": 1, "seen": 2}') == drive(2.0, (0.0, 1.0))


def test_every_stop_and_disarming_is_in_the_log():
    helm = Control(ControlParams())
    helm.hear("a", PlainWord(type="stop"), 1.0)
    helm.hear("b", PlainWord(type="stop"), 2.0)
    helm.hear("a", ArmWord(type="arm", armed=False), 3.0)
    helm.hear("a", ArmWord(type="arm", armed=True), 4.0)
    told = [(entry.t, entry.reason, entry.by) for entry in helm.stops.newest()]
    assert told == [(3.0, "disarmed", "a"), (2.0, "pressed Stop", "b"), (1.0, "pressed Stop", "a")]


def test_a_robot_that_runs_itself_is_told_to_begin_and_to_end_and_nothing_else():
    helm = Control(ControlParams(), runs_itself=True)
    for word in (drive(1.0), goal(1.0), HoldWord(type="hold", seen=1.0)):
        with pytest.raises(Refused, match="drives by itself"):
            helm.hear("a", word, 1.0)
    assert helm.driver is None
    assert helm.hear("a", ArmWord(type="arm", armed=True), 1.0) == [Arm(1.0, True)]
    assert helm.tick(9.0) == [], "it runs on without anybody's lease"
    assert helm.leave("a", 9.5) == []
    assert helm.hear("b", ArmWord(type="arm", armed=False), 10.0) == [Arm(10.0, False)]


def test_after_a_stop_no_run_begins_until_somebody_resumes():
    helm = Control(ControlParams(), runs_itself=True)
    assert helm.hear("a", plain("stop"), 1.0) == [Stop(1.0)]
    with pytest.raises(Refused, match="press Resume"):
        helm.hear("a", ArmWord(type="arm", armed=True), 2.0)
    helm.hear("a", plain("resume"), 3.0)
    assert helm.hear("a", ArmWord(type="arm", armed=True), 4.0) == [Arm(4.0, True)]
