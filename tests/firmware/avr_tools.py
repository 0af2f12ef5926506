"""What the tests of the real boards need: a compiler for them, simavr, and a microcontroller that runs one program."""

import shutil
import subprocess
from functools import cache
from pathlib import Path

from firmware.virtual.avr.programs import Programs, programs, simulator
from firmware.virtual.native import WARNINGS
from tests.tools import miss

MS_CYCLES = 16000


def need_simavr() -> None:
    """Skips, or fails in CI, where the tools are missing; a program that does not build is never a reason to skip."""
    if shutil.which("avr-gcc") is None:
        miss("no avr-gcc here")
    if not Path("/usr/include/simavr/sim_avr.h").exists():
        miss("no simavr here")


@cache
def built() -> Programs:
    """All programs, built."""
    need_simavr()
    return programs()


def compiled(elf: Path, sources: list[Path], *flags: str) -> Path:
    """A test's own program for the ATmega32, of its sources and the firmware's."""
    need_simavr()
    fixed = ["-mmcu=atmega32", "-DF_CPU=16000000UL", "-std=gnu11", "-Os", *WARNINGS]
    subprocess.run(["avr-gcc", *fixed, *flags, "-o", str(elf), *map(str, sources)], check=True)
    return elf


class Microcontroller:
    """One program under simavr, with nothing around it."""

    def __init__(self, elf: Path):
        self.ffi, self.lib, _ = simulator()
        self.wiring = self.ffi.new("struct wiring *")
        made = self.lib.microcontroller_new(bytes(elf), self.wiring)
        assert made != self.ffi.NULL, f"simavr cannot read {elf}"
        self.mcu = self.ffi.gc(made, self.lib.microcontroller_free)
        self.sent = self.ffi.new("struct sent_byte[512]")

    def run_ms(self, ms: int) -> bytes:
        """Runs on, ms by ms; returns the bytes sent."""
        said = bytearray()
        for _ in range(ms):
            assert self.lib.microcontroller_run(self.mcu, self.lib.microcontroller_cycle(self.mcu) + MS_CYCLES)
            count = self.lib.microcontroller_take_sent(self.mcu, self.sent)
            said += bytes(self.sent[i].byte for i in range(count))
        return bytes(said)
