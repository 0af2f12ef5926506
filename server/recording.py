"""Recordings (.rlog): the radio's bytes as they came, what was sent, and marks; append-only, recovered by scanning.

The format is told in docs/recording.md. Writing is one write(2) per record, so that a killed process loses nothing it
had recorded; what a power cut may take is bounded by `Recorder.sync`, to be called once a second in a thread. Reading
never stops at damage: a record that fails its checksum is skipped up to the next good one, and a cut end is told, not
raised.
"""

from __future__ import annotations

import os
import struct
import threading
import zlib
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from server.errors import UserError

VERSION = 1
MAGIC = b"\x93RLOG\r\n"  # not text, and broken by whoever treats it as text
START = len(MAGIC) + 1  # the version's byte follows the magic
HEAD = struct.Struct("<IIQBB")  # length of the bytes, CRC-32, monotonic ns, kind, link
CHECKED = struct.Struct("<IQBB")  # what the CRC-32 covers before the bytes
MAX_LENGTH = 1 << 20
NO_LINK = 0xFF
KIND_AT = 16  # offset of the kind within a record
SEARCH_BLOCK = 1 << 20


class Kind(IntEnum):
    """What a record is."""

    HEADER = 0
    RX = 1
    TX = 2
    MARK = 3


class LinkName(BaseModel):
    """A link of the session: the name that records refer to by its place in the header, and where it led."""

    id: str
    spec: str = ""


class Header(BaseModel):
    """First record: whose session this is, its configuration, and both clocks at its start (ns)."""

    model_config = ConfigDict(frozen=True)

    robot: str
    links: tuple[LinkName, ...]
    unix_ns: int
    monotonic_ns: int
    configuration: dict[str, Any] = {}
    seed: int = 0  # of the path filter's random numbers
    software: dict[str, str] = {}


class Record(NamedTuple):
    """One record; t in seconds since the session's start, `link_id` empty for marks."""

    t: float
    kind: Kind
    link_id: str
    data: bytes


class RecordingError(UserError):
    """A file that cannot be read as a recording, or not be made."""


class NotARecording(RecordingError):
    """Something else than a recording."""


class EmptyRecording(RecordingError):
    """No byte in the file."""


class NoHeader(RecordingError):
    """The first record is cut or damaged."""


class FutureVersion(RecordingError):
    """Written by a newer version than this one."""


class Recorder:
    """Writes a new recording. Trouble with the disk is counted and told, and never stops the robot."""

    def __init__(self, path: Path, header: Header) -> None:
        self.path = path
        self.start_ns = header.monotonic_ns
        self.places = {name.id: place for place, name in enumerate(header.links)} | {"": NO_LINK}
        self.records = 0
        self.bytes = 0
        self.failed = 0  # records that the disk did not take
        self.error = ""
        self.closing = threading.Lock()  # keeps close() from pulling the file away under sync()
        content = header.model_dump_json().encode()
        try:
            self.descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o644)
            first = pack(Kind.HEADER, NO_LINK, content, header.monotonic_ns)
            self._write(MAGIC + bytes((VERSION,)) + first)
            os.fsync(self.descriptor)
        except OSError as error:
            raise RecordingError(
                f"{path}: cannot be written ({error.strerror}); choose another place or name"
            ) from None

    def append(self, kind: Kind, link_id: str, data: bytes, t: float) -> None:
        """Writes one record of time t (s since the session's start); KeyError for a link not named in the header."""
        record = pack(kind, self.places[link_id], data, self.start_ns + round(t * 1e9))
        try:
            self._write(record)
            self.records += 1
        except OSError as error:
            self.failed += 1
            self.error = error.strerror or str(error)

    def sync(self) -> None:
        """Waits until all that was appended is on the disk; for a thread, since a disk may take its time."""
        with self.closing:
            if self.descriptor >= 0:
                try:
                    getattr(os, "fdatasync", os.fsync)(self.descriptor)
                except OSError as error:
                    self.error = error.strerror or str(error)

    def close(self) -> None:
        """Syncs and closes; harmless twice."""
        self.sync()
        with self.closing:
            if self.descriptor >= 0:
                os.close(self.descriptor)
            self.descriptor = -1

    def _write(self, data: bytes) -> None:
        """Writes all of it; a disk that fills up half-way leaves a piece that readers skip."""
        while data:
            written = os.write(self.descriptor, data)
            self.bytes += written
            data = data[written:]


def pack(kind: int, place: int, data: bytes, monotonic_ns: int) -> bytes:
    """One record's bytes; ValueError if the data is longer than a reader would believe."""
    if len(data) > MAX_LENGTH:
        raise ValueError(f"a record holds at most {MAX_LENGTH} bytes, not {len(data)}")
    crc = zlib.crc32(data, zlib.crc32(CHECKED.pack(len(data), monotonic_ns, kind, place)))
    return HEAD.pack(len(data), crc, monotonic_ns, kind, place) + data


class Reader:
    """Reads a recording of any length and state.

    Iterating yields the records after the header. Afterwards `truncated_at` is the offset where good records end before
    the file does (None if they do not), and `skipped` lists (offset, bytes) of damage between good records.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.content = read_content(path)
        header, self.first = self._unpack(START, (Kind.HEADER,))
        if header is None:
            raise NoHeader(f"{path}: the header at offset {START} is cut or damaged; the recording cannot be used")
        try:
            self.header = Header.model_validate_json(header.data)
        except ValidationError as error:
            where = ".".join(str(part) for part in error.errors()[0]["loc"]) or "header"
            raise NoHeader(f"{path}: the header at offset {START} says nothing usable for {where}") from None
        self.truncated_at: int | None = None
        self.skipped: list[tuple[int, int]] = []

    def __iter__(self) -> Iterator[Record]:
        self.truncated_at, self.skipped = None, []
        at = self.first
        while at < len(self.content):
            record, end = self._unpack(at, (Kind.RX, Kind.TX, Kind.MARK))
            if record is None:
                end = self._find(at + 1)
                if end is None:
                    self.truncated_at = at
                    return
                self.skipped.append((at, end - at))
            else:
                yield record
            at = end

    def _unpack(self, at: int, kinds: tuple[Kind, ...]) -> tuple[Record | None, int]:
        """The good record of one of these kinds at an offset, and the offset after it; None where there is none."""
        begin = at + HEAD.size
        if begin > len(self.content):
            return None, at
        length, crc, monotonic_ns, kind, place = HEAD.unpack_from(self.content, at)
        if length > MAX_LENGTH or begin + length > len(self.content) or kind not in kinds:
            return None, at
        data = self.content[begin : begin + length]
        if zlib.crc32(data, zlib.crc32(CHECKED.pack(length, monotonic_ns, kind, place))) != crc:
            return None, at
        if kind == Kind.HEADER:
            return Record(0.0, Kind.HEADER, "", data), begin + length
        t = (monotonic_ns - self.header.monotonic_ns) / 1e9
        return Record(t, Kind(kind), self._link_id(place), data), begin + length

    def _link_id(self, place: int) -> str:
        return self.header.links[place].id if place < len(self.header.links) else ""

    def _find(self, at: int) -> int | None:
        """The next offset where a good record begins; only offsets with a credible length and kind are tried."""
        end = len(self.content) - HEAD.size + 1
        for block in range(at, end, SEARCH_BLOCK):
            stop = min(block + SEARCH_BLOCK, end)
            window = np.frombuffer(self.content, np.uint8)[block : stop + HEAD.size]
            n = stop - block
            kinds = window[KIND_AT : KIND_AT + n]
            credible = (window[3 : 3 + n] == 0) & (window[2 : 2 + n] <= MAX_LENGTH >> 16)
            credible &= (kinds >= Kind.RX) & (kinds <= Kind.MARK)
            for candidate in np.flatnonzero(credible):
                if self._unpack(block + int(candidate), (Kind.RX, Kind.TX, Kind.MARK))[0] is not None:
                    return block + int(candidate)
        return None


def read_content(path: Path) -> bytes:
    """The whole file, if it begins like a recording that this version can read; RecordingError otherwise."""
    if path.is_dir():
        raise RecordingError(f"{path}: is a directory; name one recording (.rlog) in it")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror})") from None
    if not content:
        raise EmptyRecording(f"{path}: is empty; the session ended before it could write")
    if len(content) < START and (MAGIC + bytes((VERSION,))).startswith(content):
        raise NoHeader(f"{path}: ends at offset {len(content)}, within the header; the recording cannot be used")
    if not content.startswith(MAGIC):
        raise NotARecording(f"{path}: offset 0 is not the beginning of an .rlog; give a file that crunch has recorded")
    version = content[START - 1]
    if version != VERSION:
        where = f"{path}: offset {START - 1}"
        raise FutureVersion(f"{where} says format {version}, but this crunch reads {VERSION}; install a newer one")
    return content


def is_recording(path: Path) -> bool:
    """Whether a file begins like a recording."""
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC
