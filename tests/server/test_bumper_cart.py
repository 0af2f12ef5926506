"""Bumper Cart's fold: stages in their order whatever comes of the link, a pose by its counters, bumps as vertices."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from firmware.virtual import load_world
from firmware.virtual.bumper_cart import CartBuild, VirtualCart
from firmware.virtual.radio import Radio
from server.commands import RunCommand, StopCommand, UploadCommand
from server.filter_worker import estimate_of
from server.messages import Arm, Cart, CartStage, Drive, Goal, Keyframe, Stop
from server.robots.bumper_cart import KEPT, LOST, BumperCart, BumperCartParams, make_estimator, runs_of
from server.session import session_of
from slam.cart_odometry import BACK, DRIVE, LEFT, MIDDLE, RIGHT, TURN, CartParams, Stage, raw_path
from slam.pose import compose

STAGES = [
    Stage(DRIVE, 300, 310, MIDDLE), Stage(BACK, -48, -47), Stage(TURN, 30, -29), Stage(DRIVE, 150, 148, MIDDLE),
]  # fmt: skip


def robot(**params) -> BumperCart:
    return BumperCart(BumperCartParams(**params))


def cart(t, left=0, right=0, logged=0, run=1, state="armed", reason="none"):
    return Cart(t, left, right, 7.5, logged, 0, "drive", 0, run, state, reason, 0)


def told(number, t=1.0, run=1, is_kept=False):
    return CartStage(t, run, number, STAGES[number % len(STAGES)], is_kept)


def test_stages_are_kept_in_their_order_and_each_once():
    made = robot()
    for number in (0, 2, 2, 1, 0, 3, 1):
        made.step(told(number))
    assert made.stages == STAGES
    made.finish()
    assert (made.stages, made.truant) == (STAGES, 0)


def test_what_is_missing_is_asked_for_after_a_moment_and_again():
    made = robot()
    made.step(cart(0.0))
    made.step(told(0, 5.0))
    assert made.step(cart(5.1, logged=1)) == []
    assert made.step(cart(5.4, logged=3)) == [], "it may be on its way"
    assert made.step(cart(6.0, logged=3)) == []
    assert made.step(cart(6.2, logged=3)) == [UploadCommand(1, 2)]
    assert made.step(cart(6.6, logged=3)) == []
    assert made.step(cart(7.3, logged=3)) == [UploadCommand(1, 2)]
    made.step(told(1, is_kept=True))
    made.step(told(2, is_kept=True))
    assert made.step(cart(15.0, logged=3)) == []
    assert made.stages == STAGES[:3]


def test_what_the_robot_keeps_no_longer_is_given_up_and_counted():
    made = robot()
    made.step(cart(0.0))
    made.step(told(3))
    asked = [made.step(cart(1.1 + 1.1 * i, logged=4)) for i in range(LOST + 1)]
    assert asked[:LOST] == [[UploadCommand(0, 4)]] * LOST
    [[bump]] = asked[LOST:]
    assert isinstance(bump, Keyframe), "what is there counts, though what was before it is lost"
    assert bump.walls == (STAGES[3],)
    assert (made.stages, made.truant, made.next_number) == ([STAGES[3]], 3, 4)
    assert made.step(cart(99.0, logged=4)) == []


def test_what_is_older_than_the_robot_s_log_is_not_asked_for():
    made = robot()
    made.step(cart(0.0))
    assert made.step(cart(2.0, logged=200)) == []
    assert (made.truant, made.next_number) == (200 - KEPT, 200 - KEPT)
    assert made.step(cart(3.5, logged=200)) == [UploadCommand(200 - KEPT, 50)]


def test_at_the_end_what_has_not_come_is_passed_over():
    made = robot()
    for number in (0, 2, 3, 6):
        made.step(told(number))
    made.finish()
    assert (len(made.stages), made.truant) == (4, 3)


def test_no_more_is_asked_for_than_the_line_takes_at_a_time():
    made = robot()
    made.step(cart(0.0))
    assert made.step(cart(2.0, logged=150)) == [UploadCommand(0, 50)]


def test_another_run_has_stages_of_its_own():
    made = robot()
    made.step(told(0))
    made.step(told(1))
    made.step(told(0, run=2))
    assert made.stages == STAGES[:1]


def test_all_runs_of_a_log_are_told_whatever_was_lost_of_them():
    messages = [told(0, 1.0), told(2, 3.0), told(0, 9.0, run=2), cart(9.1, run=3), told(0, 12.0, run=4)]
    runs = runs_of(messages, BumperCartParams())
    assert [(run.stages, run.times, run.truant) for run in runs] == [
        ([STAGES[0], STAGES[2]], [1.0, 3.0], 1),
        ([STAGES[0]], [9.0], 0),
        ([STAGES[0]], [12.0], 0),
    ]


def test_armed_it_is_told_to_run_and_otherwise_to_stand():
    made = robot(run={"bumps": 30, "seed": 7, "is_matched": True, "leash": 5})
    assert made.step(Arm(0.0)) == [RunCommand(30, 7, True, 5)]
    for message in (Arm(0.0, armed=False), Stop(0.0), Goal(0.0, (1.0, 2.0))):
        assert made.step(message) == [StopCommand()]
    assert made.step(Drive(0.0, 0.3, 0.0)) == [], "its own program drives it"


def test_its_pose_follows_the_counters_along_arcs_and_across_their_wrap():
    made = robot()
    made.step(cart(0.0, 32_700, -32_700))
    made.step(cart(0.1, 32_700 + 100 - 65_536, -32_700 + 120))
    expected = raw_path([Stage(DRIVE, 100, 120)], CartParams())[-1]
    np.testing.assert_allclose(made.odometry, expected, atol=1e-12)
    made.step(cart(0.2, 5, 5, run=0))
    np.testing.assert_allclose(made.odometry, expected, atol=1e-12, err_msg="a board that began anew counts anew")


def test_every_bump_is_a_vertex_also_one_that_was_told_late():
    made = robot()
    made.step(cart(0.0))
    made.step(cart(0.1, 300, 310))
    [keyframe] = made.step(told(0))
    assert isinstance(keyframe, Keyframe)
    np.testing.assert_allclose(keyframe.pose, made.odometry)
    assert keyframe.travelled == pytest.approx(305 * 0.0675 * 0.0254, rel=0.01)
    assert made.step(told(1)) == []
    assert made.step(CartStage(2.0, 1, 2, Stage(DRIVE, 9, 9, 0))) == [], "a drive that met nothing"
    late = CartStage(5.0, 1, 3, Stage(BACK, -40, -40), is_kept=True), CartStage(5.1, 1, 4, STAGES[0], is_kept=True)
    assert made.step(CartStage(4.0, 1, 5, STAGES[3])) == [], "it waits for what was before it"
    assert made.step(late[0]) == []
    first, second = made.step(late[1])
    assert isinstance(first, Keyframe)
    assert isinstance(second, Keyframe)
    since = [STAGES[1], Stage(DRIVE, 9, 9, 0), late[0].stage, STAGES[0]]
    assert (first.walls, second.walls) == (tuple(since), (STAGES[3],))
    assert (first.t, second.t) == (4.0, 4.0), "what was told late was before what came at once"
    reckoned = compose(keyframe.pose, raw_path(since[2:], CartParams())[-1])  # the others came at once
    np.testing.assert_allclose(first.pose, reckoned, atol=1e-9)


def test_the_robot_s_log_is_as_long_as_is_believed_here():
    header = (Path(__file__).parents[2] / "firmware" / "cart" / "log.h").read_text()
    assert f"#define CART_KEPT {KEPT} " in header


@pytest.mark.parametrize(
    ("switches", "bumper", "ends"),
    [
        (1, MIDDLE, (1, -1)),
        (3, LEFT, (1, 1 / 3)),
        (3, MIDDLE, (1 / 3, -1 / 3)),
        (3, RIGHT, (-1 / 3, -1)),
        (3, LEFT | RIGHT, (1, -1)),
    ],
)
def test_the_bar_is_as_long_as_what_its_switches_leave_open(switches, bumper, ends):
    bar = robot(build={"switches": switches}).bar(bumper)
    np.testing.assert_allclose(bar[:, 0], 0.09)
    np.testing.assert_allclose(bar[:, 1], np.array(ends) * 0.0381)


def live(cart: VirtualCart, made: BumperCart, seconds: float, bumps=0) -> None:
    """The session of a cart in simulated time."""
    session = session_of("bumper_cart", made, made.params)
    session.receive("link0", cart.advance(0.5), cart.time)
    cart.write(session.encode(RunCommand(bumps, 9)))
    while cart.time < seconds:
        for effect in session.receive("link0", cart.advance(0.02), cart.time):
            if not isinstance(effect, Keyframe):
                cart.write(session.encode(effect))


def test_over_a_line_that_loses_frames_all_stages_come_in_the_end():
    room = load_world("cut-rectangle")
    lost = VirtualCart(room, seed=3, radio=Radio(latency=0.05, chunk_loss=0.3))
    made = robot()
    live(lost, made, 90.0, bumps=8)
    log = lost.board.robot.loop.log
    assert log.count == 22
    assert len(made.stages) == 22
    assert made.truant == 0
    kept = [(log.records[i].left, log.records[i].right) for i in range(22)]
    assert [(stage.left, stage.right) for stage in made.stages] == kept


def test_dead_reckoning_is_near_the_truth_where_little_errs():
    room = load_world("cut-rectangle")
    there = VirtualCart(room, seed=2, build=CartBuild(drift="none"))
    start = there.pose
    made = robot()
    live(there, made, 30.0, bumps=3)
    apart = compose(start, made.odometry) - there.pose
    assert math.hypot(*apart[:2]) < 0.1
    assert abs(math.remainder(apart[2], 2 * math.pi)) < 0.15


def test_viewers_get_its_bumps_and_no_map_that_it_does_not_have():
    made = robot()
    made.step(cart(0.0))
    made.step(cart(0.1, 300, 310))
    [keyframe] = made.step(told(0))
    assert isinstance(keyframe, Keyframe)
    estimator = make_estimator(made.params)
    estimator.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
    made.step(estimate_of(estimator, 1.0, 10))
    shown = made.snapshot()
    assert len(shown.vertex_curves) == 1
    assert shown.walls == [], "a single bump is no wall yet"
    np.testing.assert_allclose(shown.path, [made.odometry], atol=0.15)
    assert shown.local_map.size == 0
    assert shown.cart is not None
    assert made.stop_reason == "none"
