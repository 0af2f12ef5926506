"""The rawlog that MRPT's programs are given, and what is made of what they leave."""

from __future__ import annotations

import gzip
import math
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest

from bench import rivals
from bench.benchmark import Crew, Row
from bench.rawlog import END, action, observation, pose_2d, pose_3d, scans_and_rows, ticks, write_rawlog
from server.errors import UserError
from server.formats.laser import LaserLog
from tests.slam.laser_world import BEARINGS, ranges_of, ring

KINDS = ("points, 10 particles", "grids, 20 particles")
needs_mrpt = pytest.mark.skipif(
    any(shutil.which(name) is None for name in ("rawlog-edit", "rbpf-slam")), reason="no MRPT here: mrpt-apps of Debian"
)


def log_of(n_scans: int) -> LaserLog:
    """Scans of a ring of walls, two rows of odometry before each, but for a first scan that has none before it."""
    poses = np.array([[5.0 + 0.02 * row, 1.0, 0.01 * row] for row in range(2 * n_scans)])
    rng = np.random.default_rng(1)
    scans = np.array([ranges_of(poses[max(2 * row - 1, 0)], ring(), rng) for row in range(n_scans + 1)])
    scans[1, :3] = math.inf, math.nan, 2.5
    times = 1e9 + 0.5 * np.arange(n_scans + 1)
    times[2] = times[1] - 0.25  # a clock that steps back
    is_scan = np.array([True] + [False, False, True] * n_scans)
    odometry_times = 1e9 + 0.25 * np.arange(2 * n_scans)
    return LaserLog(Path("log"), odometry_times, poses, times, scans, BEARINGS, np.zeros(3), is_scan)


def head_of(content: bytes) -> tuple[str, int, bytes]:
    """Class, version and the rest of what begins with a serialized object."""
    assert content[0] & 0x80
    length = content[0] & 0x7F
    return content[1 : 1 + length].decode(), content[1 + length], content[2 + length :]


def test_poses_are_written_as_mrpt_writes_them():
    zeros = bytes(24)
    one = struct.pack("<d", 1.0)
    assert pose_2d(np.zeros(3)) == b"\x94mrpt::poses::CPose2D\x01" + zeros + b"\x88"
    rotation = one + zeros + one + zeros + one
    assert pose_3d(np.zeros(3)).replace(b"\x80", b"\0") == (
        b"\x94mrpt::poses::CPose3D\x03" + zeros + rotation + b"\x88"
    ).replace(b"\x80", b"\0")
    turned = np.frombuffer(pose_3d(np.array([1.0, 2.0, math.pi / 2]))[22:-1], "<f8")
    assert turned == pytest.approx([1, 2, 0, 0, -1, 0, 1, 0, 0, 0, 0, 1], abs=1e-12)


def test_mrpts_clock_counts_from_1601():
    assert struct.unpack("<q", ticks(0.0)) == (116_444_736_000_000_000,)
    assert struct.unpack("<q", ticks(1.5)) == (116_444_736_015_000_000,)


def test_an_action_holds_its_motion_and_the_default_errors():
    name, version, rest = head_of(action(10.0, np.array([0.3, -0.1, 0.2])))
    assert (name, version) == ("mrpt::obs::CActionRobotMovement2D", 7)
    name, version, fields = head_of(rest[4:])
    assert (name, version) == ("mrpt::poses::CPose2D", 1)
    assert struct.unpack_from("<3d", fields) == (0.3, -0.1, 0.2)
    assert fields[24:25] == END
    model, *gaussian = struct.unpack_from("<I6f", fields, 25)
    assert model == 0
    assert gaussian == pytest.approx([0.01, 0.0573, 0.01745, 0.05, 0.01, 0.00349], rel=1e-3)
    assert fields[-9:] == ticks(10.0) + END


def test_an_observation_holds_its_ranges_and_what_did_not_return_is_invalid():
    ranges = np.array([1.25, math.inf, math.nan, 0.0, 2.5])
    content = observation(3.0, ranges, np.radians([-20.0, -10.0, 0.0, 10.0, 20.0]), np.zeros(3))
    name, version, fields = head_of(content)
    assert (name, version) == ("mrpt::obs::CObservation2DRangeScan", 7)
    aperture, is_counter_clockwise, _ = struct.unpack_from("<f?f", fields)
    assert (aperture, is_counter_clockwise) == (pytest.approx(math.radians(40.0)), True)
    told = fields[9 + len(pose_3d(np.zeros(3))) :]
    assert struct.unpack_from("<I5f5?", told) == (5, 1.25, 81.0, 0.0, 0.0, 2.5, True, False, False, False, True)


def test_beams_that_are_not_even_about_the_front_turn_the_sensor():
    head = struct.calcsize("<f?f")
    fields = head_of(observation(0.0, np.ones(180), BEARINGS, np.zeros(3)))[2][head:]
    cos, sin = np.frombuffer(head_of(fields)[2][: 12 * 8], "<f8")[[3, 6]]
    assert math.degrees(math.atan2(sin, cos)) == pytest.approx(-0.5)


def test_a_rawlog_has_a_motion_before_each_scan_and_time_only_goes_on(tmp_path):
    log = log_of(3)
    write_rawlog(tmp_path / "log", log)
    content = gzip.decompress((tmp_path / "log").read_bytes())
    assert content.count(b"mrpt::obs::CActionCollection\0\1\0\0\0") == 3
    assert content.count(b"mrpt::obs::CSensoryFrame\2\1\0\0\0") == 3
    assert content.index(b"CActionCollection") < content.index(b"CSensoryFrame")
    scans, rows = scans_and_rows(log)
    assert scans.tolist() == [1, 2, 3]  # what came before any odometry is left out
    assert rows.tolist() == [1, 3, 5]
    motions = [head_of(part)[2][:24] for part in content.split(b"Movement2D\7\0\0\0\0")[1:]]
    np.testing.assert_allclose(np.frombuffer(motions[0], "<f8"), 0.0, atol=1e-12)
    assert np.hypot(*np.frombuffer(motions[1], "<f8")[:2]) == pytest.approx(0.04)
    assert np.frombuffer(motions[1], "<f8")[2] == pytest.approx(0.02)
    label = b"\0\0\0\0\6\0\0\0FLASER"  # after the time
    times = [struct.unpack("<q", part[-8:])[0] for part in content.split(label)[:-1]]
    assert times == sorted(set(times))


def test_settings_take_the_place_of_what_was_said():
    before = "# [MappingApplication]\n[ICP]\nALFA=0.8\n[MappingApplication]\n"
    shipped = before + "sampleSize=10\t// few\nBETA = 0.5\n[Other]\nx=1\n"
    text = rivals.with_settings(shipped, {"sampleSize": 30, "RANDOM_SEED": 2})
    assert text == before + "sampleSize = 30\nRANDOM_SEED = 2\nBETA = 0.5\n[Other]\nx=1\n"


def test_the_final_path_has_a_pose_wherever_the_filter_ran(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "said").write_text("New pose=1\n-- STEP 1 --\n-- STEP 2 --\nNew pose=2\n-- STEP 3 --\n")
    (tmp_path / "out" / "most_likely_path.txt").write_text("0 0 0\n1 2 3\n4 5 6\n")
    steps, path = rivals.path_of(tmp_path, np.zeros((3, 3)))
    assert steps.tolist() == [0, 2]
    assert path.tolist() == [[1, 2, 3], [4, 5, 6]]
    (tmp_path / "said").write_text("New pose=1\n-- STEP 1 --\n")
    with pytest.raises(ValueError, match="2 poses of 1 steps"):
        rivals.path_of(tmp_path, np.zeros((3, 3)))


def test_without_a_final_path_there_is_a_pose_per_step(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "said").write_text("")
    (tmp_path / "out" / "log_estimated_path.txt").write_text("0 1 2 3\n1 4 5 6\n")
    steps, path = rivals.path_of(tmp_path, np.zeros((3, 3)))
    assert steps.tolist() == [0, 1]
    assert path.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_nodes_of_a_graph_stand_where_odometry_went_what_was_told(tmp_path):
    odometry = np.array([[1.0, 1.0, 0.5 * math.pi], [1.0, 1.0, 0.5 * math.pi], [1.0, 1.3, 1.6], [1.0, 1.3, 1.6]])
    (tmp_path / "graphslam_results").mkdir()
    graph = "VERTEX_SE2 1 4 5 6\nFIX 0\nVERTEX_SE2 0 1 2 3\nEDGE_SE2 0 1 1 2 3\n"
    (tmp_path / "graphslam_results" / "output_graph.graph").write_text(graph)
    turn = math.degrees(1.6 - 0.5 * math.pi)
    (tmp_path / "said").write_text(f"node:\n\t0 => 1\n\tEdge: [0.300000 0.000000 {turn:.6f}deg]\n")
    steps, path = rivals.path_of(tmp_path, odometry)
    assert steps.tolist() == [0, 2]
    assert path.tolist() == [[1, 2, 3], [4, 5, 6]]
    (tmp_path / "said").write_text("\t0 => 1\n\tEdge: [0.400000 0.000000 0.000000deg]\n")
    with pytest.raises(ValueError, match="no step after 0"):
        rivals.path_of(tmp_path, odometry)


def test_who_fails_is_told_in_the_row():
    own = [{"outcome": "mapped", "mean": 0.04, "std": 0.1, "degrees": 1.0, "seconds": 2.0, "processor": 3.0}]
    records = [{"seed": 0, "outcome": rivals.how_it_died(-11)}, own[0] | {"seed": 1, "seconds": 5.0}]
    row = Row("row", rivals.beside(records, own))
    texts = {column.title: column.text(row) for column in rivals.BENCH.columns}
    assert texts["outcome"] == "1 died of SIGSEGV, 1 mapped"
    assert texts["times ours"].startswith("2.5")
    assert rivals.how_it_died(1) == "ended with status 1"
    assert list(rivals.notes([row])) == [
        "row, by seed (m): - 0.0400",
        "lost is who errs by more than 1 m on average",
    ]


def test_without_mrpt_it_is_told_how_to_get_it(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UserError, match="apt-get install mrpt-apps"):
        list(rivals.rows(Crew(1)))


@needs_mrpt
def test_mrpt_reads_the_rawlog_and_would_write_the_same(tmp_path):
    write_rawlog(tmp_path / "ours.rawlog", log_of(20))
    command = ["rawlog-edit", "--cut", "--to-index", "1000", "-i", "ours.rawlog", "-o", "theirs.rawlog"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    ours, theirs = (gzip.decompress((tmp_path / f"{name}.rawlog").read_bytes()) for name in ("ours", "theirs"))
    assert theirs == ours


@needs_mrpt
@pytest.mark.parametrize("name", ["icp-slam", "graphslam-engine", *(f"rbpf-slam on {kind}" for kind in KINDS)])
def test_rivals_end_with_poses_and_the_seed_decides_them(name, tmp_path):
    rival, paths = rivals.RIVALS[name], []
    for seed in (1, 1, 2):
        folder = tmp_path / str(len(paths))
        folder.mkdir()
        write_rawlog(folder / "log.rawlog", log_of(40))
        assert rivals.executed(rival, folder, seed)["outcome"] == "ended"
        log = log_of(40)
        steps, path = rivals.path_of(folder, log.odometry[scans_and_rows(log)[1]])
        assert path.shape == (len(steps), 3)
        assert steps[-1] < 40
        paths.append(path)
    np.testing.assert_array_equal(paths[0], paths[1])
    assert rival.is_random == (not np.array_equal(paths[0], paths[2]))
