"""The one way in which a file is refused: where, what is wrong, what to do."""

from __future__ import annotations

from pathlib import Path

from server.errors import UserError


class FormatError(UserError):
    """A file that cannot be read as what it should be; `place` is a line number, a key, or empty for the whole file."""

    def __init__(self, path: Path | str, place: int | str | None, problem: str, remedy: str = ""):
        self.path = Path(path)
        self.place = "" if place is None else str(place)
        self.problem = problem
        self.remedy = remedy
        where = f"{path}:{self.place}" if self.place else f"{path}"
        super().__init__(f"{where}: {problem}" + (f"; {remedy}" if remedy else ""))


def read_bytes(path: Path | str, remedy: str = "") -> bytes:
    """The whole file; FormatError where it is missing, a directory or not readable."""
    path = Path(path)
    if path.is_dir():
        raise FormatError(path, None, "is a directory", remedy or "name a file")
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise FormatError(path, None, "no such file", remedy or "check the name") from None
    except OSError as error:
        raise FormatError(path, None, f"cannot be read ({error.strerror})", remedy or "check its permissions") from None


def read_lines(path: Path | str, remedy: str = "") -> list[str]:
    """The file's lines without their ends; bytes that are not UTF-8 become replacement characters."""
    return read_bytes(path, remedy).decode("utf-8", errors="replace").splitlines()
