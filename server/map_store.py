"""Saved maps in an SQLite file: what was saved stays, and a killed process loses nothing that `save` returned.

Deleting a map only marks it. All methods may be called from any thread and wait for the disk: call them off the event
loop. Uses its siblings `labels`, `map_picture`, `maps`, `survey` and `views`.
"""

from __future__ import annotations

import contextlib
import sqlite3
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from pydantic import BaseModel, Field

from server.errors import UserError
from server.labels import MOST, Place, numbered, place_of
from server.map_picture import draw_thumbnail, wall_box
from server.maps import path_length
from server.messages import Label
from server.survey import (
    Survey,
    floor_of,
    in_frame,
    labels_from_frame,
    labels_in_frame,
    pack,
    titled,
    unpack,
    wall_skew,
)
from server.views import SessionStatus

DATABASE = "crunch.db"
SCHEMA_VERSION = 1
SCHEMA = """
CREATE TABLE IF NOT EXISTS map (
    id INTEGER PRIMARY KEY AUTOINCREMENT,  -- a number is never given twice
    facts TEXT NOT NULL,  -- JSON of StoredMap
    is_deleted INTEGER NOT NULL DEFAULT 0
);
CREATE TABLE IF NOT EXISTS content (
    map_id INTEGER PRIMARY KEY REFERENCES map (id),
    survey BLOB NOT NULL,
    thumbnail BLOB NOT NULL
);
"""
PATIENCE = 10.0  # s for another process that writes


class StoreError(UserError):
    """The file cannot be used: no space, no permission, or not ours."""


class NoSuchMap(LookupError):
    """No map has this number."""


class Conflict(Exception):
    """Somebody else changed the map meanwhile."""


class Frame(BaseModel):
    """Where the map's axes stand in the world that the robot made: m, and radians counter-clockwise."""

    x: float = Field(default=0.0, ge=-1e6, le=1e6, examples=[1.5])
    y: float = Field(default=0.0, ge=-1e6, le=1e6, examples=[0.25])
    theta: float = Field(default=0.0, ge=-1e3, le=1e3, examples=[0.12])

    def pose(self) -> np.ndarray:
        """As (3,)."""
        return np.array([self.x, self.y, self.theta])


class StoredMap(BaseModel):
    """What is known of a saved map without opening it."""

    id: int = Field(default=0, examples=[3])
    name: str = Field(min_length=1, max_length=120, examples=["Ground floor"])
    note: str = Field(default="", max_length=4000, examples=["Doors to the east were shut."])
    robot: str = Field(default="", examples=["crunch"])
    session: str = Field(default="", examples=["Tuesday's drive"], description="the session's name, if it has one")
    recording: str = Field(default="", examples=["run-20260101-120000"], description="what it was made from")
    saved: float = Field(default=0.0, examples=[1767268800.0], description="seconds since 1970, UTC")
    vertices: int = Field(default=0, examples=[214])
    path_length_m: float = Field(default=0.0, examples=[106.9])
    width_m: float = Field(default=0.0, examples=[18.4], description="of the walls, along the map's x axis")
    height_m: float = Field(default=0.0, examples=[12.1], description="of the walls, along the map's y axis")
    skew_rad: float = Field(default=0.0, examples=[0.031], description="main wall direction against the map's axes")
    frame: Frame = Field(default=Frame(), examples=[{"x": 0.0, "y": 0.0, "theta": 0.0}])
    labels: list[Place] = Field(default=[], examples=[[{"id": 1, "text": "Kitchen", "x": 2.4, "y": -1.0}]])
    revision: int = Field(default=1, examples=[1], description="grows with every change")
    is_deleted: bool = Field(default=False, examples=[False])


class Change(BaseModel):
    """What to change of a map; what is left out stays. Frame and labels: the labels stand in the new frame."""

    model_config = {"extra": "forbid"}

    name: str | None = Field(default=None, min_length=1, max_length=120, examples=["Ground floor, east"])
    note: str | None = Field(default=None, max_length=4000, examples=["Doors to the east were shut."])
    frame: Frame | None = Field(default=None, examples=[{"x": 1.5, "y": 0.25, "theta": 0.12}])
    labels: list[Place] | None = Field(
        default=None, max_length=MOST, examples=[[{"text": "Kitchen", "x": 2.4, "y": -1.0}]]
    )
    revision: int | None = Field(
        default=None, examples=[1], description="the one that you have seen; with another the change is refused"
    )


class MapStore:
    """The maps in one file, which is made when it is first used."""

    def __init__(self, path: Path | str):
        self.path = Path(path)
        self.lock = threading.RLock()
        self.connection: sqlite3.Connection | None = None

    def save(
        self,
        survey: Survey,
        name: str,
        *,
        note: str = "",
        session: str = "",
        recording: str = "",
        labels: Sequence[Label] = (),
    ) -> StoredMap:
        """Keep a survey with its labels (world); it is on the disk when this returns. ValueError if it is empty."""
        if not len(survey.path):
            raise ValueError("there is no map yet; drive half a metre first")
        kept = StoredMap(
            name=name.strip() or "Map",
            note=note,
            robot=survey.robot,
            session=session,
            recording=recording,
            saved=round(time.time(), 3),
            vertices=len(survey.path),
            path_length_m=round(path_length(survey.path), 3),
            labels=[place_of(label) for label in numbered(labels)],
        )
        kept, thumbnail = portrayed(kept, survey)
        with self.transaction() as database:
            number = database.execute("INSERT INTO map (facts) VALUES (?)", (kept.model_dump_json(),)).lastrowid
            database.execute("INSERT INTO content VALUES (?, ?, ?)", (number, pack(survey), thumbnail))
        assert number is not None
        return kept.model_copy(update={"id": number})

    def maps(self, deleted: bool = False) -> list[StoredMap]:
        """All maps, or all deleted ones, the newest first."""
        with self.transaction("DEFERRED") as database:
            rows = database.execute(
                "SELECT id, facts, is_deleted FROM map WHERE is_deleted = ? ORDER BY id DESC", (deleted,)
            ).fetchall()
        return [stored(*row) for row in rows]

    def info(self, number: int) -> StoredMap:
        """What is known of a map, deleted or not; NoSuchMap."""
        with self.transaction("DEFERRED") as database:
            row = database.execute("SELECT id, facts, is_deleted FROM map WHERE id = ?", (number,)).fetchone()
        if row is None:
            raise NoSuchMap(f"there is no map {number}")
        return stored(*row)

    def survey(self, number: int) -> Survey:
        """The survey as it was saved, in the robot's world; NoSuchMap."""
        return unpack(self.content(number, "survey"))

    def thumbnail(self, number: int) -> bytes:
        """A small PNG; NoSuchMap."""
        return self.content(number, "thumbnail")

    def content(self, number: int, column: str) -> bytes:
        """A map's survey or thumbnail."""
        with self.transaction("DEFERRED") as database:
            row = database.execute(f"SELECT {column} FROM content WHERE map_id = ?", (number,)).fetchone()
        if row is None:
            raise NoSuchMap(f"there is no map {number}")
        return row[0]

    def change(self, number: int, change: Change) -> StoredMap:
        """Change what a person may; NoSuchMap, Conflict if it is not the revision that they saw any more."""
        with self.transaction() as database:
            before = self.info(number)
            if change.revision not in (None, before.revision):
                raise Conflict(f"map {number} was changed by somebody else; look at it again")
            given = {key: getattr(change, key) for key in ("name", "note", "frame") if getattr(change, key) is not None}
            labels = [place.label() for place in before.labels]
            after = before.model_copy(update={**given, "revision": before.revision + 1})
            if change.labels is not None:
                labels = numbered(place.label() for place in change.labels)
            elif change.frame is not None:
                world = labels_from_frame(labels, before.frame.pose())
                labels = labels_in_frame(world, change.frame.pose())
            after = after.model_copy(update={"labels": [place_of(label) for label in labels]})
            if change.frame is not None:
                after, thumbnail = portrayed(after, self.survey(number))
                database.execute("UPDATE content SET thumbnail = ? WHERE map_id = ?", (thumbnail, number))
            database.execute("UPDATE map SET facts = ? WHERE id = ?", (after.model_dump_json(), number))
        return after

    def delete(self, number: int) -> StoredMap:
        """Put a map away; `restore` brings it back. NoSuchMap."""
        return self.mark(number, True)

    def restore(self, number: int) -> StoredMap:
        """Take a deletion back. NoSuchMap."""
        return self.mark(number, False)

    def mark(self, number: int, is_deleted: bool) -> StoredMap:
        """Set whether a map counts as deleted."""
        with self.transaction() as database:
            database.execute("UPDATE map SET is_deleted = ? WHERE id = ?", (is_deleted, number))
            return self.info(number)

    @contextlib.contextmanager
    def transaction(self, kind: str = "IMMEDIATE") -> Iterator[sqlite3.Connection]:
        """All or nothing; one inside another is part of it; DEFERRED for reading. StoreError if the file is no use."""
        with self.lock:
            try:
                database = self.connection or self.open()
                if database.in_transaction:
                    yield database
                    return
                database.execute(f"BEGIN {kind}")
                try:
                    yield database
                except BaseException:
                    database.rollback()
                    raise
                database.commit()
            except sqlite3.Error as error:
                raise StoreError(
                    f"{self.path}: cannot be used ({error}); mend its place or name another folder with --recordings"
                ) from None

    def open(self) -> sqlite3.Connection:
        """The file, made with its folder where it is missing."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(f"{self.path.parent}: cannot be made ({error.strerror}); name another folder") from None
        database = sqlite3.connect(self.path, timeout=PATIENCE, isolation_level=None, check_same_thread=False)
        try:
            database.execute("PRAGMA journal_mode = WAL")
            database.execute("PRAGMA synchronous = FULL")  # maps are few and dear: outlive a power cut, too
            version = database.execute("PRAGMA user_version").fetchone()[0]
            if version > SCHEMA_VERSION:
                raise StoreError(f"{self.path}: was made by a newer Crunch; update this one")
            database.executescript(f"BEGIN IMMEDIATE; {SCHEMA} PRAGMA user_version = {SCHEMA_VERSION}; COMMIT;")
        except BaseException:
            database.close()
            raise
        self.connection = database
        return database

    def close(self) -> None:
        """Let go of the file; the next call opens it again."""
        with self.lock:
            if self.connection is not None:
                self.connection.close()
                self.connection = None


def keep_session(
    store: MapStore, survey: Survey, about: SessionStatus, labels: Sequence[Label], name: str = "", note: str = ""
) -> StoredMap:
    """Save the map of a session, under the session's name where no other is given."""
    name = name.strip() or about.name or f"{titled(survey.robot)}, {about.began.astimezone():%Y-%m-%d %H:%M}"
    return store.save(survey, name, note=note, session=about.name, recording=about.recording or "", labels=labels)


def stored(number: int, facts: str, is_deleted: int) -> StoredMap:
    """A row of the table."""
    return StoredMap.model_validate_json(facts).model_copy(update={"id": number, "is_deleted": bool(is_deleted)})


def portrayed(kept: StoredMap, survey: Survey) -> tuple[StoredMap, bytes]:
    """A map with the figures that follow from its frame, and its thumbnail."""
    turned = in_frame(survey, kept.frame.pose())
    floor = floor_of(turned)
    low, high = wall_box(floor)
    width, height = (round(float(side), 2) for side in high - low)
    skew = round(wall_skew(turned), 5)
    return kept.model_copy(update={"width_m": width, "height_m": height, "skew_rad": skew}), draw_thumbnail(floor)
