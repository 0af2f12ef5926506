"""The bumper cart's real program under simavr: it drives the same body as the same C here does, and stops as it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware.virtual import load_world
from firmware.virtual.avr.cart import ENABLES, FORWARD, MS_CYCLES, REVERSE
from firmware.virtual.bumper_cart import CartBuild, VirtualCart
from server.commands import RunCommand, StopCommand, UploadCommand
from server.messages import Cart, Status
from slam.cart_odometry import LEFT, MIDDLE, RIGHT
from tests.firmware.avr_robot import RAM
from tests.firmware.avr_tools import need_simavr
from tests.firmware.cart_host import CartHost

ROOM = load_world("cut-rectangle")
LINE_MS = 10  # a command of 20 bytes on the line, and the step that obeys it
WATCHDOG_RESET = 8
ADCSRA = 0x26  # in the data space


def host(ms=200, seed=1, **build):
    need_simavr()
    return CartHost(VirtualCart(ROOM, seed=seed, build=CartBuild(**build), board="avr"), ms)


def outputs(made):
    board = made.cart.board
    directions = [("C", pin) for pin in (*FORWARD, *REVERSE)]
    return [board.is_high(*pin) for pin in (*directions, *(("D", pin) for pin in ENABLES))]


def test_it_boots_without_power_and_stands():
    made = host(0)
    place = made.cart.pose
    for _ in range(1000):
        made.wait(1)
        assert made.cart.board.powers == (0.0, 0.0)
    assert {(cart.state, cart.reason, cart.doing) for cart in made.told(Cart)} == {("disarmed", "boot", "stand")}
    status = made.told(Status)[-1]
    assert (status.version, status.reset_cause, status.boot_count, status.rx_errors) == (1, 1, 1, 0)
    assert made.now.battery_volts == pytest.approx(8.1, abs=0.1)
    np.testing.assert_allclose(made.cart.pose, place, atol=1e-6)


def test_its_pins_drive_forward_back_and_against_each_other():
    made = host()
    made.send(RunCommand(bumps=3, seed=9))
    seen = set()
    for _ in range(30_000):
        made.wait(1)
        left, right = made.cart.board.powers
        seen.add((made.now.doing, np.sign(left), np.sign(right)))
    assert {("drive", 1, 1), ("back", -1, -1)} <= seen
    assert {("turn", 1, -1), ("turn", -1, 1)} & seen
    assert ("stand", 0, 0) in seen


def test_a_wheel_without_power_is_shorted_and_not_left_to_coast():
    made = host()
    made.wait(10)
    assert outputs(made) == [True] * 4 + [False] * 2


def test_both_builds_make_the_same_run():
    """The real board senses within a ms of the other and hears the command later, so that ticks differ a little."""
    made = host(seed=4, drift="none"), CartHost(VirtualCart(ROOM, seed=4, build=CartBuild(drift="none")))
    for each in made:
        each.send(RunCommand(bumps=8, seed=9))
        each.wait(70_000)
        assert each.now.state == "disarmed"
    avr, here = (np.array([[*stage] for stage in each.stages()]) for each in made)
    assert len(avr) == len(here) == 22
    assert np.array_equal(avr[:, 0], here[:, 0])
    assert np.array_equal(avr[:, 3], here[:, 3])
    assert np.abs(avr[:10, 1:3] - here[:10, 1:3]).max() <= 4
    apart = made[0].cart.pose - made[1].cart.pose
    assert math.hypot(*apart[:2]) < 0.1


def test_each_switch_is_told_by_its_own_bit(monkeypatch):
    made = host(switches=3)
    board = made.cart.board
    show = board._show
    for pin, bit in ((2, LEFT), (3, MIDDLE), (4, RIGHT)):

        def show_closed(pin=pin):
            show()
            board.lib.microcontroller_pin(board.mcu, b"B", pin, False)

        monkeypatch.setattr(board, "_show", show_closed)
        made.wait(250)
        assert made.now.bumper == bit


def test_a_stop_and_a_leash_stop_it():
    made = host()
    made.send(RunCommand(seed=9))
    made.wait(1000)
    assert made.cart.board.powers[0] > 0.5
    made.send(StopCommand(), age_ms=5000)
    made.wait(LINE_MS)
    assert made.cart.board.powers == (0.0, 0.0)
    made.send(RunCommand(seed=9, leash=1))
    made.wait(900)
    assert made.cart.board.powers[0] > 0.5
    made.wait(200)
    assert (made.now.state, made.now.reason, made.cart.board.powers) == ("link lost", "link", (0.0, 0.0))


def test_its_log_is_told_again():
    made = host()
    made.send(RunCommand(bumps=3, seed=9))
    made.wait(40_000)
    made.send(UploadCommand(0, 100))
    made.wait(500)
    assert made.stages(is_kept=True) == made.stages()
    assert len(made.stages()) == 7


@pytest.mark.parametrize("is_deaf", [True, False], ids=["deaf", "interrupts go on"])
def test_a_hang_ends_in_a_reset_with_the_motors_off_and_is_told(is_deaf):
    made = host()
    made.send(RunCommand(seed=9))
    made.wait(500)
    assert made.cart.board.powers[0] > 0.5
    made.cart.board.lib.microcontroller_hang(made.cart.board.mcu, is_deaf)
    made.wait(140)
    assert made.cart.board.powers == (0.0, 0.0)
    made.wait(1000)
    assert (made.now.state, made.now.reason) == ("disarmed", "watchdog")
    assert made.told(Status)[-1].reset_cause == WATCHDOG_RESET


def test_a_converter_that_stands_still_ends_in_a_reset():
    made = host()
    made.send(RunCommand(seed=9))
    made.wait(500)
    made.cart.board.lib.microcontroller_poke(made.cart.board.mcu, ADCSRA, 0)
    made.wait(140)
    assert made.cart.board.powers == (0.0, 0.0)
    made.wait(300)
    assert made.now.reason == "watchdog"


def test_it_takes_little_of_its_microcontroller():
    made = host()
    lib, mcu = made.cart.board.lib, made.cart.board.mcu
    lib.microcontroller_longest_awake(mcu)  # the start is another matter
    made.send(RunCommand(bumps=3, seed=9))
    made.wait(30_000)
    made.send(UploadCommand(0, 100))
    made.wait(1000)
    assert RAM - lib.microcontroller_untouched(mcu) < 0.85 * RAM
    assert lib.microcontroller_longest_awake(mcu) < 0.8 * MS_CYCLES
    assert lib.microcontroller_overruns(mcu) == 0
    status = made.told(Status)[-1]
    assert status.worst_loop < 0.8e-3
    assert status.rx_errors == 0
    assert made.decoder.rejected == 0
