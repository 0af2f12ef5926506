"""The shelf tells what each recording holds, whatever state it is in, and what was deleted can be taken back."""

import json
from pathlib import Path

import pytest

from server.recording import Header, Kind, LinkName, Recorder
from server.shelf import Busy, NoSuchRecording, Shelf

BEGAN = 1_767_268_800_000_000_000  # ns, 2026-01-01T12:00:00Z


def record(folder: Path, name: str, seconds: float = 10.0, title: str = "", began: int = BEGAN) -> Path:
    """A recording with a byte a second."""
    path = folder / f"{name}.rlog"
    recorder = Recorder(path, Header(robot="crunch", links=(LinkName(id="a"),), unix_ns=began, monotonic_ns=0))
    for second in range(1, int(seconds) + 1):
        recorder.append(Kind.RX, "a", b"x", float(second))
    if title:
        recorder.append(Kind.MARK, "", json.dumps({"name": title}).encode(), seconds)
    recorder.close()
    return path


def test_recordings_come_newest_first_with_what_they_hold(tmp_path):
    record(tmp_path, "old", 5.0, began=BEGAN - 10**12)
    record(tmp_path, "new", 7.0, title="Third floor")
    record(tmp_path, "simulated", began=0)
    (tmp_path / "notes.txt").write_text("no recording")
    shelf = Shelf(tmp_path, lambda: "new")
    found = shelf.recordings()
    assert [one.id for one in found] == ["new", "old", "simulated"]
    assert (found[0].name, found[0].duration_s, found[0].running) == ("Third floor", 7.0, True)
    assert str(found[0].began) == "2026-01-01 12:00:00+00:00"
    assert (found[1].name, found[1].running, found[2].began) == ("", False, None)
    assert found[0].size == (tmp_path / "new.rlog").stat().st_size


def test_cut_damaged_and_foreign_files_are_told(tmp_path):
    content = record(tmp_path, "whole").read_bytes()
    (tmp_path / "cut.rlog").write_bytes(content[:-5])
    (tmp_path / "damaged.rlog").write_bytes(content[:-60] + b"????" + content[-56:])
    (tmp_path / "foreign.rlog").write_text("a diary")
    (tmp_path / "empty.rlog").touch()
    shelf = Shelf(tmp_path)
    assert not shelf.recording("whole").truncated
    assert shelf.recording("cut").truncated
    assert shelf.recording("cut").duration_s == 9.0
    assert shelf.recording("damaged").damaged == 1
    assert "not the beginning of an .rlog" in shelf.recording("foreign").error
    assert "is empty" in shelf.recording("empty").error


def test_a_recording_that_grows_is_scanned_again_and_its_title_stays(tmp_path):
    path = record(tmp_path, "run", 3.0)
    shelf = Shelf(tmp_path)
    shelf.rename("run", "Cellar")
    assert shelf.recording("run").duration_s == 3.0
    path.unlink()
    record(tmp_path, "run", 6.0, title="Roof")
    again = Shelf(tmp_path)
    assert (again.recording("run").duration_s, again.recording("run").name) == (6.0, "Cellar")
    assert again.rename("run", "").name == "Roof", "without a title the session's own counts"


def test_what_did_not_change_is_read_once(tmp_path, monkeypatch):
    record(tmp_path, "run")
    Shelf(tmp_path).recordings()
    monkeypatch.setattr("server.shelf.figures_of", lambda path: pytest.fail("read again"))
    assert Shelf(tmp_path).recording("run").duration_s == 10.0


def test_deleted_is_in_the_trash_and_comes_back(tmp_path):
    content = record(tmp_path, "run").read_bytes()
    shelf = Shelf(tmp_path)
    shelf.rename("run", "Cellar")
    shelf.delete("run")
    assert shelf.recordings() == []
    with pytest.raises(NoSuchRecording):
        shelf.recording("run")
    assert shelf.restore("run").name == "Cellar"
    assert (tmp_path / "run.rlog").read_bytes() == content
    with pytest.raises(NoSuchRecording):
        shelf.restore("run")


def test_nothing_is_overwritten_and_nothing_running_is_deleted(tmp_path):
    record(tmp_path, "run")
    shelf = Shelf(tmp_path, lambda: "run")
    with pytest.raises(Busy, match="end the session first"):
        shelf.delete("run")
    shelf.running = lambda: None
    shelf.delete("run")
    record(tmp_path, "run", 2.0)
    with pytest.raises(Busy, match="another recording"):
        shelf.restore("run")
    assert shelf.recording("run").duration_s == 2.0


def test_the_trash_keeps_all_of_one_name_and_gives_the_last_one_back(tmp_path):
    shelf = Shelf(tmp_path)
    contents = []
    for duration in (10.0, 2.0, 6.0):
        contents.append(record(tmp_path, "run", duration).read_bytes())
        shelf.delete("run")
    record(tmp_path, "run-4")
    trash = tmp_path / ".trash"
    assert sorted(path.read_bytes() for path in trash.iterdir()) == sorted(contents)
    assert shelf.restore("run").duration_s == 6.0
    assert {shelf.restore("run-2").duration_s, shelf.restore("run-3").duration_s} == {10.0, 2.0}


@pytest.mark.parametrize("name", ["", ".", "..", "../run", "/etc/passwd", ".trash/run", "a\0b", ".hidden", "none"])
def test_names_lead_nowhere_else(tmp_path, name):
    folder = tmp_path / "recordings"
    folder.mkdir()
    record(tmp_path, "run")
    record(folder, ".hidden")
    shelf = Shelf(folder)
    for call in (shelf.path, shelf.recording, shelf.delete, shelf.restore, lambda name: shelf.rename(name, "x")):
        with pytest.raises(NoSuchRecording):
            call(name)


def test_a_folder_that_is_not_there_holds_nothing(tmp_path):
    assert Shelf(tmp_path / "none").recordings() == []
