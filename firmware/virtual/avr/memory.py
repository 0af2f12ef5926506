"""What a board's running program has in its variables, by their C names.

The compiler that made the program says where in a structure a field lies, the program's own symbols where the variable
does. Nothing is written twice.
"""

from __future__ import annotations

import struct
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from firmware.virtual.avr.programs import ProgramError, simulator
from firmware.virtual.native import FIRMWARE

DATA_SPACE = 0x800000  # where ELF files of this architecture put RAM


def run(*command: str) -> str:
    """A tool's standard output; ProgramError with its complaint."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise ProgramError(f"{command[0]} failed: {done.stderr.strip()[:300]}")
    return done.stdout


def address_of(elf: Path, variable: str) -> tuple[int, int]:
    """A variable's address in RAM and its size; the linker may have given its name an ending."""
    for line in run("avr-nm", "--print-size", str(elf)).splitlines():
        address, *size, kind, name = line.split()
        if size and kind in "bBdD" and name.partition(".")[0] == variable:
            return int(address, 16) - DATA_SPACE, int(size[0], 16)
    raise ProgramError(f"{elf.name} has no variable {variable}")


def places_of(header: str, structure: str, fields: Mapping[str, str]) -> tuple[dict[str, tuple[int, str]], int]:
    """Offset and format of each field, of which `fields` gives the format as `struct` writes it; and the whole size."""
    rows = ", ".join(f"offsetof({structure}, {name}), sizeof((({structure} *)0)->{name})" for name in fields)
    with tempfile.TemporaryDirectory() as folder:
        source, made, table = (Path(folder) / name for name in ("layout.c", "layout.o", "layout"))
        source.write_text(
            f'#include "{FIRMWARE / header}"\n#include <stddef.h>\n'
            f"const uint16_t layout[] = {{{rows}, sizeof({structure})}};\n"
        )
        run("avr-gcc", "-mmcu=atmega32", "-std=gnu11", "-Os", "-c", "-o", str(made), str(source))
        run("avr-objcopy", "-O", "binary", "-j", ".rodata", str(made), str(table))
        numbers = struct.unpack(f"<{2 * len(fields) + 1}H", table.read_bytes())
    for (name, code), size in zip(fields.items(), numbers[1::2], strict=True):
        if struct.calcsize(f"<{code}") != size:
            raise ProgramError(f"{name} takes {size} bytes, not the {struct.calcsize(f'<{code}')} of `{code}`")
    places = {name: (offset, f"<{code}") for (name, code), offset in zip(fields.items(), numbers[:-1:2], strict=True)}
    return places, numbers[-1]


class Memory:
    """The fields of one variable of a program, read while it runs."""

    def __init__(self, elf: Path, variable: str, header: str, structure: str, fields: Mapping[str, str]):
        start, size = address_of(elf, variable)
        places, expected = places_of(header, structure, fields)
        if size != expected:
            raise ProgramError(f"{variable} has {size} bytes in {elf.name}, {structure} has {expected}")
        self.places = {name: (start + offset, code) for name, (offset, code) in places.items()}
        self.lib: Any = simulator().lib

    def read(self, mcu: Any, name: str) -> Any:
        """A field's value now."""
        address, code = self.places[name]
        size = struct.calcsize(code)
        return struct.unpack(code, bytes(self.lib.microcontroller_peek(mcu, address + i) for i in range(size)))[0]
