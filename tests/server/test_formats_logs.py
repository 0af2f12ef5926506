"""Foreign logs: rows become messages in file order, a laser becomes sparse as documented, and broken logs are told."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest

from server.formats import FormatError, read_log
from server.formats.carmen import format_flaser, format_odom, read_carmen, write_carmen
from server.formats.sparse import Reduction, reduce_scans, sensors_of
from server.messages import Odometry, Ranges
from tests.server.logs import write_room_log

DATA = Path(os.environ.get("CRUNCH_DATA", Path(__file__).resolve().parents[2] / "data"))
POSE = np.array([1.0, 2.0, 0.5])


def write_one(path: Path, ranges: np.ndarray, pose: np.ndarray = POSE) -> None:
    write_carmen(path, [format_odom(1.0, pose), format_flaser(2.0, ranges, pose)])


def sensed(path: Path, **options) -> dict[str, np.ndarray]:
    return {
        message.sensor: message.ranges
        for message in read_log(path, **options).messages()
        if isinstance(message, Ranges)
    }


def test_rows_come_in_file_order_at_their_own_times(tmp_path):
    path = tmp_path / "a.log"
    rows = [
        format_odom(5.0, POSE),
        format_odom(4.0, 2 * POSE),
        format_flaser(4.5, np.ones(180), POSE),
        format_odom(5.0, POSE),
    ]
    path.write_text("# comment\nPARAM robot_width 0.5\n" + "".join(rows) + "RAWLASER1 nonsense\n")
    log = read_log(path)
    messages = list(log.messages())
    assert [message.t for message in messages] == [5.0, 4.0, 4.5, 4.5, 5.0]
    assert [type(message) for message in messages] == [Odometry, Odometry, Ranges, Ranges, Odometry]
    assert log.n_odometry == 3
    assert len(list(log.messages())) == 5, "a log can be read again"


def test_beams_stand_where_carmen_puts_them(tmp_path):
    for n_beams, step, last in ((180, 1.0, 89.0), (181, 1.0, 90.0), (360, 0.5, 89.5), (361, 0.5, 90.0)):
        write_one(tmp_path / "a.log", np.ones(n_beams))
        bearings = np.degrees(read_carmen(tmp_path / "a.log").bearings)
        np.testing.assert_allclose([bearings[0], bearings[1] - bearings[0], bearings[-1]], [-90.0, step, last])


def test_a_laser_of_180_degrees_gives_five_of_eight(tmp_path):
    write_one(tmp_path / "a.log", np.full(181, 0.5))
    sensors = read_log(tmp_path / "a.log").sensors
    assert sensors is not None
    assert sensors["infrared"].bearings_deg == sensors["sonar"].bearings_deg == (-90.0, -45.0, 0.0, 45.0, 90.0)
    assert sensors["infrared"].max_range == 0.8
    assert sensors["sonar"].half_angle_deg == 22.5


def test_infrared_is_the_one_beam_and_sonar_the_nearest_of_its_cone(tmp_path):
    ranges = np.full(181, 2.0)
    ranges[90] = 0.7  # straight ahead
    ranges[90 + 45 + 22] = 1.1  # within the left sonar's cone
    ranges[90 - 45 - 23] = 0.3  # just outside the right one's, within the next
    write_one(tmp_path / "a.log", ranges)
    seen = sensed(tmp_path / "a.log")
    np.testing.assert_allclose(seen["infrared"], [math.inf, math.inf, 0.7, math.inf, math.inf])
    np.testing.assert_allclose(seen["sonar"], [0.3, 2.0, 0.7, 1.1, 2.0])


def test_ranges_at_the_reach_are_no_return_and_zero_was_not_measured(tmp_path):
    ranges = np.full(181, 81.83)
    ranges[90] = 3.0
    ranges[:23] = 0.0
    write_one(tmp_path / "a.log", ranges)
    seen = sensed(tmp_path / "a.log")
    np.testing.assert_array_equal(seen["sonar"], [math.nan, math.inf, math.inf, math.inf, math.inf])
    assert math.isnan(seen["infrared"][0])


def test_thinned_beams_are_evenly_spread(tmp_path):
    write_one(tmp_path / "a.log", np.linspace(1.0, 2.8, 181))
    log = read_log(tmp_path / "a.log", beams=11, max_range=2.0)
    assert log.sensors is not None
    ring = log.sensors["laser"]
    assert ring.bearings_deg == tuple(-90.0 + 18.0 * i for i in range(11))
    assert (ring.model, ring.max_range) == ("beam", 2.0)
    expected = 1.0 + 0.18 * np.arange(11)
    np.testing.assert_allclose(
        sensed(tmp_path / "a.log", beams=11, max_range=2.0)["laser"][:6], expected[:6], atol=1e-3
    )
    assert np.all(np.isinf(sensed(tmp_path / "a.log", beams=11, max_range=2.0)["laser"][6:]))


def test_thinned_beams_bring_their_preset_and_crunchs_senses_none(tmp_path):
    write_one(tmp_path / "a.log", np.ones(181))
    assert read_log(tmp_path / "a.log", beams=11).configuration == {"preset": "beams"}
    assert not read_log(tmp_path / "a.log").configuration


def test_a_laser_that_sees_all_round_gives_all_eight():
    bearings = np.radians(np.arange(-180, 180))
    sensors = {sensor.name: sensor for sensor in sensors_of(bearings, Reduction())}
    assert sensors["sonar"].ring.bearings_deg == tuple(-180.0 + 45.0 * i for i in range(8))
    scans = np.full((1, 360), 2.0)
    scans[0, 90] = 0.4  # at -90 degrees
    np.testing.assert_allclose(reduce_scans(scans, sensors["sonar"])[0], [2.0, 2.0, 0.4, 2.0, 2.0, 2.0, 2.0, 2.0])


def test_robotlaser_tells_its_own_bearings_reach_and_place(tmp_path):
    ranges = " ".join(["1.0"] * 4 + ["8.1"])
    x, y = 1.0 + 0.2 * math.cos(0.5), 2.0 + 0.2 * math.sin(0.5)
    row = f"ROBOTLASER1 0 -1.0 2.0 0.5 8.1 0.01 0 5 {ranges} 0 {x} {y} 0.5 1 2 0.5 0 0 0.3 0.3 0.0 7.5 host 7.6\n"
    (tmp_path / "a.log").write_text(format_odom(1.0, POSE) + row)
    log = read_carmen(tmp_path / "a.log")
    np.testing.assert_allclose(log.bearings, [-1.0, -0.5, 0.0, 0.5, 1.0])
    np.testing.assert_allclose(log.mount, [0.2, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(log.scans, [[1.0, 1.0, 1.0, 1.0, math.inf]])
    assert log.scan_times[0] == 7.5
    odometry = next(message for message in read_log(tmp_path / "a.log").messages() if isinstance(message, Odometry))
    np.testing.assert_allclose([odometry.x, odometry.y, odometry.theta], [x, y, 0.5])


def test_a_cut_last_row_ends_the_log_with_a_warning(tmp_path):
    path = tmp_path / "a.log"
    write_room_log(path, laps=1)
    whole = read_log(path)
    content = path.read_bytes()
    for cut in (20, 30, 400):
        path.write_bytes(content[:-cut])
        log = read_log(path)
        assert log.truncated_at is not None
        assert f":{log.truncated_at}: the last row is cut" in log.warnings[0]
        assert whole.n_odometry - 1 <= log.n_odometry <= whole.n_odometry


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "is empty"),
        (b" \n\n", "is empty"),
        (bytes(np.random.default_rng(3).integers(0, 256, 100_000, np.uint8)), "is no log that crunch knows"),
        (b"hello\nworld\n", "is no log that crunch knows"),
        (format_flaser(2.0, np.ones(180), POSE).encode(), "holds no odometry"),
        (format_odom(1.0, POSE).encode(), "holds no ranges"),
        (b"ODOM 1 2\n\n", ":1: ODOM row with 3 fields"),
        (b"ODOM 1 2 x 0 0 0 1 host 1\n\n", ":1: ODOM row with a field that is not a number"),
        (b"ODOM 1 2 nan 0 0 0 1 host 1\n\n", ":1: ODOM row with a field that is not finite"),
        (b"FLASER 180 1 2 3\n\n", ":1: broken FLASER row"),
        (b"FLASER x\n\n", ":1: broken FLASER row"),
        (b"ROBOTLASER1 0 1\n\n", ":1: broken ROBOTLASER1 row"),
    ],
)
def test_a_broken_log_is_one_line_with_its_place(tmp_path, content, told):
    path = tmp_path / "a.log"
    path.write_bytes(content)
    with pytest.raises(FormatError) as error:
        read_log(path)
    assert str(error.value).startswith(str(path))
    assert told in str(error.value)
    assert "; " in str(error.value), "the remedy follows"


def test_lasers_of_two_kinds_in_one_log_are_refused(tmp_path):
    rows = [format_odom(1.0, POSE), format_flaser(2.0, np.ones(180), POSE), format_flaser(3.0, np.ones(90), POSE)]
    write_carmen(tmp_path / "a.log", rows)
    with pytest.raises(FormatError, match=r":4: 90 beams after rows of 180"):
        read_log(tmp_path / "a.log")


def write_sonar8(folder: Path, measurements: str, poses: str) -> Path:
    (folder / "measurement.txt").write_text(measurements)
    (folder / "poses.txt").write_text(poses)
    return folder


def test_sonar8_is_read_by_folder_and_by_file(tmp_path):
    write_sonar8(tmp_path, "1500 5110 400 1000 1 1 1 1 5100\n", "1500 1000 -2000 900\n")
    for path in (tmp_path, tmp_path / "measurement.txt", tmp_path / "poses.txt"):
        odometry, ranges = read_log(path).messages()
        assert isinstance(odometry, Odometry)
        np.testing.assert_allclose([odometry.t, odometry.x, odometry.y, odometry.theta], [1.5, 1.0, -2.0, np.pi / 2])
        assert isinstance(ranges, Ranges)
        np.testing.assert_allclose(ranges.ranges, [np.inf, 0.4, 1.0, 0.001, 0.001, 0.001, 0.001, np.inf])


@pytest.mark.parametrize(
    ("measurements", "poses", "told"),
    [
        ("1 1 1\n", "1 0 0 0\n", "measurement.txt:1: 3 fields"),
        ("1 1 1 1 1 1 1 1 x\n", "1 0 0 0\n", "measurement.txt:1: a field is not a number"),
        ("1 1 1 1 1 1 1 1 1\n", "2 0 0 0\n", "poses.txt:1: does not match"),
        ("1 1 1 1 1 1 1 1 1\n", "1 0 0 0\n2 0 0 0\n", "poses.txt:2: does not match"),
        ("", "1 0 0 0\n", "measurement.txt: is empty"),
    ],
)
def test_broken_sonar8_names_file_and_row(tmp_path, measurements, poses, told):
    with pytest.raises(FormatError, match=told):
        read_log(write_sonar8(tmp_path, measurements, poses))


def test_sonar8_without_its_poses_is_told(tmp_path):
    (tmp_path / "measurement.txt").write_text("1 1 1 1 1 1 1 1 1\n")
    with pytest.raises(FormatError, match=r"without odometry; put its poses\.txt beside it"):
        read_log(tmp_path)


@pytest.mark.skipif(not (DATA / "intel").is_dir(), reason=f"no recordings in {DATA} (CRUNCH_DATA)")
@pytest.mark.parametrize(
    ("name", "n_odometry", "n_scans"), [("intel/intel.log", 13631, 910), ("aces/aces.log", 7374, 440)]
)
def test_real_carmen_logs_hold_what_their_collectors_say(name, n_odometry, n_scans):
    log = read_carmen(DATA / name)
    assert (len(log.odometry), log.scans.shape) == (n_odometry, (n_scans, 180))
    assert not log.mount.any()
    assert np.nanmin(log.scans) > 0.0


@pytest.mark.skipif(not (DATA / "sonar8").is_dir(), reason=f"no recordings in {DATA} (CRUNCH_DATA)")
def test_real_sonars_map_sharper_with_their_bearings_than_mirrored():
    log = read_log(DATA / "sonar8")
    assert log.sensors is not None
    bearings = log.sensors["sonar"].bearings
    messages = list(log.messages())

    def occupied_cells(sign: float) -> int:
        cells = set()
        pose = None
        for message in messages:
            if isinstance(message, Odometry):
                pose = message
            elif isinstance(message, Ranges) and pose is not None:
                angles = pose.theta + sign * bearings
                seen = np.isfinite(message.ranges)
                x = pose.x + message.ranges[seen] * np.cos(angles[seen])
                y = pose.y + message.ranges[seen] * np.sin(angles[seen])
                cells |= set(zip((x // 0.1).tolist(), (y // 0.1).tolist(), strict=True))
        return len(cells)

    assert occupied_cells(1.0) < 0.95 * occupied_cells(-1.0)


@pytest.mark.parametrize(
    ("n_beams", "seen"),
    [(3, (-90.0, 0.0, 90.0)), (4, (-90.0, -45.0, 45.0, 90.0)), (5, (-90.0, -45.0, 0.0, 45.0, 90.0))],
)
def test_a_laser_of_few_beams_shows_the_directions_that_they_serve(tmp_path, n_beams, seen):
    write_one(tmp_path / "few.log", np.full(n_beams, 0.5))
    sensors = read_log(tmp_path / "few.log").sensors
    assert sensors is not None
    assert sensors["sonar"].bearings_deg == seen
    for ranges in sensed(tmp_path / "few.log").values():
        np.testing.assert_allclose(ranges, np.full(len(seen), 0.5))


def test_beams_for_a_log_without_a_laser_are_refused(tmp_path):
    (tmp_path / "measurement.txt").write_text("0 " + " ".join(["500"] * 8) + "\n")
    (tmp_path / "poses.txt").write_text("0 0 0 0\n")
    with pytest.raises(FormatError, match="has no laser that --beams could thin"):
        read_log(tmp_path, beams=5)


def test_scans_too_rare_for_few_directions_are_warned_of(tmp_path):
    write_room_log(tmp_path / "dense.log", scan_every=2)
    assert read_log(tmp_path / "dense.log").warnings == ()
    write_room_log(tmp_path / "rare.log", scan_every=6)
    (warning,) = read_log(tmp_path / "rare.log").warnings
    assert "rare.log: 1." in warning
    assert "scans per half metre" in warning
    assert read_log(tmp_path / "rare.log", beams=11).warnings == (), "which the literature does with such logs"
