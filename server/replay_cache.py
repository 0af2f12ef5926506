"""Rendered recordings: the frames that a viewer of the session would have got, by topic and time, in an SQLite file.

One process writes a cache while others already read from it. A cache belongs to one recording, one configuration and
one version of the code, which its name tells: whatever changes, another one is made. What is written can always be
rendered again, so nothing waits for the disk.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

FOLDER = ".replays"
SUFFIX = ".replay"
PATIENCE = 5.0  # s that the writer may keep the file
SCHEMA = """
CREATE TABLE topic (name TEXT PRIMARY KEY);
CREATE TABLE frame (t REAL NOT NULL, topic TEXT NOT NULL, body BLOB NOT NULL);
CREATE INDEX frame_of_topic ON frame (topic, t);
CREATE INDEX frame_at ON frame (t, topic);
CREATE TABLE progress (one INTEGER PRIMARY KEY CHECK (one = 1), facts TEXT NOT NULL);
CREATE TABLE result (one INTEGER PRIMARY KEY CHECK (one = 1), survey BLOB NOT NULL, labels TEXT NOT NULL);
"""


class Progress(NamedTuple):
    """How far a rendering is: up to `rendered` of `duration` s; `note` is for people, `error` ends it."""

    rendered: float = 0.0
    duration: float = 0.0
    complete: bool = False
    note: str = ""
    error: str = ""


class CacheWriter:
    """Writes a new cache; what is added is seen by readers after `commit`."""

    def __init__(self, path: Path):
        self.frames: list[tuple[float, str, bytes]] = []
        self.database = sqlite3.connect(path, PATIENCE)
        self.database.executescript(f"PRAGMA journal_mode = WAL; PRAGMA synchronous = OFF; {SCHEMA}")

    def add(self, t: float, topic: str, body: bytes) -> None:
        """Keep a frame that was shown at time t."""
        self.frames.append((t, topic, body))

    def commit(self, progress: Progress) -> None:
        """Give what was added to the readers."""
        with self.database:
            topics = {topic for _, topic, _ in self.frames}
            self.database.executemany("INSERT OR IGNORE INTO topic VALUES (?)", [(topic,) for topic in sorted(topics)])
            self.database.executemany("INSERT INTO frame VALUES (?, ?, ?)", self.frames)
            facts = json.dumps(progress._asdict())
            self.database.execute("INSERT OR REPLACE INTO progress VALUES (1, ?)", (facts,))
        self.frames.clear()

    def conclude(self, survey: bytes, labels: str) -> None:
        """Keep the map that came of it, a packed survey and its labels as JSON, with the next `commit`."""
        self.database.execute("INSERT INTO result VALUES (1, ?, ?)", (survey, labels))

    def close(self) -> None:
        """Leave one file behind."""
        self.database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        self.database.close()


class CacheReader:
    """Reads a cache, also while it is written or not yet there; to be used by one thread at a time."""

    def __init__(self, path: Path):
        self.path = path
        self.database: sqlite3.Connection | None = None

    def progress(self) -> Progress:
        """How far the rendering is."""
        rows = self.query("SELECT facts FROM progress")
        return Progress(**json.loads(rows[0][0])) if rows else Progress()

    def at(self, t: float) -> list[tuple[str, bytes]]:
        """Topic and body of the newest frame of each topic at time t."""
        return self.query(
            "SELECT topic, body FROM frame WHERE rowid IN"
            " (SELECT (SELECT rowid FROM frame WHERE topic = name AND t <= ?"
            " ORDER BY t DESC, rowid DESC LIMIT 1) FROM topic) ORDER BY rowid",
            t,
        )

    def between(self, after: float, until: float) -> list[tuple[str, bytes]]:
        """Topic and body of the newest frame of each topic that came in a time."""
        return self.query(
            "SELECT topic, body FROM frame WHERE rowid IN"
            " (SELECT max(rowid) FROM frame WHERE t > ? AND t <= ? GROUP BY topic) ORDER BY rowid",
            after,
            until,
        )

    def result(self) -> tuple[bytes, str] | None:
        """The packed survey and its labels as JSON; None before the rendering is complete."""
        rows = self.query("SELECT survey, labels FROM result")
        return rows[0] if rows else None

    def query(self, statement: str, *values: Any) -> list[Any]:
        """The rows; none while there is no cache yet."""
        try:
            if self.database is None:
                uri = f"{self.path.absolute().as_uri()}?mode=ro"
                self.database = sqlite3.connect(uri, PATIENCE, uri=True, check_same_thread=False)
            return self.database.execute(statement, values).fetchall()
        except sqlite3.OperationalError:
            self.close()
            return []

    def close(self) -> None:
        """Let go of the file."""
        if self.database is not None:
            self.database.close()
            self.database = None


def cache_path(recording: Path, configuration: Mapping[str, Any]) -> Path:
    """Where the cache of a recording stands: its name tells all that its frames follow from."""
    known = hashlib.sha256(recording.read_bytes())
    known.update(json.dumps(configuration, sort_keys=True).encode())
    known.update(version_of_code().encode())
    return recording.parent / FOLDER / f"{recording.stem}-{known.hexdigest()[:16]}{SUFFIX}"


@lru_cache(maxsize=1)
def version_of_code() -> str:
    """Another one whenever a file changes that may change a frame."""
    root = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for package in ("server", "slam"):
        for path in sorted((root / package).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def remove(path: Path) -> None:
    """Delete a cache with what SQLite keeps beside it."""
    for suffix in ("", "-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)


def prune(folder: Path, limit: int, kept: Iterable[Path]) -> None:
    """Delete the caches that were watched longest ago until those left have at most `limit` bytes; never the kept."""
    caches = [(path.stat(), path) for path in folder.glob(f"*{SUFFIX}")]
    total = sum(facts.st_size for facts, _ in caches)
    spared = set(kept)
    for facts, path in sorted(caches, key=lambda cache: cache[0].st_mtime_ns):
        if total > limit and path not in spared:
            remove(path)
            total -= facts.st_size
