"""A player shows the newest frame of each topic at its time: back and forth, paused at once, and never ahead of it."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from pydantic import ValidationError

from server.player import FASTEST, PERIOD, REPLAY_WORDS, Player
from server.replay_cache import CacheWriter, Progress
from server.stream import Viewer, decode, encode

DURATION = 10.0


class Finished:
    """A renderer whose work is done, or not."""

    def __init__(self):
        self.tended = 0

    async def open(self, recording: Path) -> Path:
        """Where it is."""
        return recording

    def leave(self, cache: Path) -> None:
        """Nobody else is here."""

    def tend(self) -> None:
        """Count."""
        self.tended += 1

    def state(self, cache: Path, progress: Progress) -> str:
        """As the progress has it."""
        return "ready" if progress.complete else "rendering"


def cache_of(path: Path, until: float = DURATION) -> CacheWriter:
    """A pose ten times a second, a map twice: at 2 s and, with a tile more, at 6 s."""
    writer = CacheWriter(path)
    extend(writer, 0.0, until)
    return writer


def extend(writer: CacheWriter, after: float, until: float) -> None:
    """Render on."""
    for tenth in range(round(10 * after) + 1, round(10 * until) + 1):
        writer.add(tenth / 10, "pose", encode("pose", {"t": tenth / 10}))
        if tenth in (20, 60):
            writer.add(tenth / 10, "path", encode("path", {"n": tenth}))
            writer.add(tenth / 10, f"tile/{tenth // 60}", encode(f"tile/{tenth // 60}", {"n": tenth}))
    writer.commit(Progress(until, DURATION, complete=until >= DURATION, note="" if until >= DURATION else "half"))


class Screen(Viewer):
    """A page that shows everything at once."""

    def __init__(self):
        super().__init__("replay-1", self.never)
        self.seen: dict[str, dict] = {}
        self.log: list[tuple[str, dict]] = []

    async def never(self, data: bytes) -> None:
        raise AssertionError("nothing is sent by hand")

    def put(self, topic: str, body: bytes) -> None:
        """Show it, and forget all when told to."""
        header = decode(b"\0\0\0\0" + body)[1]
        self.log.append((topic, header))
        if topic == "notice" and header["kind"] == "begin":
            self.seen.clear()
        elif topic != "notice":
            self.seen[topic] = header


def at(screen: Screen) -> tuple:
    """What the screen shows: pose's time, and the map's version."""
    return screen.seen.get("pose", {}).get("t"), screen.seen.get("path", {}).get("n")


def play(path: Path, story: Callable[[Player, Screen], Awaitable[None]]) -> None:
    """Let a story happen to a player that stands at the beginning."""

    async def run() -> None:
        screen, renderer = Screen(), Finished()
        player = Player("drive", path, renderer, screen)
        player.is_playing = False
        running = asyncio.create_task(player.run())
        try:
            await story(player, screen)
            assert renderer.tended > 0
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    asyncio.run(asyncio.wait_for(run(), 60.0))


def say(player: Player, **word) -> None:
    player.hear(REPLAY_WORDS.validate_python(word))


async def until(holds: Callable[[], bool]) -> None:
    while not holds():
        await asyncio.sleep(0.005)


def test_scrubbing_back_and_forth_shows_what_it_showed(tmp_path):
    cache_of(tmp_path / "c").close()

    async def story(player: Player, screen: Screen) -> None:
        shown: dict[float, tuple] = {}
        for t in (3.0, 7.5, 1.0, 5.0, 9.9, 3.0, 1.0, 7.5, 5.0, 9.9):
            say(player, type="seek", t=t)
            await until(lambda t=t: player.sought is None and screen.seen["replay"]["t"] == t)
            assert at(screen) == shown.setdefault(t, at(screen))
        assert shown == {1.0: (1.0, None), 3.0: (3.0, 20), 5.0: (5.0, 20), 7.5: (7.5, 60), 9.9: (9.9, 60)}

    play(tmp_path / "c", story)


def test_playing_shows_everything_in_order_and_stops_at_the_end(tmp_path):
    cache_of(tmp_path / "c").close()

    async def story(player: Player, screen: Screen) -> None:
        say(player, type="speed", factor=5.0)
        say(player, type="play")
        await until(lambda: screen.seen.get("replay", {}).get("t") == DURATION)
        poses = [header["t"] for topic, header in screen.log if topic == "pose"]
        assert poses == sorted(poses)
        assert len(poses) > 5
        assert at(screen) == (DURATION, 60)
        assert {"tile/0", "tile/1"} <= set(screen.seen)
        await until(lambda: not screen.seen["replay"]["playing"])
        say(player, type="speed", factor=0.1)  # so that no look misses it
        say(player, type="play")
        await until(lambda: 0.0 < screen.seen["replay"]["t"] < DURATION)

    play(tmp_path / "c", story)


def test_pause_bites_at_once(tmp_path):
    cache_of(tmp_path / "c").close()

    async def story(player: Player, screen: Screen) -> None:
        say(player, type="play")
        await until(lambda: (at(screen)[0] or 0.0) > 0.3)
        say(player, type="pause")
        before = player.t
        assert player.clock() == {"t": round(before, 4), "speed": 0.0}
        await until(lambda: not screen.seen["replay"]["playing"])
        shown = at(screen)
        await asyncio.sleep(5 * PERIOD)
        assert player.t == before
        assert at(screen) == shown

    play(tmp_path / "c", story)


def test_a_seek_takes_back_nothing_that_is_only_said_once(tmp_path):
    """On a full line the word about the replay waits, and a seek clears what waits."""
    cache_of(tmp_path / "c").close()

    async def story() -> None:
        viewer = Viewer("replay-1", Screen().never)
        player = Player("drive", tmp_path / "c", Finished(), viewer)
        player.is_playing = False
        say(player, type="seek", t=3.0)
        player.progress = player.reader.progress()
        player.tell()
        assert decode(b"\0\0\0\0" + viewer.waiting["replay"])[1]["t"] == 3.0
        await player.step(0.0)
        player.tell()
        assert decode(b"\0\0\0\0" + viewer.waiting["replay"])[1]["t"] == 3.0
        assert "pose" in viewer.waiting
        player.reader.close()

    asyncio.run(story())


def test_a_time_that_is_not_rendered_yet_is_shown_as_soon_as_it_is(tmp_path):
    writer = cache_of(tmp_path / "c", 4.0)

    async def story(player: Player, screen: Screen) -> None:
        say(player, type="seek", t=8.0)
        await until(lambda: screen.seen.get("replay", {}).get("t") == 8.0)
        assert screen.seen["replay"] | {"topic": "", "arrays": []} == {
            "topic": "", "arrays": [], "name": "drive", "t": 8.0, "duration": DURATION, "rendered": 4.0,
            "playing": False, "speed": 1.0, "state": "rendering", "note": "half",
        }  # fmt: skip
        assert at(screen) == (None, None)
        extend(writer, 4.0, DURATION)
        await until(lambda: at(screen) == (8.0, 60))
        assert screen.seen["replay"]["state"] == "ready"

    play(tmp_path / "c", story)
    writer.close()


def test_playing_waits_for_the_rendering(tmp_path):
    writer = cache_of(tmp_path / "c", 1.0)

    async def story(player: Player, screen: Screen) -> None:
        say(player, type="speed", factor=FASTEST)
        say(player, type="play")
        await until(lambda: at(screen)[0] == 1.0)
        assert player.is_playing
        extend(writer, 1.0, 3.0)
        await until(lambda: at(screen)[0] == 3.0)
        assert player.t == 3.0

    play(tmp_path / "c", story)
    writer.close()


@pytest.mark.parametrize(
    "word",
    [
        {"type": "seek", "t": -1.0}, {"type": "seek", "t": float("nan")}, {"type": "seek"},
        {"type": "speed", "factor": 0.0}, {"type": "speed", "factor": 1e9},
        {"type": "drive", "speed": 1.0, "turn": 0.0, "seen": 0.0}, {"type": "stop"},
    ],
)  # fmt: skip
def test_a_replay_understands_nothing_that_could_drive(word):
    with pytest.raises(ValidationError):
        REPLAY_WORDS.validate_python(word)
