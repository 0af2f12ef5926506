"""The same C, compiled for the ATmega32 and for this machine, computes the same bits.

Twice: the drive board's whole loop, and each of its pure files by itself on random input, the motor board's among them.
The link is in both, for they tell frames and judge commands; the sensor board's files and the MPU-6050's have no
floats.
"""

import os
import subprocess
from pathlib import Path
from typing import Any

import pytest
from cffi import FFI

from firmware.virtual.native import FLAGS, WARNINGS, compiler, files
from tests.firmware.avr_tools import Microcontroller, compiled, need_simavr

HERE = Path(__file__).parent / "parity"
PURE = files(("link", "drive", "motor"), "*.c")
STEPS = int(os.environ.get("PARITY_STEPS", "600"))  # 10000 where there is time: a minute
MAX_STEP = 225
MODULES = {  # bytes told
    "tilt": 42, "odometry": 32, "agreement": 13, "balance": 36, "command": 9, "supervisor": 23,
    "settings": 7, "power": 12, "motor": 24,
}  # fmt: skip


def said_here(part: str, seed: int, folder: Path) -> bytes:
    """All steps on this machine."""
    library = folder / "parity.so"
    sources = [*PURE, *(HERE / name for name in ("parity.c", "modules.c", "host.c"))]
    subprocess.run([compiler(), *FLAGS, *WARNINGS, "-o", str(library), *map(str, sources)], check=True)
    ffi = FFI()
    for name in ("parity", "modules"):
        ffi.cdef(f"uint32_t {name}_run(uint32_t seed, uint32_t steps, uint8_t *out);")
    out = ffi.new("uint8_t[]", STEPS * MAX_STEP)
    made: Any = ffi.dlopen(str(library))
    size = getattr(made, f"{part}_run")(seed, STEPS, out)
    return bytes(ffi.buffer(out, size))


def said_by_board(part: str, seed: int, folder: Path, size: int) -> bytes:
    """As many bytes from the microcontroller."""
    elf = folder / "parity.elf"
    sources = [*PURE, HERE / f"{part}.c", HERE.parent / "programs" / "parity.c"]
    flags = [f"-DSEED={seed}UL", *(["-DMODULES"] if part == "modules" else [])]
    board, said = Microcontroller(compiled(elf, sources, *flags)), bytearray()
    while len(said) < size:
        more = board.run_ms(100)
        assert more, "the board is silent"
        said += more
    return bytes(said[:size])


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
    here = said_here("parity", seed, tmp_path)
    theirs = said_by_board("parity", seed, tmp_path, len(here))
    ours = steps_of(here)
    assert len(ours) == STEPS >= 500
    assert len({step[:96] for step in ours}) > 0.95 * STEPS  # the floats move
    for number, (host, board) in enumerate(zip(ours, steps_of(theirs), strict=True)):
        assert host == board, f"step {number} of seed {seed}"


def by_module(step: bytes) -> dict[str, bytes]:
    """What each file told in one step."""
    told, at = {}, 0
    for name, size in MODULES.items():
        told[name] = step[at : at + size]
        at += size
    assert at == len(step)
    return told


def test_each_file_by_itself_computes_the_same_bits(tmp_path):
    need_simavr()
    here = said_here("modules", 7, tmp_path)
    theirs = said_by_board("modules", 7, tmp_path, len(here))
    ours, boards = ([by_module(step) for step in steps_of(said)] for said in (here, theirs))
    assert len(ours) == STEPS
    for name in MODULES:
        told = [step[name] for step in ours]
        assert len(set(told)) > 0.5 * STEPS, f"{name} hardly moves"  # a supervisor without a wish tells little
        differing = [i for i, (host, board) in enumerate(zip(told, boards, strict=True)) if host != board[name]]
        assert not differing, f"{name}: {len(differing)} steps, the first is {differing[0]}"
