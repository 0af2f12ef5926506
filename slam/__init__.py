"""Mapping with almost no sensing, as a library: local maps, wall observations, path filters; no robot and no file.

Compiled kernels are cached in a folder named by a hash of every kernel file, because numba does not notice that a
kernel in another file, which a cached one calls, has changed.
"""

from __future__ import annotations

import hashlib
import os
import platform
from pathlib import Path

import numba
import platformdirs
from numba.core import config


def _kernel_cache() -> str:
    """The cache folder for these sources, this numba, this machine and this choice of bounds checks."""
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    digest.update(f"{numba.__version__} {platform.processor()} {os.environ.get('NUMBA_BOUNDSCHECK', '')}".encode())
    root = os.environ.get("NUMBA_CACHE_DIR") or Path(platformdirs.user_cache_dir("crunch")) / "kernels"
    return str(Path(root) / digest.hexdigest()[:16])


config.CACHE_DIR = _kernel_cache()  # pyright: ignore[reportAttributeAccessIssue]
