"""The boards' programs, built by firmware/Makefile on first use, and the library that runs them under simavr.

Needs a checkout, make, avr-gcc and simavr's headers (Debian/Ubuntu: gcc-avr, avr-libc, libsimavr-dev, make); without
them ProgramError.
"""

from __future__ import annotations

import fcntl
import functools
import shutil
import subprocess
from pathlib import Path
from typing import Literal, NamedTuple

from firmware.virtual.native import FIRMWARE, FOLDERS, CompilerError, Native, native

BUILT = FIRMWARE.parent / "build"
PACKAGES = "gcc-avr avr-libc make libsimavr-dev"
Imu = Literal["analogue", "mpu6050"]


class ProgramError(CompilerError):
    """The boards' programs cannot be built or run here."""


class Programs(NamedTuple):
    """The boards' ELF files: Crunch's two, Maze Runner's, and the bumper cart's."""

    drive: Path
    sensor: Path
    motor: Path
    cart: Path


@functools.cache
def programs(imu: Imu = "analogue") -> Programs:
    """All programs, up to date, for one kind of gyro. Raises ProgramError with the first complaint."""
    if shutil.which("avr-gcc") is None or shutil.which("make") is None:
        raise ProgramError(f"no avr-gcc or no make here (Debian/Ubuntu: apt-get install {PACKAGES})")
    if not (FIRMWARE / "Makefile").exists():
        raise ProgramError(f"{FIRMWARE} has no Makefile: the boards' programs are built in a checkout")
    BUILT.mkdir(parents=True, exist_ok=True)
    with (BUILT / ".lock").open("w") as lock:  # held by one process at a time, until it is closed
        fcntl.flock(lock, fcntl.LOCK_EX)
        command = ["make", "-C", str(FIRMWARE), "avr", f"IMU={imu}"]
        made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode != 0:
        complaint = next((line for line in made.stderr.splitlines() if "error" in line), made.stderr.strip())
        raise ProgramError(f"the boards' programs do not build: {complaint}")
    folder = BUILT / ("avr" if imu == "analogue" else f"avr-{imu}")
    return Programs(*(folder / f"{board}.elf" for board in Programs._fields))


def simulator() -> Native:
    """The virtual robot's library with the boards under simavr in it. Raises ProgramError."""
    try:
        return native((*FOLDERS, "virtual/avr"))
    except (CompilerError, OSError) as error:
        raise ProgramError(f"simavr is needed (Debian/Ubuntu: apt-get install {PACKAGES}): {error}") from error
