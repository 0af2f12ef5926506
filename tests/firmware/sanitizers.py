"""Runs Python with the firmware's C compiled for AddressSanitizer and UndefinedBehaviorSanitizer: a mistake ends it."""

import os
import subprocess
import sys
from pathlib import Path

from tests.tools import miss

ROOT = Path(__file__).parents[2]
SANITIZED = "-O1 -g -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer"


def runtime(name: str) -> str:
    """The path of the compiler's library of this name."""
    found = subprocess.run(["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=False)
    path = Path(found.stdout.strip())
    if found.returncode != 0 or not path.is_absolute():
        miss(f"no {name} here")
    return str(path)


def python(*arguments: str, checkout: Path = ROOT) -> subprocess.CompletedProcess:
    """Python, to which the sanitizers' own libraries are lent: they must come before all others.

    Python's memory comes from malloc, so that what cffi allocates has guarded ends as well.
    """
    environment = {
        **os.environ,
        "CC": "gcc",
        "CFLAGS": SANITIZED,
        "LD_PRELOAD": f"{runtime('libasan.so')} {runtime('libubsan.so')}",
        "ASAN_OPTIONS": "detect_leaks=0",  # Python keeps what it has
        "PYTHONMALLOC": "malloc",
        "PYTHONPATH": str(checkout),
    }
    command = [sys.executable, *arguments]
    return subprocess.run(command, env=environment, cwd=checkout, capture_output=True, text=True, check=False)
