"""The wiring tables of docs/hardware.md and the sources of all boards name the same pins for the same things."""

import re
from pathlib import Path

import pytest

from firmware.virtual.native import FIRMWARE

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "hardware.md").read_text()
FILES = {
    "Drive board": ("drive_board.c", "pwm", "encoders", "twi", "uart"),
    "Sensor board": ("sensor_board.c", "capture", "uart"),
    "Maze Runner's motor board": ("motor_board.c", "uart"),
    "Bumper Cart's board": ("cart_board.c", "encoders", "uart"),
}
HOUSING = {  # 40-pin DIP: where each port's bit 0 is, and which way it counts
    "A": (40, -1),
    "B": (1, 1),
    "C": (22, 1),
    "D": (14, 1),
}
SYNONYMS = {"forward": "direction"}  # LEFT_FORWARD is the left bridge's direction, high for forward
MACRO = re.compile(r"#define (\w+) _BV\((P[A-D][0-7])\)")


def rows(board):
    """Pin, port and signal of each row in a board's table."""
    section = PAGE.split(f"## {board}\n")[1].split("\n## ")[0]
    return re.findall(r"^\| (\d+) \| (P[A-D][0-7]) \| ([^|]*) \|", section, re.MULTILINE)


def used(board):
    return {port: signal for _, port, signal in rows(board) if not signal.startswith("free")}


def text(board):
    """The board's own sources, ranges of pins written out."""
    parts = [(FIRMWARE / "avr" / name).read_text() for name in FILES[board] if name.endswith(".c")]
    for name in FILES[board]:
        if not name.endswith(".c"):
            parts += [(FIRMWARE / "avr" / f"{name}.{kind}").read_text() for kind in "hc"]
    return re.sub(
        r"P([A-D])([0-7]) to P\1([0-7])",
        lambda m: " ".join(f"P{m[1]}{bit}" for bit in range(int(m[2]), int(m[3]) + 1)),
        "\n".join(parts),
    )


@pytest.mark.parametrize("board", FILES)
def test_every_pin_stands_once_and_where_the_housing_has_it(board):
    table = rows(board)
    assert sorted(port for _, port, _ in table) == [f"P{port}{bit}" for port in "ABCD" for bit in range(8)]
    for pin, port, _ in table:
        first, step = HOUSING[port[1]]
        assert int(pin) == first + step * int(port[2]), port


@pytest.mark.parametrize("board", FILES)
def test_the_pins_in_use_are_those_of_the_sources(board):
    assert set(used(board)) == set(re.findall(r"\bP[A-D][0-7]\b", text(board)))


@pytest.mark.parametrize("board", FILES)
def test_the_signals_bear_the_names_that_the_sources_give_them(board):
    macros = MACRO.findall(text(board))
    assert len(macros) >= 3
    for name, port in macros:
        signal = re.findall(r"\w+", used(board)[port].lower())
        for word in name.lower().split("_"):
            assert SYNONYMS.get(word, word) in signal, f"{name} is {port}: {used(board)[port]}"


def test_analogue_inputs_stand_in_the_order_of_the_sources():
    names = {"PA3": "battery voltage", "PA4": "battery current", "PA5": "charger", "PA6": "left", "PA7": "right"}
    order = re.search(r"enum \{ (BATTERY = 3[^}]*) \}", text("Drive board"))
    assert order is not None
    assert [word.split(" ")[0] for word in order[1].split(", ")] == [
        "BATTERY", "CURRENT", "CHARGER", "LEFT_MOTOR", "RIGHT_MOTOR",
    ]  # fmt: skip
    for port, word in names.items():
        assert used("Drive board")[port].startswith(word)


@pytest.mark.parametrize("board", ["Maze Runner's motor board", "Bumper Cart's board"])
def test_a_small_robot_s_battery_is_where_its_source_has_it(board):
    assert re.search(r"enum \{ BATTERY = 3 \}", text(board))
    assert used(board)["PA3"] == "battery voltage"


def constant(name, file="drive/power.c"):
    value = re.search(rf"#define {name} (\d+)L?\b", (FIRMWARE / file).read_text())
    assert value is not None
    return int(value[1])


def test_resistors_make_the_scales_of_the_program():
    drive = constant("DIVIDER_FULL_MV")
    small = constant("BATTERY_FULL_MV", "motor/battery.c")  # of either small robot
    scales = [drive, drive, small, small]
    dividers = re.findall(r"([\d.]+) kohm over ([\d.]+) kohm", PAGE)
    for (upper, lower), scale in zip(dividers, scales, strict=True):
        full = 5000.0 * (float(upper) + float(lower)) / float(lower)
        assert full == pytest.approx(scale, rel=0.005)
    ((ohms, micro),) = {
        (r, u) for r in re.findall(r"([\d.]+) kohm to GND, 10 nF", PAGE) for u in re.findall(r"(\d+) uA", PAGE)
    }
    assert 5.0 / (float(ohms) * 1000 * float(micro) * 1e-6) * 1000 == pytest.approx(
        constant("SENSE_FULL_MA"), rel=0.001
    )
    (hall,) = set(re.findall(r"2\.5 V at 0 A and (\d+) mV per A", PAGE))
    assert 5000.0 / float(hall) * 1000 == pytest.approx(constant("HALL_FULL_MA"))


def test_fuses_of_the_firmware_s_page_are_explained():
    page = (Path(__file__).resolve().parents[2] / "docs" / "firmware.md").read_text()
    section = PAGE.split("## Flash\n")[1]
    (low,), (high,) = re.findall(r"`lfuse` (0x\w\w)", page), re.findall(r"`hfuse` (0x\w\w)", page)
    assert re.search(rf"^\| low \|.*{low}", section, re.MULTILINE)
    assert re.search(rf"^\| high \|.*{high}", section, re.MULTILINE)
