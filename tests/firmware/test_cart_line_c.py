"""The bumper cart's pure C on the line: what it obeys and tells, its log, and what stops it."""

from __future__ import annotations

import random
import struct
import zlib

import numpy as np
import pytest

from firmware.virtual import load_world
from firmware.virtual.bumper_cart import CartBuild, VirtualCart, run_cart
from firmware.virtual.native import native
from server import channels
from server.commands import ArmCommand, DriveCommand, PowersCommand, RunCommand, StopCommand, UploadCommand
from server.link import Frame, encode
from server.messages import CartStage
from slam.cart_odometry import BACK, DRIVE, MIDDLE, TURN
from tests.firmware.cart_host import CartHost

FFI, LIB, _ = native()
ROOM = load_world("cut-rectangle")
KEPT = 192


def host(seed=1, **build):
    return CartHost(VirtualCart(ROOM, seed=seed, build=CartBuild(**build)))


def test_a_run_over_the_line_is_told_stage_by_stage():
    made = host()
    assert (made.now.state, made.now.reason, made.now.doing) == ("disarmed", "boot", "stand")
    made.send(RunCommand(bumps=4, seed=9))
    made.wait(500)
    assert (made.now.state, made.now.reason, made.now.doing, made.now.run) == ("armed", "none", "drive", 1)
    made.wait(60_000)
    now = made.now
    assert (now.state, now.reason, now.doing, now.bumps, now.logged) == ("disarmed", "none", "stand", 4, 10)
    stages = made.stages()
    assert [stage.kind for stage in stages] == [DRIVE, BACK, TURN] * 3 + [DRIVE]
    assert {stage.bumper for stage in stages if stage.kind == DRIVE} == {MIDDLE}
    assert [told.number for told in made.told(CartStage)] == list(range(10))
    first = made.heard[0].sequence
    assert [frame.sequence for frame in made.heard] == [(first + i) % 256 for i in range(len(made.heard))]


def test_the_line_and_the_python_call_move_the_same_cart():
    stages, truth = run_cart(ROOM, 4, 6)
    cart = VirtualCart(ROOM, seed=4)
    cart.write(encode(channels.encode_command(RunCommand(6, 9), 1, 0)))
    made = CartHost(cart)
    made.wait(120_000)
    assert made.now.state == "disarmed"
    assert made.stages() == stages
    np.testing.assert_allclose(made.cart.pose, truth[-1], atol=5e-3)  # it still settles after the run's end


def test_a_stop_stops_it_at_once_however_old_and_the_stage_under_way_is_not_recorded():
    made = host()
    made.send(RunCommand(seed=9))
    made.wait(1000)
    made.send(StopCommand(), age_ms=5000)
    made.wait(300)
    assert (made.now.state, made.now.reason, made.now.doing, made.now.logged) == ("disarmed", "command", "stand", 0)
    place = made.cart.pose
    made.wait(1000)
    np.testing.assert_allclose(made.cart.pose, place, atol=1e-4)


def test_a_leash_stops_a_run_that_nobody_hears_and_an_upload_of_nothing_holds_it():
    made = host()
    made.send(RunCommand(seed=9, leash=2))
    made.wait(1900)
    made.send(UploadCommand(0, 0))
    made.wait(1900)
    assert made.now.state == "armed"
    made.wait(300)
    assert (made.now.state, made.now.reason) == ("link lost", "link")


def test_a_run_without_a_leash_needs_no_host():
    made = host()
    made.send(RunCommand(seed=9))
    made.wait(120_000)
    assert made.now.state == "armed"
    assert made.now.bumps > 8


def test_the_log_is_told_again_from_where_it_is_asked_for():
    made = host()
    made.send(RunCommand(bumps=5, seed=9))
    made.wait(90_000)
    made.send(UploadCommand(4, 6))
    made.wait(500)
    assert made.stages(is_kept=True) == made.stages()[4:10]
    made.send(UploadCommand(0, 0xFFFF))
    made.wait(1000)
    assert made.stages(is_kept=True)[6:] == made.stages()
    made.send(UploadCommand(500, 3))
    made.wait(500)
    assert len(made.stages(is_kept=True)) == 6 + len(made.stages())


def test_a_new_run_begins_a_log_of_its_own():
    made = host()
    for run in (1, 2):
        made.send(RunCommand(bumps=1, seed=run))
        made.wait(20_000)
    assert [(told.run, told.number) for told in made.told(CartStage)] == [(1, 0), (2, 0)]


def test_the_log_is_a_ring_of_the_newest():
    log = FFI.new("struct cart_log *")
    stage = FFI.new("struct cart_stage *")
    LIB.cart_log_clear(log)
    assert not LIB.cart_log_get(log, 0, stage)
    for number in range(500):
        LIB.cart_log_add(log, FFI.new("struct cart_stage *", (number % 3, number % 8, number, -number)))
    assert LIB.cart_log_first(log) == 500 - KEPT
    for number in (500 - KEPT, 400, 499):
        assert LIB.cart_log_get(log, number, stage)
        assert (stage.kind, stage.bumper, stage.left, stage.right) == (number % 3, number % 8, number, -number)
    for number in (500 - KEPT - 1, 500, 65_535):
        assert not LIB.cart_log_get(log, number, stage)


def test_a_log_that_is_full_of_numbers_counts_no_further():
    log = FFI.new("struct cart_log *")
    log.count = 65_534
    for _ in range(5):
        LIB.cart_log_add(log, FFI.new("struct cart_stage *", (0, 0, 1, 1)))
    assert log.count == 65_535


def raw(bumps, seed, manner, leash, echo_ms, spoil=0, source=channels.HOST, channel=channels.RUN_COMMAND):
    payload = struct.pack("<HHBBH", bumps, seed, manner, leash, echo_ms)
    return encode(Frame(source, channel, 99, 0, payload + struct.pack("<I", zlib.crc32(payload) ^ spoil)))


@pytest.mark.parametrize(
    "spoilt",
    [
        {"spoil": 1},
        {"echo_ms": 2000 - 1001},
        {"echo_ms": 2041},
        {"manner": 4},
        {"source": channels.CART},
        {"channel": channels.POWERS_COMMAND},
        {"channel": channels.ADJUST_COMMAND},
        {"channel": channels.UPLOAD_COMMAND},
    ],
    ids=str,
)
def test_what_is_corrupt_stale_or_unknown_is_refused_and_counted(spoilt):
    good = {"bumps": 1, "seed": 1, "manner": 1, "leash": 0, "echo_ms": 1500}
    made = CartHost(VirtualCart(ROOM, seed=1), 2000)
    made.cart.write(raw(**(good | spoilt)))
    made.wait(200)
    loop = made.cart.board.robot.loop
    assert (made.now.state, made.now.acknowledged, loop.supervisor.refused) == ("disarmed", 0, 1)
    made.cart.write(raw(**good))
    made.wait(200)
    assert (made.now.state, made.now.acknowledged, loop.supervisor.refused) == ("armed", 99, 1)


def test_other_robots_commands_move_nothing():
    made = host()
    for command in (DriveCommand(0.3, 0.0), ArmCommand(True), PowersCommand(1.0, 1.0, 1.0)):
        made.send(command)
    made.wait(500)
    assert made.cart.board.robot.loop.supervisor.refused == 3
    assert (made.now.state, made.now.doing) == ("disarmed", "stand")


def test_no_corrupted_command_of_ten_thousand_is_accepted():
    rng = random.Random(1)
    made = host()
    for _ in range(10_000):
        command = RunCommand(rng.randrange(65_536), rng.randrange(65_536)) if rng.random() < 0.7 else StopCommand()
        sound = encode(made.frame(command))
        spoilt = bytearray(sound[:-1])
        for bit in rng.sample(range(8 * len(spoilt)), rng.randrange(1, 9)):
            spoilt[bit // 8] ^= 1 << bit % 8
        made.cart.write(bytes(spoilt) + sound[-1:])
        supervisor = made.cart.board.robot.loop.supervisor
        assert (supervisor.acknowledged, supervisor.state) == (0, 0), (sound, spoilt)


def test_an_empty_battery_stops_it_until_it_has_recovered():
    supervisor = FFI.new("struct cart_supervisor *")
    run = FFI.new("struct cart_command *", {"kind": LIB.CART_RUN})
    LIB.cart_supervisor_init(supervisor, 9)
    LIB.cart_supervisor_obey(supervisor, run)
    for _ in range(999):
        LIB.cart_supervisor_step(supervisor, 5900)
        assert supervisor.state == 1
    LIB.cart_supervisor_step(supervisor, 5900)
    assert (supervisor.state, channels.REASONS[supervisor.reason]) == (4, "battery")
    LIB.cart_supervisor_obey(supervisor, run)
    for _ in range(5000):
        LIB.cart_supervisor_step(supervisor, 6500)
    assert supervisor.state == 4, "without its load it shows more and is empty still"
    for _ in range(1000):
        LIB.cart_supervisor_step(supervisor, 6700)
    assert (supervisor.state, channels.REASONS[supervisor.reason]) == (0, "battery")
    LIB.cart_supervisor_obey(supervisor, run)
    assert supervisor.state == 1


def test_a_flat_battery_ends_the_virtual_cart_s_run():
    made = host()
    made.send(RunCommand(seed=9))
    made.wait(2000)
    made.cart.board.robot.body.charge = 0.0
    made.wait(1500)
    assert (made.now.state, made.now.reason, made.now.doing) == ("fault", "battery", "stand")
    made.send(RunCommand(seed=9))
    made.wait(500)
    assert (made.now.state, made.now.acknowledged) == ("fault", made.sequence)


def test_three_drives_that_meet_nothing_end_the_run():
    lifted = FFI.new("struct cart_supervisor *")
    LIB.cart_supervisor_init(lifted, 9)
    LIB.cart_supervisor_obey(lifted, FFI.new("struct cart_command *", {"kind": LIB.CART_RUN}))
    for bumper, state in ((0, 1), (0, 1), (2, 1), (0, 1), (0, 1), (0, 0)):
        LIB.cart_supervisor_note(lifted, FFI.new("struct cart_stage *", (DRIVE, bumper, 9, 9)), False)
        assert lifted.state == state
    assert channels.REASONS[lifted.reason] == "blocked"


@pytest.mark.parametrize(("cause", "reason"), [(1, "boot"), (4, "boot"), (8, "watchdog")])
def test_after_a_start_it_stands_and_says_why(cause, reason):
    loop, outbox = FFI.new("struct cart_loop *"), FFI.new("struct outbox *")
    room = FFI.new("uint8_t[128]")
    LIB.outbox_init(outbox, room, 128)
    LIB.cart_loop_init(loop, FFI.new("struct boot *", {"reset_cause": cause, "count": 1}), outbox)
    assert (loop.supervisor.state, channels.REASONS[loop.supervisor.reason]) == (0, reason)
