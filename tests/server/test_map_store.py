"""Saved maps: what was saved is there again, whole, whatever is done to the map or to the process."""

from __future__ import annotations

import io
import os
import signal
import sqlite3
import subprocess
import sys
import threading
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from server.labels import NewPlace, Place
from server.map_store import Change, Conflict, Frame, MapStore, NoSuchMap, StoreError
from server.messages import Label
from server.survey import SurveyError, labels_from_frame, labels_in_frame, pack, unpack, wall_skew
from tests.server.surveys import room_survey


@pytest.fixture
def store(tmp_path: Path) -> MapStore:
    return MapStore(tmp_path / "recordings" / "crunch.db")


def test_a_survey_comes_back_as_it_was(store):
    survey = room_survey(world=(3.0, -2.0, 0.3))
    back = store.survey(store.save(survey, "Room").id)
    for field in fields(survey):
        kept, given = getattr(back, field.name), getattr(survey, field.name)
        if field.name == "walls":
            for seen, was in zip(kept, given, strict=True):
                np.testing.assert_allclose(seen.distances, was.distances, rtol=1e-6)
                np.testing.assert_allclose(seen.free, was.free, rtol=1e-6)
        else:
            np.testing.assert_array_equal(kept, given)


def test_rays_that_met_nothing_come_back_as_infinite(store):
    survey = room_survey()
    survey.walls[0].distances[:5] = np.inf
    assert np.isinf(unpack(pack(survey)).walls[0].distances[:5]).all()


def test_a_saved_map_tells_its_figures(store):
    kept = store.save(room_survey((2.0, 1.0)), " Room ", session="Tuesday", recording="run.rlog")
    assert store.info(kept.id) == kept
    assert (kept.name, kept.session, kept.recording, kept.robot) == ("Room", "Tuesday", "run.rlog", "crunch")
    assert kept.vertices == 4
    assert kept.width_m == pytest.approx(4.0, abs=0.02)
    assert kept.height_m == pytest.approx(2.0, abs=0.02)
    picture = Image.open(io.BytesIO(store.thumbnail(kept.id)))
    assert picture.mode == "RGBA"
    alphas = np.asarray(picture)[:, :, 3]
    assert alphas.min() == 0
    assert alphas.max() > 150


def test_an_empty_map_is_refused(store):
    empty = replace(room_survey(), path=np.zeros((0, 3)), walls=[])
    with pytest.raises(ValueError, match="no map yet"):
        store.save(empty, "Nothing")
    assert store.maps() == []


def test_maps_are_listed_newest_first_and_numbers_are_never_given_twice(store):
    numbers = [store.save(room_survey(), name).id for name in ("one", "two", "three")]
    assert [kept.name for kept in store.maps()] == ["three", "two", "one"]
    store.delete(numbers[2])
    assert store.save(room_survey(), "four").id > numbers[2]


def test_a_deleted_map_can_be_taken_back_whole(store):
    kept = store.save(room_survey(), "Room", note="a note", labels=[Label(1, "Door", 1.0, 0.5)])
    assert store.delete(kept.id).is_deleted
    assert store.maps() == []
    assert [gone.id for gone in store.maps(deleted=True)] == [kept.id]
    assert len(store.survey(kept.id).path) == 4
    assert store.restore(kept.id) == kept
    assert store.maps() == [kept]


def test_changes_are_kept_and_leave_the_survey_alone(store):
    kept = store.save(room_survey(), "Room")
    before = pack(store.survey(kept.id))
    changed = store.change(kept.id, Change(name="Hall", note="wide", frame=Frame(x=1.0, theta=0.5)))
    assert (changed.name, changed.note, changed.frame.theta, changed.revision) == ("Hall", "wide", 0.5, 2)
    store.close()
    assert store.info(kept.id) == changed
    assert pack(store.survey(kept.id)) == before


def test_a_turned_frame_turns_figures_thumbnail_and_labels(store):
    turn = np.array([0.0, 0.0, 0.4])
    corner = labels_from_frame([Label(1, "Corner", 2.0, 1.0)], turn)
    kept = store.save(room_survey((2.0, 1.0), world=(0.0, 0.0, 0.4)), "Room", labels=corner)
    before = store.thumbnail(kept.id)
    assert kept.skew_rad == pytest.approx(0.4, abs=0.03)
    straight = store.change(kept.id, Change(frame=Frame(theta=kept.skew_rad)))
    assert straight.skew_rad == pytest.approx(0.0, abs=0.005)
    assert (straight.width_m, straight.height_m) == pytest.approx((4.0, 2.0), abs=0.12)
    assert (straight.labels[0].x, straight.labels[0].y) == pytest.approx((2.0, 1.0), abs=0.06)
    assert store.thumbnail(kept.id) != before
    back = store.change(kept.id, Change(frame=Frame()))
    assert (back.labels[0].x, back.labels[0].y) == pytest.approx((corner[0].x, corner[0].y), abs=1e-3)


def test_labels_go_into_a_frame_and_back():
    labels = [Label(1, "a", 1.0, 2.0), Label(2, "b", -3.0, 0.5)]
    frame = np.array([0.7, -0.2, 2.0])
    for was, now in zip(labels, labels_from_frame(labels_in_frame(labels, frame), frame), strict=True):
        assert (now.id, now.text) == (was.id, was.text)
        assert (now.x, now.y) == pytest.approx((was.x, was.y))


def test_a_new_label_gets_a_number_and_keeps_it(store):
    kept = store.save(room_survey(), "Room")
    first = store.change(kept.id, Change(labels=[Place(text="Door", x=1.0, y=0.0)])).labels
    assert [place.id for place in first] == [1]
    second = store.change(kept.id, Change(labels=[*first, Place(text="Window", x=0.0, y=1.0)])).labels
    assert [(place.id, place.text) for place in second] == [(1, "Door"), (2, "Window")]
    with pytest.raises(ValueError, match="same number"):
        store.change(kept.id, Change(labels=[*second, second[0]]))
    assert store.info(kept.id).labels == second


def test_a_change_of_what_somebody_else_has_changed_is_refused(store):
    kept = store.save(room_survey(), "Room")
    store.change(kept.id, Change(name="Anna's", revision=kept.revision))
    with pytest.raises(Conflict):
        store.change(kept.id, Change(name="Ben's", revision=kept.revision))
    assert store.info(kept.id).name == "Anna's"


@pytest.mark.parametrize("call", ["info", "survey", "thumbnail", "delete", "restore"])
def test_a_map_that_is_not_there_is_named(store, call):
    with pytest.raises(NoSuchMap, match="17"):
        getattr(store, call)(17)


def test_many_threads_save_at_once(store):
    survey = room_survey()
    threads = [threading.Thread(target=store.save, args=(survey, f"map {k}")) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {kept.name for kept in store.maps()} == {f"map {k}" for k in range(6)}


def test_two_processes_share_a_file(store):
    store.save(room_survey(), "ours")
    other = MapStore(store.path)
    other.save(room_survey(), "theirs")
    assert [kept.name for kept in store.maps()] == ["theirs", "ours"]


SAVER = """
import sys
from server.map_store import Change, Frame, MapStore
from tests.server.surveys import room_survey
store, survey = MapStore(sys.argv[1]), room_survey()
for count in range(10_000):
    number = store.save(survey, f"map {count}").id
    print("saved", number, flush=True)
    store.change(number, Change(name=f"changed {count}"))
    print("changed", number, flush=True)
    if count % 3 == 0:
        store.delete(number)
        print("deleted", number, flush=True)
"""


def test_a_killed_process_keeps_every_map_that_it_was_told_is_saved(tmp_path):
    path = tmp_path / "crunch.db"
    command = [sys.executable, "-c", SAVER, str(path)]
    root = str(Path(__file__).parents[2])
    told: dict[int, str] = {}
    environment = {**os.environ, "PYTHONPATH": root}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=root, env=environment) as run:
        assert run.stdout is not None
        for line in run.stdout:
            word, number = line.split()
            told[int(number)] = word
            if len(told) == 8:
                run.send_signal(signal.SIGKILL)
                break
        for line in run.stdout:
            if len(parts := line.split()) == 2:
                told[int(parts[1])] = parts[0]
    assert run.returncode == -signal.SIGKILL
    store = MapStore(path)
    for number, word in told.items():
        kept = store.info(number)
        assert len(store.survey(number).path) == 4
        if word != "saved":
            assert kept.name.startswith("changed")
        if word == "deleted":
            assert kept.is_deleted
    assert len(store.maps()) + len(store.maps(deleted=True)) >= 8
    with sqlite3.connect(path) as database:
        assert database.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
    database.close()


def test_a_file_that_is_no_store_is_named_and_left_alone(tmp_path):
    path = tmp_path / "crunch.db"
    path.write_bytes(b"not a database, but somebody's work" * 100)
    with pytest.raises(StoreError, match=r"crunch\.db"):
        MapStore(path).maps()
    assert path.read_bytes().startswith(b"not a database")


def test_a_store_of_a_newer_version_is_left_alone(store):
    store.save(room_survey(), "Room")
    store.close()
    with sqlite3.connect(store.path) as database:
        database.execute("PRAGMA user_version = 99")
    database.close()
    with pytest.raises(StoreError, match="newer"):
        store.maps()


def test_a_change_that_fails_half_way_changes_nothing(store):
    kept = store.save(room_survey(), "Room")

    def break_off() -> None:
        with store.transaction() as database:
            database.execute("UPDATE map SET facts = 'x'")
            database.execute("no SQL")

    with pytest.raises(StoreError):
        break_off()
    assert store.info(kept.id) == kept


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04nonsense", pack(room_survey())[:-200]])
def test_bytes_that_are_no_survey_are_refused(content):
    with pytest.raises(SurveyError):
        unpack(content)


@pytest.mark.parametrize("turn", [-0.7, -0.2, 0.0, 0.3, 0.75])
def test_the_skew_is_that_of_the_walls(turn):
    assert wall_skew(room_survey(world=(1.0, 2.0, turn))) == pytest.approx(turn, abs=0.03)


@pytest.mark.parametrize("text", ["", "x" * 81])
def test_a_label_has_a_short_text(text):
    with pytest.raises(ValueError, match="text"):
        NewPlace(text=text, x=0.0, y=0.0)
