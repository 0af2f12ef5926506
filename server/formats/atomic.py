"""Files that are there whole or not at all: written beside their place, synced, then renamed onto it."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from server.formats.errors import FormatError


def write_atomically(path: Path | str, content: bytes | str) -> None:
    """Replace `path` by `content` in one step; FormatError where the place cannot be written."""
    path = Path(path)
    data = content.encode() if isinstance(content, str) else content
    try:
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise unwritable(path, error) from None
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o666 & ~current_umask())
        os.replace(name, path)
    except OSError as error:
        Path(name).unlink(missing_ok=True)
        raise unwritable(path, error) from None


def make_directory(path: Path | str) -> Path:
    """The directory, made where it is missing; FormatError where that cannot be, or nothing can be written in it."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise unwritable(path, error) from None
    return path


def unwritable(path: Path, error: OSError) -> FormatError:
    """The error of a place that cannot be written."""
    return FormatError(
        path, None, f"cannot be written ({error.strerror})", "choose another place or mend its permissions"
    )


def current_umask() -> int:
    """The process's file mode mask; reading it means setting it for a moment."""
    mask = os.umask(0o022)
    os.umask(mask)
    return mask
