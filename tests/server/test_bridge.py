"""A whole session by hand: the virtual robot obeys who may drive it, stands when nobody does, and a map grows."""

import math
import struct

import numpy as np
import pytest

from server import channels
from server.control import Refused
from server.link import Decoder
from server.stream import Viewer, decode
from server.words import DriveWord, GoalWord, HoldWord, PlainWord
from tests.server.live_session import HandSession


def drive(session: HandSession, speed: float, turn: float = 0.0) -> None:
    """One word of a driver in front of the present picture."""
    word = DriveWord(type="drive", speed=speed, turn=turn, seen=session.bridge.t)
    session.bridge.hear("anna", word)


def drive_for(session: HandSession, seconds: float, speed: float, turn: float = 0.0) -> None:
    """A held key: a word every 80 ms."""
    for _ in range(round(seconds / 0.08)):
        drive(session, speed, turn)
        session.advance(0.08)


def moved(session: HandSession, seconds: float) -> float:
    """Metres that the robot truly goes while time passes."""
    before = session.virtual.pose[:2]
    session.advance(seconds)
    return float(np.hypot(*(session.virtual.pose[:2] - before)))


def test_held_key_drives_and_silence_stops():
    session = HandSession()
    drive_for(session, 3.0, 0.3)
    x, y, _ = session.virtual.pose
    assert x > 0.5
    assert abs(y) < 0.3
    session.advance(3.5)  # the lease, and the time that a balancing body needs to come to rest
    assert moved(session, 2.0) < 0.1


def test_stop_of_another_viewer_holds_although_the_key_is_still_down():
    session = HandSession()
    drive_for(session, 2.0, 0.3)
    session.bridge.hear("ben", PlainWord(type="stop"))
    for _ in range(10):
        with pytest.raises(Refused):
            drive(session, 0.3)
        session.advance(0.1)
    session.advance(2.5)
    assert moved(session, 2.0) < 0.1
    assert session.bridge.status().driver.stopped_by == "ben"


def test_goal_is_reached_by_the_histogram_while_the_driver_watches():
    session = HandSession()
    session.advance(1.0)
    session.bridge.hear("anna", GoalWord(type="goal", x=1.2, y=0.8, seen=session.bridge.t))
    for _ in range(250):
        session.bridge.hear("anna", HoldWord(type="hold", seen=session.bridge.t))
        session.advance(0.1)
        if session.bridge.look().goal is None:
            break
    assert session.bridge.look().goal is None, "it arrived"
    x, y, _ = session.bridge.look().pose
    assert math.hypot(x - 1.2, y - 0.8) < 0.5
    x, y, _ = session.virtual.pose
    assert math.hypot(x - 1.2, y - 0.8) < 0.6


def test_goal_ends_when_the_driver_leaves():
    session = HandSession()
    session.bridge.hear("anna", GoalWord(type="goal", x=2.5, y=0.0, seen=session.bridge.t))
    session.advance(0.2)
    session.bridge.left("anna")
    session.advance(0.1)
    assert session.bridge.look().goal is None


def test_the_robots_own_steering_speaks_no_faster_than_the_radio_bears():
    session = HandSession()
    session.advance(0.5)
    session.bridge.hear("anna", GoalWord(type="goal", x=2.0, y=1.0, seen=session.bridge.t))
    before = session.bridge.session.sequence
    for _ in range(20):
        session.bridge.hear("anna", HoldWord(type="hold", seen=session.bridge.t))
        session.advance(0.1)
    assert 10 <= (session.bridge.session.sequence - before) % 256 <= 24, "about ten a second"


@pytest.mark.parametrize("way", ["words", "shared words", "goal"])
@pytest.mark.parametrize("period", [0.02, 0.08])
def test_whoever_drives_the_radio_bears_ten_commands_a_second(way, period):
    """A page says its wish every 80 ms, a program as often as it likes; sweeps steer to a goal, or bend the wish."""
    session = HandSession()
    session.advance(0.5)
    told = commands_on(session)
    if way == "goal":
        session.bridge.hear("anna", GoalWord(type="goal", x=2.4, y=1.0, seen=session.bridge.t))
    for _ in range(round(3.0 / period)):
        t, is_shared = session.bridge.t, way == "shared words"
        word = DriveWord(type="drive", speed=0.3, turn=0.5, seen=t, shared=is_shared)
        session.bridge.hear("anna", HoldWord(type="hold", seen=t) if way == "goal" else word)
        session.advance(period)
    times = np.array([t for t, _ in told])
    assert len(times) > 20, "and not much less"
    assert max(((times >= start) & (times < start + 1.0 - 1e-9)).sum() for start in times) <= 10
    assert np.diff(times).max() < 0.4 - 0.1, "s: the board is never near its own rule, even if one is lost"


def test_a_tap_reaches_the_radio_at_once_and_so_does_its_end():
    session = HandSession()
    session.advance(0.5)
    told = commands_on(session)
    expected = []
    for speed in (0.3, 0.0, 0.3, 0.0):
        drive(session, speed)
        expected.append((session.bridge.t, round(1000.0 * speed)))
        assert told[-1] == expected[-1]
        session.advance(0.06 if speed else 0.16)


def commands_on(session: HandSession) -> list[tuple[float, int]]:
    """The drive commands that go over the radio from now on: when, and at how many mm/s."""
    told: list[tuple[float, int]] = []
    write = session.link.write

    def listen(data: bytes) -> bool:
        frames = [frame for frame in Decoder().feed(data) if frame.channel == channels.DRIVE_COMMAND]
        told.extend((session.bridge.t, struct.unpack_from("<h", frame.payload)[0]) for frame in frames)
        return write(data)

    session.link.write = listen
    return told


def test_halt_stands_the_robot_still_whatever_was_wished():
    session = HandSession()
    drive_for(session, 1.0, 0.3)
    session.bridge.halt()
    session.advance(3.5)
    assert moved(session, 2.0) < 0.1


def test_a_robot_that_has_fallen_silent_is_not_driven_although_its_picture_is_published():
    session = HandSession()
    drive_for(session, 1.0, 0.3)
    session.virtual.advance(1.6)  # what it says is lost
    session.link.time += 1.6
    session.bridge.tick()
    with pytest.raises(Refused, match="silent"):
        drive(session, 0.3)
    with pytest.raises(Refused, match="silent"):
        session.bridge.hear("anna", GoalWord(type="goal", x=1.0, y=0.0, seen=session.bridge.t))
    session.bridge.hear("ben", PlainWord(type="stop"))
    session.bridge.hear("anna", PlainWord(type="resume"))
    session.advance(0.1)
    drive(session, 0.3)


def test_the_autopilot_drives_no_further_when_its_session_has_ended():
    session = HandSession(autopilot=True)
    session.bridge.autopilot = session.virtual
    session.bridge.sync_autopilot()
    assert session.virtual.autopilot
    session.bridge.end()
    assert session.bridge.status().driver.autopilot is False
    for word in ("ask", "release", "ask"):
        session.bridge.hear("anna", PlainWord(type=word))
        assert not session.virtual.autopilot, "words without a session move nothing"
    session.bridge.control.autopilot = True
    session.bridge.sync_autopilot()
    assert not session.virtual.autopilot, "no session runs"


def test_a_robot_without_an_autopilot_has_none_when_its_session_has_ended():
    session = HandSession()
    session.bridge.end()
    assert session.bridge.status().driver.autopilot is None


def test_map_grows_and_is_published_when_it_changes():
    session = HandSession()
    sent: list[tuple[str, dict, dict]] = []

    async def never(_: bytes) -> None:
        raise AssertionError("nothing is sent by hand")

    class Notebook(Viewer):
        def put(self, topic: str, body: bytes) -> None:
            _, header, arrays = decode(b"\0\0\0\0" + body)
            sent.append((topic, header, arrays))

    session.bridge.hub.join(Notebook("viewer-9", never))
    for _ in range(60):
        drive_for(session, 0.1, 0.3, 0.3)
        session.bridge.publish()
    status = session.bridge.status()
    assert status.map.vertices >= 2
    assert status.map.vertices == len(session.bridge.look().path)
    paths = [len(arrays["path"]) for topic, _, arrays in sent if topic == "path"]
    assert paths == sorted(paths)
    assert len(paths) <= status.map.vertices + 1, "only when it changed"
    tiles = [arrays for topic, _, arrays in sent if topic == "tile/0"]
    assert [len(tile["counts"]) for tile in tiles] == list(range(1, status.map.vertices + 1))
    assert tiles[-1]["counts"].sum() == len(tiles[-1]["lengths"]) > 0
    assert tiles[-1]["lengths"].sum() == len(tiles[-1]["points"])
    assert {"pose", "histogram", "local", "path", "tile/0", "status"} <= {topic for topic, _, _ in sent}
    assert set(status.robot.layers) >= {"pose", "histogram", "local", "path", "tile"}


def test_status_tells_why_a_line_is_dead():
    session = HandSession()
    assert session.bridge.status().link.error == ""
    session.link.is_connected, session.link.error, session.link.reconnects = False, "no such device", 3
    link = session.bridge.status().link
    assert not link.connected
    assert link.error == "virtual:room: no such device"
    assert link.reconnects == 3


def test_status_tells_link_battery_and_filter():
    session = HandSession()
    session.advance(2.5)
    status = session.bridge.status()
    assert status.link.connected
    assert status.link.lost_percent == 0.0
    assert status.link.silence_s is not None
    assert status.link.silence_s < 0.1
    assert status.robot.state == "armed" or status.robot.state == "link lost"
    assert status.robot.battery_volts is not None
    assert 20.0 < status.robot.battery_volts < 36.0
    assert set(status.robot.boards) == {"drive", "sensor"}
    assert status.filter.particles == 100
    assert status.robot.tilt_rad is not None
    assert abs(status.robot.tilt_rad) < 0.2


def test_shared_driving_halts_before_the_wall_and_spares_the_radio():
    session = HandSession(width=5.0, height=3.0)
    session.advance(1.0)
    written = []
    session.link.write = lambda data: written.append(data) or session.virtual.write(data) or True
    for _ in range(150):  # 12 s
        word = DriveWord(type="drive", speed=0.3, turn=0.0, seen=session.bridge.t, shared=True)
        session.bridge.hear("anna", word)
        session.advance(0.08)
    assert session.virtual.pose[0] > 1.0, "it went towards the wall at 2.5 m"
    assert session.virtual.world.clearances(session.virtual.pose[None, :2], 1.0)[0] > 0.2
    assert len(written) / 12.0 < 14.0, "commands a second: words, and sweeps only between them"
    assert session.bridge.status().driver.shared
    session.advance(1.0)
    assert not session.bridge.status().driver.shared
    assert session.bridge.status().stops[0].reason == "the driver fell silent"


def test_viewers_hear_at_once_who_asks_and_who_drives():
    session = HandSession()
    drive(session, 0.3)
    shown = []
    session.bridge.publish_status = lambda: shown.append(session.bridge.status().driver)
    session.bridge.hear("ben", PlainWord(type="ask"))
    assert (shown[-1].viewer, shown[-1].asked_by, shown[-1].answer_s) == ("anna", "ben", 10.0)
    with pytest.raises(Refused, match="ask for control"):
        drive_for(session, 11.0, 0.1)  # drives on without an answer
    assert session.bridge.t > 10.0
    assert (shown[-1].viewer, shown[-1].asked_by, shown[-1].answer_s) == ("ben", None, None)
