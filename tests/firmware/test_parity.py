"""The same C, compiled for the ATmega32 and for this machine, computes the same bits."""

import os
import subprocess
from pathlib import Path
from typing import Any

import pytest
from cffi import FFI

from firmware.virtual.native import FLAGS, WARNINGS, compiler, files
from tests.firmware.avr_tools import Microcontroller, compiled, need_simavr

HERE = Path(__file__).parent / "parity"
PURE = files(("link", "drive"), "*.c")
STEPS = int(os.environ.get("PARITY_STEPS", "600"))  # 10000 where there is time: half a minute
MAX_STEP = 225


def said_here(seed: int, folder: Path) -> bytes:
    """All steps on this machine."""
    library = folder / "parity.so"
    sources = [*PURE, HERE / "parity.c", HERE / "host.c"]
    subprocess.run([compiler(), *FLAGS, *WARNINGS, "-o", str(library), *map(str, sources)], check=True)
    ffi = FFI()
    ffi.cdef("uint32_t parity_run(uint32_t seed, uint32_t steps, uint8_t *out);")
    out = ffi.new("uint8_t[]", STEPS * MAX_STEP)
    parity: Any = ffi.dlopen(str(library))
    size = parity.parity_run(seed, STEPS, out)
    return bytes(ffi.buffer(out, size))


def said_by_board(seed: int, folder: Path, size: int) -> bytes:
    """As many bytes from the microcontroller."""
    elf = folder / "parity.elf"
    sources = [*PURE, HERE / "parity.c", HERE.parent / "programs" / "parity.c"]
    board, said = Microcontroller(compiled(elf, sources, f"-DSEED={seed}UL")), b""
    while len(said) < size:
        more = board.run_ms(100)
        assert more, "the board is silent"
        said += more
    return said[:size]


def steps_of(said: bytes) -> list[bytes]:
    """The steps, told apart by their lengths."""
    steps, at = [], 0
    while at < len(said):
        steps.append(said[at + 1 : at + 1 + said[at]])
        at += 1 + said[at]
    return steps


@pytest.mark.parametrize("seed", [1, 20251122])
def test_board_and_host_compute_the_same_bits(seed, tmp_path):
    need_simavr()
    here = said_here(seed, tmp_path)
    theirs = said_by_board(seed, tmp_path, len(here))
    ours = steps_of(here)
    assert len(ours) == STEPS >= 500
    assert len({step[:96] for step in ours}) > 0.95 * STEPS  # the floats move
    for number, (host, board) in enumerate(zip(ours, steps_of(theirs), strict=True)):
        assert host == board, f"step {number} of seed {seed}"
