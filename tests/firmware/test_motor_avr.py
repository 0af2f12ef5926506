"""The motor board's real program under simavr: its pins do what it was told, and nothing else."""

from itertools import pairwise

import pytest

from firmware.virtual.avr.motor_board import MS_CYCLES, AvrMotorBoard
from firmware.virtual.motor_board import MotorBoard
from server.commands import PowersCommand, StopCommand
from server.messages import Motors, Status
from tests.firmware.avr_robot import RAM
from tests.firmware.avr_tools import need_simavr
from tests.firmware.motor_host import Host

OFF = (0.0, 0.0)
LINE_MS = 6  # a command of 20 bytes on the line, and the step that obeys it
PINS = [("B", 0), ("B", 1), ("B", 2), ("B", 3), ("D", 4), ("D", 5)]
WATCHDOG_RESET = 8
ADCSRA, TCCR1A, TCCR1B, ICR1 = 0x26, 0x4F, 0x4E, 0x46  # in the data space


def host(ms=100):
    need_simavr()
    return Host(AvrMotorBoard(), ms)


def pins(made):
    return [made.board.is_high(*pin) for pin in PINS]


def test_it_boots_with_its_pins_low_and_stands():
    made = host(0)
    for _ in range(1000):
        made.wait(1)
        assert not any(pins(made))
        assert made.board.powers == OFF
    assert {(motors.state, motors.reason, motors.left) for motors in made.told(Motors)} == {("disarmed", "boot", 0.0)}
    assert (made.status.board, made.status.version, made.status.reset_cause) == ("motor", 1, 1)
    assert (made.status.boot_count, made.status.rx_errors) == (1, 0)


def test_motors_and_status_are_told_at_their_rates_and_without_a_gap():
    made = host(10_000)
    assert len(made.told(Motors)) == pytest.approx(500, abs=1)
    assert len(made.told(Status)) == 10
    assert made.decoder.rejected == 0
    sequence = [frame.sequence for frame in made.heard]
    assert sequence == [i % 256 for i in range(len(sequence))]


@pytest.mark.parametrize("powers", [(1.0, 1.0), (0.5, -0.25), (-1.0, 0.0005), (0.0, 0.75)])
def test_the_enable_pins_have_the_duty_that_was_commanded(powers):
    made = host()
    left, right = powers
    made.send(PowersCommand(left, right, 1.0))
    made.wait(500)
    assert made.board.powers == pytest.approx(powers, abs=1e-9)
    assert pins(made)[:4] == [left > 0, left < 0, right > 0, right < 0]
    assert (made.motors.left, made.motors.right, made.motors.acknowledged) == (left, right, 1)


def test_the_pwm_is_one_that_the_bridge_can_follow():
    """Fast PWM up to ICR1 (mode 14) on the undivided clock; the simulator tells a duty whatever the mode."""
    made = host()
    low, high, top, above = (
        made.board.lib.microcontroller_peek(made.board.mcu, at) for at in (TCCR1A, TCCR1B, ICR1, ICR1 + 1)
    )
    assert (low & 0b11, high) == (0b10, 0b11001)
    assert 16_000_000 / (top + 256 * above + 1) == 8000


def test_a_duty_rises_slowly_and_a_motor_that_turns_back_has_none_for_a_while():
    made = host()
    made.send(PowersCommand(1.0, 1.0, 1.0))
    trace = [left for left, _ in made.traced(300)]
    assert max(b - a for a, b in pairwise(trace)) < 0.0121  # two steps in a ms, and a count
    assert trace[-1] == 1.0
    made.send(PowersCommand(-1.0, 1.0, 1.0))
    trace, low = [], 0
    for _ in range(300):
        made.wait(1)
        trace.append(made.board.powers[0])
        low += not any(pins(made)[:2]) and trace[-1] == 0.0
    assert trace[0] == 1.0
    assert 99 <= low <= 101
    assert min(trace) < -0.7


def test_it_coasts_at_the_deadline_and_at_once_when_told():
    made = host()
    made.send(PowersCommand(0.2, 0.2, 0.3))
    made.wait(300)
    assert made.board.powers == pytest.approx((0.2, 0.2))
    made.wait(LINE_MS)
    assert not any(pins(made))
    made.wait(30)
    assert (made.motors.state, made.motors.reason) == ("link lost", "link")
    made.send(PowersCommand(0.2, 0.2, 1.0))
    made.wait(100)
    assert made.board.powers == pytest.approx((0.2, 0.2))
    made.send(StopCommand(), age_ms=5000)
    made.wait(LINE_MS)
    assert not any(pins(made))
    made.wait(30)
    assert (made.motors.state, made.motors.reason) == ("disarmed", "command")


def test_it_measures_its_battery_and_stops_when_that_is_empty():
    made = host()
    assert made.motors.battery_volts == pytest.approx(12.6, abs=0.03)
    made.board.battery = 9.5
    for _ in range(30):
        made.send(PowersCommand(0.2, 0.2, 0.3))
        made.wait(50)
    assert (made.motors.state, made.motors.reason, made.board.powers) == ("fault", "battery", OFF)
    assert made.motors.battery_volts == pytest.approx(9.5, abs=0.03)


@pytest.mark.parametrize("is_deaf", [True, False], ids=["deaf", "interrupts go on"])
def test_a_hang_ends_in_a_reset_with_the_motors_off_and_is_told(is_deaf):
    made = host()
    made.send(PowersCommand(0.5, 0.5, 1.0))
    made.wait(200)
    assert made.board.powers == (0.5, 0.5)
    made.board.lib.microcontroller_hang(made.board.mcu, is_deaf)
    trace = made.traced(140)
    assert trace[0] == (0.5, 0.5)
    assert trace[-1] == OFF
    made.wait(1000)
    assert (made.motors.state, made.motors.reason, made.board.powers) == ("disarmed", "watchdog", OFF)
    assert (made.status.reset_cause, made.status.boot_count) == (WATCHDOG_RESET, 2)


def test_a_converter_that_stands_still_ends_in_a_reset():
    made = host()
    made.send(PowersCommand(0.5, 0.5, 1.0))
    made.wait(200)
    made.board.lib.microcontroller_poke(made.board.mcu, ADCSRA, 0)
    assert made.traced(140)[-1] == OFF
    made.wait(100)
    assert made.motors.reason == "watchdog"


def test_it_takes_little_of_its_microcontroller():
    made = host()
    lib, mcu = made.board.lib, made.board.mcu
    lib.microcontroller_longest_awake(mcu)  # the start is another matter
    slept = lib.microcontroller_slept(mcu)
    for i in range(100):
        made.send(PowersCommand(0.5, (-1) ** (i // 20) * 0.5, 0.3))
        made.wait(100)
    assert RAM - lib.microcontroller_untouched(mcu) < 0.4 * RAM
    assert lib.microcontroller_longest_awake(mcu) < 0.7 * MS_CYCLES
    assert lib.microcontroller_slept(mcu) - slept > 0.7 * 10_000 * MS_CYCLES
    assert lib.microcontroller_overruns(mcu) == 0
    assert made.status.worst_loop < 0.7e-3
    assert made.status.rx_errors == 0


def test_the_program_and_the_same_c_here_come_to_the_same():
    both = host(), Host(MotorBoard())
    for left, right, ms in ((1.0, -0.3, 400), (-1.0, 0.7, 450), (0.2, 0.2, 600), (-0.1, 1.0, 450)):
        for made in both:
            made.send(PowersCommand(left, right, 0.5))
            made.wait(ms)
        avr, here = ((m.left, m.right, m.state, m.reason, m.acknowledged) for m in (made.motors for made in both))
        assert avr == here
