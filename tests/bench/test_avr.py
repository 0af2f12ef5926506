"""What the programs take of their ATmega32s, adjusted, reset and driven, stays within what they may take."""

import pytest

from bench.avr import BOARDS, FLASH, RAM, STEP_CYCLES, run, verdict
from bench.benchmark import Row
from tests.firmware.avr_tools import need_simavr


@pytest.mark.parametrize("name", BOARDS)
def test_half_of_flash_a_share_of_ram_and_two_fifths_of_a_step_are_enough(name):
    need_simavr()
    record = run(BOARDS[name], 1)
    assert record["flash"] < 0.5 * FLASH
    assert record["ram"] < BOARDS[name].ram * RAM
    assert record["step"] < 0.4 * STEP_CYCLES
    assert record["awake"] < 0.4 * STEP_CYCLES
    assert list(verdict([Row(name, [record])])) == []


def test_a_program_that_takes_more_is_told():
    too_much = {"flash": FLASH // 2, "ram": 1229, "step": 32_000, "awake": 32_000}
    assert len(list(verdict([Row("drive board", [too_much])]))) == 4
