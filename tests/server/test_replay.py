"""Replay: the same log gives the same bytes, every odometry reading gets a pose, and poor logs are refused."""

from __future__ import annotations

import csv
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
from server.formats.carmen import format_odom
from server.formats.g2o import read_g2o
from server.formats.ros_map import FREE, OCCUPIED, read_ros_map
from server.formats.tum import read_tum
from server.link import Decoder, encode
from server.recorded import open_log
from server.recording import Reader, Recorder
from server.replay import Options, replay, run_log
from server.robots.crunch import CrunchParams, make_estimator
from server.simulate import Simulation, simulate_drive
from slam.evaluate import absolute_error
from slam.pose import between, compose
from slam.refined_filter import RefinedFilter
from tests.server.logs import BEARINGS, cast, drive, write_room_log

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


def estimator_of(log_path: Path, few: dict) -> RefinedFilter:
    """What a replay's estimator has come to before it refines, for seed 0."""
    log = open_log(log_path)
    params = load(few, header=log.configuration).crunch
    path_filter = make_estimator(params, 0)
    for keyframe in run_log(log, params).drive.keyframes:
        path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
    return path_filter


def assert_written(out: Path, deviations: np.ndarray, source: str) -> None:
    """All three files in `out` tell these standard deviations (v, 3) of this source."""
    rows = list(csv.DictReader((out / "profile.csv").read_text().splitlines()))
    found = [[float(row[name]) for name in ("x_std", "y_std", "heading_std")] for row in rows]
    np.testing.assert_allclose(found, deviations, atol=6e-5)
    spread = np.sqrt(deviations[:, 0] ** 2 + deviations[:, 1] ** 2)
    np.testing.assert_allclose(json.loads((out / "map.json").read_text())["spread"], spread, atol=6e-4)
    told = json.loads((out / "report.json").read_text())["uncertainty"]
    assert told.pop("source") == source
    expected = {
        "spread_median_m": np.median(spread), "spread_worst_m": spread.max(),
        "heading_median_rad": np.median(deviations[:, 2]), "heading_worst_rad": deviations[:, 2].max(),
    }  # fmt: skip
    assert told == pytest.approx(expected, abs=6e-5)


def test_a_refined_path_is_written_with_its_covariances(room_log, tmp_path):
    replay(room_log, tmp_path, options())
    path_filter = estimator_of(room_log, FEW)
    path_filter.refine()
    assert path_filter.correction is not None
    variances = np.diagonal(path_filter.correction.covariances.marginals(), axis1=1, axis2=2)
    assert variances.min() > 0.0
    assert_written(tmp_path, np.sqrt(variances), "refinement")


@pytest.mark.parametrize("particles", [300, 2600])
def test_without_refinement_the_particles_say_how_certain_the_path_is(room_log, tmp_path, particles):
    """On one island and on two."""
    few = {"crunch": {"filter": {"particles": particles}, "refinement": {"rounds": 0}}}
    replay(room_log, tmp_path, Options(threads=1, flags=few))
    path_filter = estimator_of(room_log, few)
    path_filter.refine()  # tells the better island
    found = path_filter.path_filter.uncertainty(1).deviations
    assert found.max() > 0.0
    assert_written(tmp_path, found, "particles")


def test_bundled_echoes_leave_the_word_to_the_particles(room_log, tmp_path):
    report = replay(room_log, tmp_path, options(beams=11))
    assert report.uncertainty.source == "particles"
    assert report.uncertainty.spread_worst_m is not None
    assert len(json.loads((tmp_path / "map.json").read_text())["spread"]) == report.vertices


def test_a_search_without_refinement_is_of_unknown_certainty(room_log, tmp_path):
    assignments = ["crunch.estimator=search", "crunch.refinement.rounds=0", "crunch.perturbations=5"]
    report = replay(room_log, tmp_path, options(assignments=assignments))
    assert set(report.uncertainty.model_dump().values()) == {"none", None}
    assert json.loads((tmp_path / "map.json").read_text())["spread"] == []
    rows = list(csv.DictReader((tmp_path / "profile.csv").read_text().splitlines()))
    assert len(rows) == report.vertices
    assert {row[name] for row in rows for name in ("x_std", "y_std", "heading_std")} == {""}


def test_the_map_is_nearer_to_the_truth_than_odometry(tmp_path):
    times, truth = write_room_log(tmp_path / "room.log", laps=4, turn_bias=0.04)
    result = run_log(read_log(tmp_path / "room.log"), CrunchParams(), seed=1)
    assert len(times) == len(result.trajectory)
    corrected = absolute_error(result.trajectory, truth).translation.rmse
    assert corrected < 0.6 * absolute_error(result.drive.odometry, truth).translation.rmse


def test_seed_decides_the_bytes_and_threads_do_not(room_log, tmp_path):
    """Of the filter's path: refined, all seeds may come to the same."""
    plain = {"crunch": {**FEW["crunch"], "refinement": {"rounds": 0}}}
    for name, seed, threads in (("a", 0, 1), ("b", 0, 1), ("threads", 0, 2), ("seed", 1, 1)):
        replay(room_log, tmp_path / name, Options(seed=seed, threads=threads, flags=plain))
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
    assert open_log(recording).configuration == {}, "a simulated recording carries only what was set"
    path, file = tmp_path / "set.rlog", tmp_path / "set.toml"
    settings = load(assignments=["crunch.filter.particles=77"])
    simulate_drive(Simulation("crunch", "demo", "demo", 5, path, duration=8.0), settings)
    file.write_text("[crunch.filter]\nparticles = 50\n")
    assert open_log(path).robot == "crunch"
    assert open_log(path).configuration == {"crunch": {"filter": {"particles": 77}}}
    assert replay(path, tmp_path / "plain", Options(threads=1)).particles == 77
    assert replay(path, tmp_path / "file", Options(threads=1, file=file)).particles == 50


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


def test_a_jump_of_the_odometry_costs_resolution_and_nothing_else(room_log, tmp_path):
    lines = room_log.read_text().splitlines(keepends=True)
    for row in range(len(lines) // 2, len(lines)):
        if lines[row].startswith("ODOM"):
            words = lines[row].split(" ")
            lines[row] = " ".join([words[0], str(float(words[1]) + 9000.0), *words[2:]])
    (tmp_path / "jump.log").write_text("".join(lines))
    report = replay(tmp_path / "jump.log", tmp_path / "out", options())
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    assert any("km, so map.pgm has cells of" in warning for warning in report.warnings)


def test_the_report_tells_runs_apart(room_log, tmp_path):
    plain = replay(room_log, tmp_path / "plain", Options(threads=1, assignments=["crunch.filter.particles=60"]))
    assert (plain.preset, plain.threads, plain.beams, plain.max_range) == ("default", 1, None, None)
    assert plain.settings == {"crunch": {"filter": {"particles": 60}}}
    flags = {"preset": "thesis", "crunch": {"filter": {"particles": 60}}}
    other = replay(room_log, tmp_path / "other", Options(threads=2, beams=7, flags=flags))
    assert (other.preset, other.threads, other.beams, other.max_range) == ("thesis", 2, 7, 5.0)
    assert other.settings["crunch"]["hindsight"] == 0


def test_a_ring_of_another_size_than_the_boards_is_refused(recording, tmp_path):
    with pytest.raises(UserError, match=r"crunch\.sensors\.sonar\.bearings_deg` has 1 bearings"):
        replay(recording, tmp_path, options(assignments=["crunch.sensors.sonar.bearings_deg=[0.0]"]))


def test_beams_for_a_recording_are_refused(recording):
    with pytest.raises(FormatError, match="is a recording of a robot, which is replayed whole; leave out --beams"):
        open_log(recording, beams=5)


def write_laser_log(path: Path, mount: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A laser at `mount` on the robot of the room, as ROBOTLASER1 rows; times (n,) and true poses (n, 3)."""
    truth = drive(laps=3)
    times = 100.0 + 0.25 * np.arange(len(truth))
    rows = []
    for t, pose in zip(times, truth, strict=True):
        laser = compose(pose, mount)
        ranges = " ".join(f"{distance:.4f}" for distance in cast(laser, BEARINGS))
        head = f"ROBOTLASER1 0 {BEARINGS[0]:.9f} 3.14159 {np.radians(1.0):.9f} 50 0.01 0 {len(BEARINGS)}"
        seats = " ".join(f"{part:.6f}" for part in (*laser, *pose))
        rows += [format_odom(t, pose), f"{head} {ranges} 0 {seats} 0 0 0 0 0 {t:.6f} host {t:.6f}\n"]
    path.write_text("".join(rows))
    return times, truth


def test_the_trajectory_is_the_robots_wherever_its_laser_sits(tmp_path):
    mount = np.array([0.3, -0.1, 0.4])
    _, truth = write_laser_log(tmp_path / "offset.log", mount)
    log = read_log(tmp_path / "offset.log")
    np.testing.assert_allclose(log.mount, mount, atol=1e-5)
    result = run_log(log, CrunchParams.model_validate(FEW["crunch"]), seed=1)
    np.testing.assert_allclose(result.trajectory[0], truth[0], atol=1e-5)
    driven, true = (between(poses[:-1], poses[1:]) for poses in (result.trajectory, truth))
    turning = np.hypot(true[:, 0], true[:, 1]) < 1e-6
    swing = np.hypot(*mount[:2]) * np.pi / 16  # of the laser round the robot, at every step of a turn on the spot
    assert np.median(np.hypot(driven[turning, 0], driven[turning, 1])) < 0.2 * swing
    assert absolute_error(result.trajectory, truth).translation.rmse < 0.3
