"""`crunch firmware`: build the boards' programs, see how big they are, and write them with a programmer.

Works in a checkout, where firmware/Makefile is; the tools are borrowed (make, avr-gcc, avr-size, avrdude).
"""

from __future__ import annotations

import shutil
import subprocess
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from server.errors import UserError

ROOT = Path(__file__).resolve().parents[1]
FIRMWARE = ROOT / "firmware"
BUILT = ROOT / "build" / "avr"
COMPILER = {"make": "make", "avr-gcc": "gcc-avr avr-libc", "avr-objcopy": "binutils-avr", "avr-size": "binutils-avr"}
PROGRAMMER = {"avrdude": "avrdude"}
CHIP = "m32"
FUSES = {"lfuse": 0x3F, "hfuse": 0x81}  # crystal of 16 MHz, brown-out at 4 V; full swing, the EEPROM outlives flashing

app = typer.Typer(name="firmware", help="Build and flash the programs of the robots' boards.", rich_markup_mode=None)


class Imu(StrEnum):
    """Which gyro and accelerometer the drive board has."""

    ANALOGUE = "analogue"
    MPU6050 = "mpu6050"


class Board(StrEnum):
    """Crunch's two, Maze Runner's, and Bumper Cart's."""

    DRIVE = "drive"
    SENSOR = "sensor"
    MOTOR = "motor"
    CART = "cart"


Parts = Annotated[Imu, typer.Option("--imu", help="The drive board's gyro and accelerometer.")]
Which = Annotated[Board | None, typer.Option("--board", help="Only this one.", show_default="all")]


@app.command()
def build(board: Which = None, imu: Parts = Imu.ANALOGUE) -> None:
    """Compile the boards' programs, and print how big they are.

    \b
        crunch firmware build
    """
    print_sizes(make_programs(imu), board)


@app.command()
def size(board: Which = None, imu: Parts = Imu.ANALOGUE) -> None:
    """Print how much of flash and memory the programs take, as avr-size counts it.

    \b
        crunch firmware size --board drive
    """
    print_sizes(make_programs(imu), board)


@app.command()
def flash(
    board: Annotated[Board, typer.Option("--board", help="Which program.")],
    port: Annotated[str, typer.Option(help="Where the programmer is: /dev/ttyUSB0, usb.")],
    programmer: Annotated[str, typer.Option(help="Which one, as `avrdude -c` names it.")] = "stk500v2",
    imu: Parts = Imu.ANALOGUE,
    fuses: Annotated[bool, typer.Option("--fuses", help="Write the fuses, too: once for a new chip.")] = False,
    bit_clock: Annotated[
        float | None,
        typer.Option(min=0.1, help="Microseconds per bit; 10 for a new chip.", show_default="programmer's"),
    ] = None,
) -> None:
    """Build a board's program and write it with avrdude. Stored settings stay.

    \b
        crunch firmware flash --board drive --port /dev/ttyUSB0
        crunch firmware flash --board sensor --port usb --programmer usbasp --fuses --bit-clock 10
    """
    need(PROGRAMMER)
    built = make_programs(imu)
    writes = [f"{name}:w:{value:#04x}:m" for name, value in FUSES.items()] if fuses else []
    writes.append(f"flash:w:{built / f'{board}.hex'}:i")
    command = ["avrdude", "-p", CHIP, "-c", programmer, "-P", port]
    if bit_clock is not None:
        command += ["-B", f"{bit_clock:g}"]
    for write in writes:
        command += ["-U", write]
    result = run(command)
    if result.returncode != 0:
        raise UserError(f"avrdude could not write the {board} board: {complaint(result.stderr)}")
    typer.echo(f"{board}: written and verified")


def need(tools: dict[str, str]) -> None:
    """UserError that names the first tool which is missing, and how it is had."""
    for tool, package in tools.items():
        if shutil.which(tool) is None:
            raise UserError(f"{tool} is not installed (Debian/Ubuntu: apt-get install {package})")


def run(command: list[str]) -> subprocess.CompletedProcess[str]:
    """What a tool said and left."""
    return subprocess.run(command, capture_output=True, text=True, check=False)


def make_programs(imu: Imu) -> Path:
    """All programs, up to date; the folder that they are in."""
    if not (FIRMWARE / "Makefile").is_file():
        raise UserError(
            f"the boards' programs are not in {FIRMWARE}, for they are not installed with crunch; "
            "run `make setup` in a checkout of its sources and then .venv/bin/crunch there"
        )
    need(COMPILER)
    made = run(["make", "-C", str(FIRMWARE), "avr", f"IMU={imu}"])
    if made.returncode != 0:
        raise UserError(f"the boards' programs do not build: {complaint(made.stderr)}")
    return BUILT if imu is Imu.ANALOGUE else BUILT.with_name(f"{BUILT.name}-{imu}")


def complaint(text: str) -> str:
    """The line of a tool's words that tells most: the first with an error in it, or the last."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return next((line for line in lines if "error" in line.lower()), lines[-1] if lines else "it did not say why")


def print_sizes(built: Path, board: Board | None) -> None:
    """Flash and static memory of one program or of all."""
    for one in [board] if board else list(Board):
        told = run(["avr-size", "-C", "--mcu=atmega32", str(built / f"{one}.elf")])
        if told.returncode != 0:
            raise UserError(f"avr-size: {complaint(told.stderr)}")
        for line in told.stdout.splitlines():
            name, colon, rest = line.partition(":")
            if colon and name in ("Program", "Data"):
                what = "flash" if name == "Program" else "memory without stack"
                typer.echo(f"{one}: {what} {' '.join(rest.split())}")
