"""A recorded drive, and what rendering it gives."""

import json
from pathlib import Path

from server.config import load
from server.recording import Header, Kind, Reader, Recorder
from server.render import render
from server.replay_cache import CacheReader, CacheWriter, Progress
from server.simulate import Simulation, simulate_drive

SECONDS = 25.0


def drive(out: Path, seconds: float = SECONDS) -> Path:
    """The virtual robot's first seconds in the demo's world, with few particles."""
    settings = load({"crunch": {"filter": {"particles": 60}}})
    simulate_drive(Simulation("crunch", "demo", "demo", 1, out, "low", seconds), settings)
    return out


def annotated(recording: Path, out: Path, marks: list[tuple[float, dict]]) -> Path:
    """The same recording with marks (t, content) among its records."""
    reader = Reader(recording)
    noted = [(t, Kind.MARK, "", json.dumps(content).encode()) for t, content in marks]
    records = sorted([*((r.t, r.kind, r.link_id, r.data) for r in reader), *noted], key=lambda record: record[0])
    recorder = Recorder(out, Header(**{**reader.header.model_dump(), "monotonic_ns": 0}))
    for t, kind, link_id, data in records:
        recorder.append(kind, link_id, data, t)
    recorder.close()
    return out


def rendered(recording: Path, cache: Path) -> tuple[Progress, CacheReader]:
    """How a rendering ended, and what there is to see."""
    writer = CacheWriter(cache)
    last = render(recording, writer)
    writer.close()
    return last, CacheReader(cache)


def all_frames(reader: CacheReader) -> list[tuple[float, str, bytes]]:
    """Everything in a cache."""
    return reader.query("SELECT t, topic, body FROM frame ORDER BY rowid")
