"""Sessions follow one another on the same links: each begins with nothing, and what it found is kept when it ends."""

import asyncio
import json
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from server.config import ConfigError, load
from server.control import Refused
from server.estimator import EstimatorStatus
from server.map_store import StoreError
from server.messages import Snapshot
from server.recorded import open_log
from server.recording import Kind, Reader, Recorder
from server.replay import run_log
from server.rest.sessions import NotRunning
from server.robots.crunch import Crunch, CrunchParams
from server.robots.kinds import ROBOTS
from server.sessions import Sessions
from server.views import SessionStatus
from server.words import PlainWord
from tests.server.live_session import HandSession
from tests.server.test_bridge import drive, drive_for

PARTICLES = 60


class Kept:
    """Where maps go: remembers what it was given."""

    def __init__(self):
        self.maps: list[tuple[Snapshot, SessionStatus]] = []

    def __call__(self, snapshot: Snapshot, about: SessionStatus) -> str:
        self.maps.append((snapshot, about))
        return str(len(self.maps))


Story = Callable[[HandSession, Sessions, Kept], Awaitable[None]]


def live(folder: Path, story: Story, name: str = "One") -> None:
    """Let a story happen to a session whose time passes by hand and whose filter is a real worker."""

    async def run() -> None:
        hand, kept = HandSession(), Kept()
        settings = load({"crunch": {"filter": {"particles": PARTICLES}}})
        sessions = Sessions(hand.bridge, settings, 3, 1, folder)
        sessions.keep_map = kept
        sessions.open(name)
        running = asyncio.create_task(sessions.run())
        try:
            await ready(hand)
            await story(hand, sessions, kept)
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
            sessions.close()

    asyncio.run(asyncio.wait_for(run(), 300.0))


async def ready(hand: HandSession) -> None:
    """Until the worker has started; a busy machine compiles for long."""
    while status_of(hand).state != "idle":
        await asyncio.sleep(0.02)


def status_of(hand: HandSession) -> EstimatorStatus:
    assert hand.bridge.estimator is not None
    return hand.bridge.estimator.status()


def marks_of(path: Path) -> list[dict]:
    return [json.loads(record.data) for record in Reader(path) if record.kind == Kind.MARK]


def test_what_a_session_found_is_kept_when_it_ends(tmp_path):
    async def story(hand: HandSession, sessions: Sessions, kept: Kept) -> None:
        drive_for(hand, 12.0, 0.3, 0.2)
        ended = await sessions.end()
        assert (ended.running, ended.name, ended.map) == (False, "One", "1")
        assert hand.bridge.status().stops[0].reason == "the session ended"
        ((snapshot, about),) = kept.maps
        assert about.recording == ended.recording
        assert len(snapshot.path) == ended.vertices > 4
        reader = Reader(tmp_path / f"{ended.recording}.rlog")
        records = list(reader)
        assert reader.truncated_at is None
        assert reader.header.seed == 3
        assert marks_of(reader.path)[0] == {"name": "One"}
        assert [record for record in records if record.kind == Kind.TX], "the robot was told to stop"
        settings = load(header=reader.header.configuration)
        again = run_log(open_log(reader.path), settings.crunch, reader.header.seed)
        assert len(again.path) == len(snapshot.path), "no vertex that still waited was lost"
        assert again.path == pytest.approx(snapshot.path), "a replay makes the same map"

    live(tmp_path, story)


def test_between_sessions_nobody_drives_and_nothing_is_recorded_or_mapped(tmp_path):
    async def story(hand: HandSession, sessions: Sessions, kept: Kept) -> None:
        drive_for(hand, 6.0, 0.3)
        ended = await sessions.end()
        path = tmp_path / f"{ended.recording}.rlog"
        size, vertices = path.stat().st_size, status_of(hand).vertices
        with pytest.raises(Refused, match="begin one"):
            drive(hand, 0.3)
        hand.bridge.hear("anna", PlainWord(type="stop"))
        hand.advance(3.0)
        status = hand.bridge.status()
        assert status.link.silence_s is not None
        assert status.link.silence_s < 0.1, "the robot is still heard"
        assert (status.session.running, status.recording, status.filter.state) == (False, None, "ended")
        assert (path.stat().st_size, status_of(hand).vertices) == (size, vertices)
        assert len(hand.bridge.look().path) == ended.vertices, "its map can still be looked at"
        with pytest.raises(NotRunning):
            await sessions.end()
        assert len(kept.maps) == 1

    live(tmp_path, story)


def test_a_new_session_begins_with_nothing(tmp_path):
    async def story(hand: HandSession, sessions: Sessions, kept: Kept) -> None:
        drive_for(hand, 6.0, 0.3)
        hand.bridge.hear("anna", PlainWord(type="stop"))
        second = await sessions.begin("Two", {"crunch.filter.particles": 77})
        assert len(kept.maps) == 1, "the first was ended by the second"
        assert (second.number, second.name, second.running, second.vertices) == (2, "Two", True, 0)
        status = hand.bridge.status()
        assert status.t < 1.0
        assert status.robot.distance_m == 0.0
        assert (status.driver.viewer, status.driver.stopped_by) == (None, "anna"), "a stop holds until it is ended"
        assert (status.filter.wanted_particles, status.stops) == (77, [])
        assert hand.bridge.configuration()["crunch"]["filter"]["particles"] == 77
        await ready(hand)
        with pytest.raises(Refused, match="Resume"):
            drive(hand, -0.3)
        hand.bridge.hear("anna", PlainWord(type="resume"))
        drive_for(hand, 6.0, -0.3)
        third = await sessions.begin()
        assert [one.number for one in sessions.summaries()] == [3, 2, 1]
        assert [one.map for one in sessions.summaries()] == [None, "2", "1"]
        assert hand.bridge.status().filter.wanted_particles == PARTICLES, "settings are one session's own"
        assert len({one.recording for one in sessions.summaries()}) == 3
        assert third.name == ""
        header = Reader(tmp_path / f"{second.recording}.rlog").header
        assert header.configuration["crunch"]["filter"]["particles"] == 77

    live(tmp_path, story)


def test_settings_that_cannot_be_used_leave_the_session_alone(tmp_path):
    async def story(hand: HandSession, sessions: Sessions, kept: Kept) -> None:
        for settings, told in (
            ({"crunch.filer.particles": 10}, "did you mean `crunch.filter`"),
            ({"crunch.filter.particles": -1}, "particles = -1 cannot be used"),
            ({"crunch.filter.particles": 10**9}, "less than or equal to 2000000"),
            ({"crunch.local_map.cells_per_reach": 10**6}, "less than or equal to 500"),
            ({"web.port": 80}, "stays while the server runs"),
            ({"crunch.sensors.sonar.bearings_deg": [0.0]}, "give 8"),
        ):
            with pytest.raises(ConfigError, match=told):
                await sessions.begin("Two", settings)
            assert sessions.bridge.about.running
            assert sessions.bridge.about.number == 1
        drive(hand, 0.2)

    live(tmp_path, story)


def test_a_large_robot_is_built_while_the_session_goes_on(tmp_path, monkeypatch):
    async def story(hand: HandSession, sessions: Sessions, kept: Kept) -> None:
        beginning = asyncio.create_task(sessions.begin("Two"))
        async with asyncio.timeout(60.0):
            while not is_building.is_set():
                await asyncio.sleep(0.01)
        assert (sessions.bridge.about.number, sessions.bridge.about.running) == (1, True)
        may_go_on.set()
        assert (await beginning).number == 2

    class SlowCrunch(Crunch):
        def __init__(self, params: CrunchParams):
            is_building.set()
            assert may_go_on.wait(90.0), "the loop stands still while the robot is built"
            super().__init__(params)

    is_building, may_go_on = threading.Event(), threading.Event()
    may_go_on.set()
    monkeypatch.setitem(ROBOTS, "crunch", ROBOTS["crunch"]._replace(fold=SlowCrunch))

    async def begun(hand: HandSession, sessions: Sessions, kept: Kept) -> None:
        is_building.clear()
        may_go_on.clear()
        await story(hand, sessions, kept)

    live(tmp_path, begun)


def test_a_name_can_be_given_later_and_stands_in_the_recording(tmp_path):
    async def story(hand: HandSession, sessions: Sessions, kept: Kept) -> None:
        sessions.rename("Cellar")
        assert hand.bridge.status().session.name == "Cellar"
        ended = await sessions.end()
        assert marks_of(tmp_path / f"{ended.recording}.rlog")[0] == {"name": "Cellar"}
        assert sessions.rename("Roof").name == "Roof"
        assert sessions.summaries()[0].name == "Roof"

    live(tmp_path, story, name="")


def test_a_robot_that_only_stood_leaves_no_map(tmp_path):
    async def story(hand: HandSession, sessions: Sessions, kept: Kept) -> None:
        hand.advance(2.0)
        assert (await sessions.end()).map is None
        assert kept.maps == []

    live(tmp_path, story)


def test_an_ending_that_is_cut_short_is_finished_when_the_server_leaves(tmp_path):
    async def story(hand: HandSession, sessions: Sessions, kept: Kept) -> None:
        drive_for(hand, 12.0, 0.3, 0.2)
        while status_of(hand).waiting:
            await asyncio.sleep(0.02)
        assert hand.bridge.recorder is not None
        opened.append((hand.bridge.recorder, sessions, kept))
        ending = asyncio.create_task(sessions.end())
        while hand.bridge.about.running:
            await asyncio.sleep(0)
        ending.cancel()  # as the web server does with a request that outlasts its goodbye
        await asyncio.wait([ending])
        assert kept.maps == [], "it was cut short"

    opened: list[tuple[Recorder, Sessions, Kept]] = []
    live(tmp_path, story)
    ((recorder, sessions, kept),) = opened
    assert recorder.descriptor < 0, "closed"
    assert Reader(recorder.path).truncated_at is None
    assert len(kept.maps) == 1
    sessions.close()
    assert len(kept.maps) == 1, "once"


def test_a_map_that_cannot_be_kept_says_why(tmp_path):
    async def story(hand: HandSession, sessions: Sessions, kept: Kept) -> None:
        def full(snapshot: Snapshot, about: SessionStatus) -> str:
            raise StoreError("crunch.db: cannot be used (disk is full); make room")

        sessions.keep_map = full
        drive_for(hand, 12.0, 0.3, 0.2)
        ended = await sessions.end()
        assert (ended.map, ended.map_error) == (None, "crunch.db: cannot be used (disk is full); make room")
        assert sessions.summaries()[0] == ended
        await sessions.begin()
        assert sessions.summaries()[1] == ended, "whoever began the next one can still be told"

    live(tmp_path, story)


def test_two_who_begin_at_once_get_a_session_each(tmp_path):
    async def story(hand: HandSession, sessions: Sessions, kept: Kept) -> None:
        first, second = await asyncio.gather(sessions.begin("a"), sessions.begin("b"))
        assert {first.number, second.number} == {2, 3}
        assert [one.running for one in sessions.summaries()] == [True, False, False]

    live(tmp_path, story)
