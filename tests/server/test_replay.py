"""Replay: the same log gives the same bytes, every odometry reading gets a pose, and poor logs are refused."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from server.channels import CHANNELS, INFRARED, ODOMETRY, SONAR
from server.config import load
from server.errors import UserError
from server.formats import FormatError, read_log
from server.formats.g2o import read_g2o
from server.formats.ros_map import FREE, OCCUPIED, read_ros_map
from server.formats.tum import read_tum
from server.link import Decoder, encode
from server.recorded import open_log
from server.recording import Reader, Recorder
from server.replay import Options, replay, run_log
from server.robots.crunch import CrunchParams
from server.simulate import Simulation, simulate_drive
from slam.evaluate import absolute_error
from tests.server.logs import write_room_log

FILES = {
    "trajectory.tum", "map.png", "map.pgm", "map.yaml", "map.json", "path.g2o", "profile.csv", "report.json",
}  # fmt: skip
FEW = {"crunch": {"filter": {"particles": 300}}}


@pytest.fixture(scope="module")
def room_log(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("room") / "room.log"
    write_room_log(path)
    return path


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("drive") / "drive.rlog"
    simulate_drive(Simulation("crunch", "demo", "demo", 5, path, duration=20.0), load())
    return path


def options(seed: int = 0, threads: int = 1, **more) -> Options:
    return Options(seed=seed, threads=threads, flags=FEW, **more)


def test_every_odometry_reading_gets_a_pose_in_file_order(room_log, tmp_path):
    report = replay(room_log, tmp_path, options())
    times, poses = read_tum(tmp_path / "trajectory.tum")
    recorded = [message.t for message in read_log(room_log).messages() if type(message).__name__ == "Odometry"]
    np.testing.assert_allclose(times, recorded, atol=1e-6)
    assert report.odometry_readings == len(poses) == len(recorded)


def test_outputs_are_there_and_agree_with_each_other(room_log, tmp_path):
    report = replay(room_log, tmp_path, options())
    assert {path.name for path in tmp_path.iterdir()} == FILES
    assert json.loads((tmp_path / "report.json").read_text()) == report.model_dump()
    drawn = json.loads((tmp_path / "map.json").read_text())
    graph = read_g2o(tmp_path / "path.g2o")
    assert len(drawn["path"]) == len(graph.vertices) == report.vertices
    np.testing.assert_allclose(graph.vertices, drawn["path"], atol=1e-3)
    assert len((tmp_path / "profile.csv").read_text().splitlines()) == report.vertices + 1
    grid = read_ros_map(tmp_path / "map.yaml")
    assert {FREE, OCCUPIED} <= set(grid.cells.ravel().tolist())


def test_the_map_is_nearer_to_the_truth_than_odometry(tmp_path):
    times, truth = write_room_log(tmp_path / "room.log", laps=4, turn_bias=0.04)
    result = run_log(read_log(tmp_path / "room.log"), CrunchParams(), seed=1)
    assert len(times) == len(result.trajectory)
    corrected = absolute_error(result.trajectory, truth).translation.rmse
    assert corrected < 0.6 * absolute_error(result.drive.odometry, truth).translation.rmse


def test_seed_decides_the_bytes_and_threads_do_not(room_log, tmp_path):
    for name, chosen in {"a": options(), "b": options(), "threads": options(threads=2), "seed": options(1)}.items():
        replay(room_log, tmp_path / name, chosen)
    first = (tmp_path / "a" / "trajectory.tum").read_bytes()
    assert (tmp_path / "b" / "trajectory.tum").read_bytes() == first
    assert (tmp_path / "threads" / "trajectory.tum").read_bytes() == first
    assert (tmp_path / "seed" / "trajectory.tum").read_bytes() != first


def test_hash_seed_of_the_process_changes_nothing(recording, tmp_path):
    for hash_seed in ("1", "2"):
        command = [sys.executable, "-m", "server", "replay", str(recording), "--out", str(tmp_path / hash_seed)]
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
        subprocess.run([*command, "--particles", "100", "--quiet"], check=True, env=environment)
    first, second = ((tmp_path / name / "trajectory.tum").read_bytes() for name in ("1", "2"))
    assert first == second


def test_a_cut_recording_replays_up_to_the_cut_and_says_so(recording, tmp_path):
    whole = replay(recording, tmp_path / "whole", options())
    cut = tmp_path / "cut.rlog"
    cut.write_bytes(recording.read_bytes()[: recording.stat().st_size // 2 + 3])
    report = replay(cut, tmp_path / "cut", options())
    assert whole.truncated_at is None
    assert report.truncated_at is not None
    assert f"{cut}:{report.truncated_at}: the recording is cut here" in report.warnings[0]
    times, _ = read_tum(tmp_path / "whole" / "trajectory.tum")
    cut_times, _ = read_tum(tmp_path / "cut" / "trajectory.tum")
    assert 0.4 * len(times) < len(cut_times) < 0.6 * len(times)
    np.testing.assert_array_equal(cut_times, times[: len(cut_times)])


def test_the_recordings_settings_count_below_the_files(recording, tmp_path):
    log = open_log(recording)
    assert log.robot == "crunch"
    assert log.configuration == {}, "a simulated recording carries only what was set"
    report = replay(recording, tmp_path, Options(threads=1, assignments=["crunch.filter.particles=50"]))
    assert report.particles == 50


def write_without(recording: Path, dropped: set[int], path: Path) -> Path:
    """The recording again, without some of its channels."""
    reader, decoder = Reader(recording), Decoder()
    recorder = Recorder(path, reader.header)
    for record in reader:
        frames = [frame for frame in decoder.feed(record.data) if frame.channel not in dropped]
        recorder.append(record.kind, record.link_id, b"".join(encode(frame) for frame in frames), record.t)
    recorder.close()
    return path


@pytest.mark.parametrize(
    ("dropped", "told"),
    [
        ({ODOMETRY}, "holds no odometry"),
        ({SONAR, INFRARED}, "holds no ranges"),
        (set(CHANNELS), "holds no frame that can be read"),
    ],
)
def test_a_recording_without_what_a_map_needs_is_told(recording, tmp_path, dropped, told):
    path = write_without(recording, dropped, tmp_path / "poor.rlog")
    with pytest.raises(FormatError, match=told):
        replay(path, tmp_path / "out", options())


def test_one_of_two_kinds_of_sensor_is_enough(recording, tmp_path):
    path = write_without(recording, {SONAR}, tmp_path / "deaf.rlog")
    assert replay(path, tmp_path / "out", options()).vertices > 1


def test_unknown_robot_and_unwritable_place_are_told(room_log, tmp_path):
    with pytest.raises(UserError, match="robot `crash` is unknown; known: crunch"):
        replay(room_log, tmp_path / "out", options(robot="crash"))
    (tmp_path / "file").write_text("")
    with pytest.raises(FormatError, match="cannot be written"):
        replay(room_log, tmp_path / "file", options())


def test_progress_rises_with_the_odometry_read(tmp_path):
    write_room_log(tmp_path / "long.log", laps=6)
    seen: list[int] = []
    log = read_log(tmp_path / "long.log")
    run_log(log, CrunchParams(), progress=seen.append)
    assert seen
    assert seen == sorted(seen)
    assert seen[-1] <= log.n_odometry
