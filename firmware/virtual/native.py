"""The firmware's own C and the simulator's, compiled for this machine on first use and loaded through cffi (ABI mode).

The C headers are the one source of every structure: the compiler's preprocessor flattens them and cffi reads the
result, so nothing is declared twice. Library and declarations are kept in the user's cache directory under a hash of
all sources and flags; a changed line makes a new pair, and processes that build at once cannot disturb each other.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import shlex
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import platformdirs
from cffi import FFI

FIRMWARE = Path(__file__).resolve().parent.parent
FOLDERS = ("link", "drive", "sensor", "motor", "cart", "virtual")
LIBRARIES = {"virtual/avr": ("-lsimavr",)}  # that the C of a folder needs
FLAGS = ("-O2", "-fPIC", "-shared", "-std=c11", "-ffp-contract=off")
WARNINGS = ("-Wall", "-Wextra", "-Werror", "-Wconversion")
HARDWARE = ("main.c", "board.h")  # of each board: what only a microcontroller has
PACKED_HEADER = "channels.h"  # the only one with packed structures
ERASED = ("-D__attribute__(x)=", "-D_Static_assert(...)=struct assertion")  # what cffi's parser does not take
SYSTEM_HEADERS = ("stdint.h", "stdbool.h", "stddef.h", "string.h", "math.h")  # cffi knows their types


class CompilerError(RuntimeError):
    """No working C compiler, or C that it refuses."""


class Native(NamedTuple):
    """cffi's two halves, and the low bits of the sources' hash, which the boards report as their build."""

    ffi: Any  # an FFI; its structures' fields are known to the C headers only
    lib: Any
    build: int


def files(folders: tuple[str, ...], pattern: str) -> list[Path]:
    """Files of the pure part and of the simulator, in a fixed order."""
    found = [path for folder in folders for path in sorted((FIRMWARE / folder).glob(pattern))]
    return [path for path in found if path.name not in HARDWARE]


def sources(folders: tuple[str, ...] = FOLDERS) -> list[Path]:
    """All C files of the firmware's pure part and of the simulator, in a fixed order."""
    return files(folders, "*.c")


def headers(folders: tuple[str, ...] = FOLDERS) -> list[Path]:
    """All their headers, in the order of the folders."""
    return files(folders, "*.h")


def compiler() -> str:
    """The C compiler's path: `CC` from the environment, or `cc`."""
    name = os.environ.get("CC", "cc")
    found = shutil.which(name)
    if found is None:
        raise CompilerError(
            f"no C compiler {name!r} found: the virtual robot runs the firmware's own C. Install one "
            "(Debian/Ubuntu: apt-get install gcc; macOS: xcode-select --install) or name one in CC"
        )
    return found


def flags() -> list[str]:
    """How the library is compiled: FLAGS, then `CFLAGS` from the environment, which so have the last word."""
    return [*FLAGS, *shlex.split(os.environ.get("CFLAGS", ""))]


def fingerprint(folders: tuple[str, ...] = FOLDERS) -> str:
    """Hash of sources, headers, flags, the compiler's name, and this file, which says how they become a library."""
    digest = hashlib.sha256(repr((flags(), compiler())).encode())
    for path in [*sources(folders), *headers(folders), Path(__file__)]:
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def run_compiler(arguments: list[str]) -> str:
    """Standard output of one compiler run; raises CompilerError with its first complaint."""
    result = subprocess.run([compiler(), *arguments], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        complaint = next((line for line in result.stderr.splitlines() if "error" in line), result.stderr.strip())
        raise CompilerError(f"{compiler()} failed: {complaint}")
    return result.stdout


def flatten_headers(folder: Path, folders: tuple[str, ...] = FOLDERS) -> tuple[str, str]:
    """Declarations that cffi can read: those of the packed wire format, and all others."""
    for name in SYSTEM_HEADERS:
        (folder / name).touch()
    whole = folder / "all.c"
    whole.write_text("".join(f'#include "{path}"\n' for path in headers(folders)))
    text = run_compiler(["-E", "-nostdinc", f"-I{folder}", *ERASED, str(whole)])
    packed: list[str] = []
    plain: list[str] = []
    target = plain
    for line in text.splitlines():
        marker = re.match(r'#(?:line)? ?\d+ "([^"]*)"', line)
        if marker:
            target = packed if marker.group(1).endswith(PACKED_HEADER) else plain
        elif line.strip() and not line.startswith("#"):
            target.append(line)
    return "\n".join(packed), "\n".join(plain)


def compile_into(target: Path, folders: tuple[str, ...] = FOLDERS) -> None:
    """Builds the library and its declarations and moves them into place, the library last."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix="build-") as name:
        folder = Path(name)
        libraries = [flag for name in folders for flag in LIBRARIES.get(name, ())]
        run_compiler([*flags(), "-o", str(folder / "library"), *map(str, sources(folders)), *libraries, "-lm"])
        (folder / "stand-ins").mkdir()
        packed, plain = flatten_headers(folder / "stand-ins", folders)
        (folder / "packed").write_text(packed)
        (folder / "plain").write_text(plain)
        os.replace(folder / "packed", target.with_suffix(".packed.h"))
        os.replace(folder / "plain", target.with_suffix(".h"))
        os.replace(folder / "library", target)


@functools.cache
def native(folders: tuple[str, ...] = FOLDERS) -> Native:
    """The loaded library; compiles it if no earlier run has. Raises CompilerError."""
    digest = fingerprint(folders)
    target = Path(platformdirs.user_cache_dir("crunch")) / "firmware" / f"crunch-{digest[:24]}.so"
    if not target.exists():
        compile_into(target, folders)
    ffi = FFI()
    ffi.cdef(target.with_suffix(".packed.h").read_text(), packed=True)
    ffi.cdef(target.with_suffix(".h").read_text())
    return Native(ffi, ffi.dlopen(str(target)), int(digest[:4], 16))
