"""The recordings in a folder: what each holds, what people call it, and a trash from which it can be taken back.

Titles and what a scan found stand in an SQLite file in that folder; a recording that changed is scanned again. All
methods may be called from any thread and wait for the disk: call them off the event loop.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import sqlite3
import threading
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

from pydantic import BaseModel, Field

from server.errors import UserError
from server.recording import Kind, Reader, RecordingError

SUFFIX = ".rlog"
TRASH = ".trash"
FILE = ".shelf.db"
PATIENCE = 5.0  # s that another process may keep the file
SCHEMA = "CREATE TABLE IF NOT EXISTS recording (name TEXT PRIMARY KEY, title TEXT, stamp TEXT, figures TEXT);"


class NoSuchRecording(UserError):
    """No recording of that name."""


class Busy(UserError):
    """The recording cannot be changed as it is now."""


class Figures(BaseModel):
    """What a scan of a recording finds."""

    robot: str = Field(default="", examples=["crunch"])
    began: datetime | None = Field(default=None, examples=["2026-01-01T12:00:00Z"], description="null if simulated")
    duration_s: float = Field(default=0.0, examples=[312.4])
    name: str = Field(default="", examples=["Third floor, east"], description="of its session")
    truncated: bool = Field(default=False, description="the end is cut; it replays up to the cut")
    damaged: int = Field(default=0, examples=[0], description="damaged places, which a replay passes over")
    error: str = Field(default="", description="why it cannot be replayed; empty if it can")


class Recording(Figures):
    """A recording on the shelf; `id` is its file's name without .rlog."""

    id: str = Field(examples=["run-20260101-120000"])
    size: int = Field(examples=[912345], description="bytes")
    running: bool = Field(default=False, description="still being recorded")


class Shelf:
    """The recordings in `folder`; `running` names the one that is being written, if there is one."""

    def __init__(self, folder: Path, running: Callable[[], str | None] = lambda: None):
        self.folder = folder
        self.running = running
        self.lock = threading.RLock()
        self.connection: sqlite3.Connection | None = None

    def recordings(self) -> list[Recording]:
        """All recordings, the newest first."""
        found = [self.look(path) for path in self.folder.glob(f"*{SUFFIX}") if not path.name.startswith(".")]
        return sorted((one for one in found if one is not None), key=age)

    def recording(self, name: str) -> Recording:
        """One recording; NoSuchRecording."""
        found = self.look(self.path(name))
        if found is None:
            raise no_such(name)
        return found

    def path(self, name: str) -> Path:
        """A recording's file; NoSuchRecording for a name that leads elsewhere or nowhere."""
        path = place_in(self.folder, name)
        if not path.is_file():
            raise no_such(name)
        return path

    def rename(self, name: str, title: str) -> Recording:
        """Call a recording something; an empty title gives back its session's. NoSuchRecording."""
        self.path(name)
        with self.table() as table:
            table.execute(
                "INSERT INTO recording (name, title) VALUES (?, ?) ON CONFLICT (name) DO UPDATE SET title = ?",
                (name, title, title),
            )
        return self.recording(name)

    def delete(self, name: str) -> None:
        """Put a recording into the trash; NoSuchRecording, Busy while it is being written."""
        path = self.path(name)
        if name == self.running():
            raise Busy(f"{name} is being recorded: end the session first")
        trash = self.folder / TRASH
        trash.mkdir(exist_ok=True)
        with self.lock:
            deleted = trash / path.name
            if deleted.exists():  # an older one of that name makes room, so that what was deleted last comes back first
                os.rename(deleted, self.free_in_trash(name))
            os.rename(path, deleted)

    def free_in_trash(self, name: str) -> Path:
        """A place in the trash with a number behind the name, which nothing else has, here or there."""
        for number in itertools.count(2):
            place = self.folder / TRASH / f"{name}-{number}{SUFFIX}"
            if not place.exists() and not (self.folder / place.name).exists():
                return place
        raise AssertionError("there is always another number")

    def restore(self, name: str) -> Recording:
        """Take a recording out of the trash; NoSuchRecording, Busy where another one has its name."""
        path = place_in(self.folder, name)
        deleted = place_in(self.folder / TRASH, name)
        if not deleted.is_file():
            raise no_such(name)
        if path.exists():
            raise Busy(f"there is another recording {name}: rename its file first")
        os.replace(deleted, path)
        return self.recording(name)

    def close(self) -> None:
        """Let go of the file; the next call opens it again."""
        with self.lock:
            if self.connection is not None:
                self.connection.close()
                self.connection = None

    def look(self, path: Path) -> Recording | None:
        """What is known of a file, scanned only if it has changed; None if it has just gone."""
        try:
            facts = path.stat()
        except OSError:
            return None
        name, stamp = path.name.removesuffix(SUFFIX), f"{facts.st_size} {facts.st_mtime_ns}"
        with self.table() as table:
            row = table.execute("SELECT title, stamp, figures FROM recording WHERE name = ?", (name,)).fetchone()
        title, known, figures = row or (None, None, None)
        scanned = Figures.model_validate_json(figures) if known == stamp and figures else self.scan(path, stamp)
        shown = scanned.model_copy(update={"name": title or scanned.name})
        return Recording(**shown.model_dump(), id=name, size=facts.st_size, running=name == self.running())

    def scan(self, path: Path, stamp: str) -> Figures:
        """Read a recording through, and remember what was found."""
        figures = figures_of(path)
        with self.table() as table:
            table.execute(
                "INSERT INTO recording (name, stamp, figures) VALUES (?1, ?2, ?3) "
                "ON CONFLICT (name) DO UPDATE SET stamp = ?2, figures = ?3",
                (path.name.removesuffix(SUFFIX), stamp, figures.model_dump_json()),
            )
        return figures

    @contextlib.contextmanager
    def table(self) -> Iterator[sqlite3.Connection]:
        """The file's table, committed afterwards; UserError if it cannot be used."""
        with self.lock:
            try:
                if self.connection is None:
                    self.connection = sqlite3.connect(self.folder / FILE, PATIENCE, check_same_thread=False)
                    self.connection.execute("PRAGMA journal_mode = WAL")
                    self.connection.executescript(SCHEMA)
                with self.connection:
                    yield self.connection
            except sqlite3.Error as error:
                raise UserError(
                    f"{self.folder / FILE}: cannot be used ({error}); make the folder writable, or remove the file"
                ) from None


def place_in(folder: Path, name: str) -> Path:
    """Where a recording of that name stands in a folder; NoSuchRecording for a name that could lead elsewhere."""
    if not name or name.startswith(".") or Path(name).name != name or "\0" in name:
        raise no_such(name)
    return folder / f"{name}{SUFFIX}"


def no_such(name: str) -> NoSuchRecording:
    """The error for a name that nothing has."""
    return NoSuchRecording(f"there is no recording {name}")


def age(recording: Recording) -> tuple[float, str]:
    """Sorts the newest first, and those without a date last."""
    return (-recording.began.timestamp() if recording.began else 0.0, recording.id)


def figures_of(path: Path) -> Figures:
    """Read a recording through; what cannot be read tells why instead."""
    try:
        reader = Reader(path)
    except RecordingError as error:
        return Figures(error=str(error).removeprefix(f"{path}: "))
    duration, name = 0.0, ""
    for record in reader:
        duration = max(duration, record.t)
        if record.kind == Kind.MARK:
            name = named(record.data, name)
    began = reader.header.unix_ns
    return Figures(
        robot=reader.header.robot,
        began=datetime.fromtimestamp(began * 1e-9, UTC) if began else None,
        duration_s=round(duration, 3),
        name=name,
        truncated=reader.truncated_at is not None,
        damaged=len(reader.skipped),
    )


def named(mark: bytes, before: str) -> str:
    """The session's name after a mark."""
    if not mark.startswith(b'{"name"'):
        return before
    with contextlib.suppress(ValueError, KeyError):
        return str(json.loads(mark)["name"])
    return before
