"""Rendering a recording gives what viewers of its session saw: the same each time, and of a cut one up to the cut."""

import json
import multiprocessing
import os
from pathlib import Path

import numpy as np
import pytest

from server.config import load
from server.errors import UserError
from server.recorded import open_log
from server.recording import Reader
from server.render import configuration, run
from server.replay import run_log
from server.replay_cache import CacheReader, CacheWriter, Progress, cache_path, prune
from server.stream import decode
from server.survey import unpack
from tests.server.rendered import SECONDS, all_frames, annotated, drive, rendered


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drive(tmp_path_factory.mktemp("drive") / "drive.rlog")


def shown(reader: CacheReader, t: float) -> dict[str, tuple[dict, dict]]:
    """Header and arrays of every topic at a time."""
    return {topic: decode(b"\0\0\0\0" + body)[1:] for topic, body in reader.at(t)}


def test_the_same_recording_gives_the_same_frames(recording, tmp_path):
    first, second = (all_frames(rendered(recording, tmp_path / name)[1]) for name in ("one", "two"))
    assert len(first) > 20 * SECONDS
    assert first == second


def test_viewers_of_a_replay_see_the_map_that_a_replay_makes(recording, tmp_path):
    last, reader = rendered(recording, tmp_path / "cache")
    settings = load(header=Reader(recording).header.configuration)
    result = run_log(open_log(recording), settings.crunch)
    assert last.complete
    assert last.rendered == pytest.approx(SECONDS, abs=0.1)
    _, arrays = shown(reader, SECONDS + 1.0)["path"]
    np.testing.assert_array_equal(arrays["path"], result.path.astype(np.float32))
    kept = reader.result()
    assert kept is not None
    np.testing.assert_array_equal(unpack(kept[0]).path, result.path)
    np.testing.assert_array_equal(unpack(kept[0]).walls[3].distances, result.drive.walls[3].distances.astype("f4"))


def test_time_passes_as_it_did(recording, tmp_path):
    _, reader = rendered(recording, tmp_path / "cache")
    for t in (5.0, 17.3, 24.0):
        header, _ = shown(reader, t)["pose"]
        assert t - 0.051 <= header["t"] <= t
        assert header["age"] < 0.2
    lengths = [len(shown(reader, t)["path"][1]["path"]) for t in (6.0, 12.0, 18.0, 25.0)]
    assert lengths == sorted(lengths)
    assert lengths[0] < lengths[-1]
    between = dict(reader.between(10.0, 10.2))
    assert decode(b"\0\0\0\0" + between["pose"])[1]["t"] == pytest.approx(10.2, abs=0.051)


def test_a_cut_recording_replays_up_to_the_cut_and_says_so(recording, tmp_path):
    content = recording.read_bytes()
    cut = tmp_path / "cut.rlog"
    cut.write_bytes(content[: len(content) // 2 + 3])
    last, reader = rendered(cut, tmp_path / "cache")
    whole = rendered(recording, tmp_path / "whole")[1]
    assert "cut" in last.note
    assert last.complete
    assert 0.3 * SECONDS < last.duration < 0.7 * SECONDS
    until = last.duration - 0.5
    before = [frame for frame in all_frames(whole) if frame[0] < until and frame[1] != "status"]
    assert [frame for frame in all_frames(reader) if frame[0] < until and frame[1] != "status"] == before
    assert reader.progress() == last


def test_damage_is_passed_over_and_told(recording, tmp_path):
    content = bytearray(recording.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 20] = bytes(20)
    damaged = tmp_path / "damaged.rlog"
    damaged.write_bytes(content)
    last, _ = rendered(damaged, tmp_path / "cache")
    assert last.note == "This recording is damaged in 1 place, which are passed over."
    assert last.duration == pytest.approx(SECONDS, abs=0.1)


def test_names_goals_and_labels_come_from_the_marks(recording, tmp_path):
    marks = [
        (5.0, {"name": "Cellar"}),
        (10.0, {"command": "goal", "t": 10.0, "place": [1.0, 2.0], "speed": 0.3, "route": []}),
        (12.0, {"label": {"id": 1, "text": "Door", "vertex": 0, "x": 0.5, "y": 0.25}}),
        (15.0, {"command": "stop", "t": 15.0}),
        (15.0, {"stopped": {"t": 15.0, "reason": "pressed Stop", "by": "viewer-2"}}),
        (16.0, {"command": "goal", "misspelt": True}),
        (16.5, {"stopped": {"t": "never"}}),
        (17.0, {"of": "another version"}),
    ]
    _, reader = rendered(annotated(recording, tmp_path / "marked.rlog", marks), tmp_path / "cache")
    assert shown(reader, 4.9)["status"][0]["session"]["name"] == ""
    assert shown(reader, 6.0)["status"][0]["session"]["name"] == "Cellar"
    assert shown(reader, 14.0)["pose"][0]["goal"] == [1.0, 2.0]
    assert shown(reader, 15.5)["pose"][0]["goal"] is None
    stops = [stop for stop in shown(reader, 24.0)["status"][0]["stops"] if stop["by"] == "viewer-2"]
    assert stops == [{"t": 15.0, "reason": "pressed Stop", "by": "viewer-2"}]
    assert [label["text"] for label in shown(reader, 24.0)["labels"][0]["labels"]] == ["Door"]
    kept = reader.result()
    assert kept is not None
    assert [label[1] for label in json.loads(kept[1])] == ["Door"]


def test_a_long_silence_is_jumped_over(recording, tmp_path):
    late = annotated(recording, tmp_path / "late.rlog", [(3600.0, {"name": "an hour later"})])
    last, reader = rendered(late, tmp_path / "cache")
    assert last.duration == 3600.0
    assert len(all_frames(reader)) < 60 * (SECONDS + 10.0)


def test_a_mistake_is_told_in_the_cache(tmp_path):
    foreign = tmp_path / "foreign.rlog"
    foreign.write_text("a diary")
    process = multiprocessing.get_context("spawn").Process(target=run, args=(foreign, tmp_path / "cache", os.getpid()))
    process.start()
    process.join(60)
    assert process.exitcode == 0
    progress = CacheReader(tmp_path / "cache").progress()
    assert not progress.complete
    assert progress.error.startswith("offset 0 is not the beginning")


def test_a_robot_that_nobody_knows_is_refused(recording):
    header = Reader(recording).header.model_copy(update={"robot": "marvin"})
    with pytest.raises(UserError, match="marvin"):
        configuration(header)


def test_another_content_or_setting_is_another_cache(recording, tmp_path):
    copy = tmp_path / recording.name
    copy.write_bytes(recording.read_bytes())
    first = cache_path(copy, {"a": 1})
    assert cache_path(copy, {"a": 1}) == first
    assert cache_path(copy, {"a": 2}) != first
    copy.write_bytes(recording.read_bytes() + b"x")
    assert cache_path(copy, {"a": 1}) != first


def test_readers_see_what_was_committed_while_it_is_written(tmp_path):
    reader = CacheReader(tmp_path / "cache")
    assert reader.progress() == Progress()
    assert reader.at(1.0) == []
    writer = CacheWriter(tmp_path / "cache")
    writer.add(0.5, "pose", b"a")
    writer.commit(Progress(0.5, 10.0))
    assert reader.progress() == Progress(0.5, 10.0)
    assert reader.at(1.0) == [("pose", b"a")]
    writer.add(0.7, "pose", b"b")
    writer.add(0.7, "pose", b"c")
    assert reader.at(1.0) == [("pose", b"a")]
    writer.commit(Progress(0.7, 10.0))
    assert reader.at(1.0) == reader.between(0.5, 0.7) == [("pose", b"c")]
    assert reader.at(0.6) == [("pose", b"a")]
    assert reader.result() is None
    reader.close()
    writer.close()
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]


def test_what_was_watched_longest_ago_makes_room(tmp_path):
    caches = [tmp_path / f"{name}.replay" for name in "abcd"]
    for age, cache in enumerate(caches):
        cache.write_bytes(bytes(100))
        os.utime(cache, (age, age))
    prune(tmp_path, 400, [])
    assert all(cache.exists() for cache in caches)
    prune(tmp_path, 250, [caches[0]])
    assert [cache.exists() for cache in caches] == [True, False, False, True]
