"""A rendered recording played to one viewer: play, pause, speed, and any time at once.

The viewer gets the newest frame of each topic at the time shown, through the same slots as a live one, and besides a
topic `replay` that tells time, speed and how far the recording is rendered. Whoever renders it is a `Renderer`. Uses
its siblings `replay_cache` and `stream`.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

from pydantic import Field, TypeAdapter

from server.replay_cache import CacheReader, Progress
from server.stream import Viewer, encode, kind_of
from server.words import AckWord, PingWord, Word

PERIOD = 0.05  # s between two looks into the cache
FASTEST = 100.0  # times as fast as it was; about as fast as recordings are rendered


class PlayWord(Word):
    """play: go on, from the beginning if it is at the end; pause: stand still."""

    type: Literal["play", "pause"]


class SeekWord(Word):
    """Show time t (s since the session's start) now."""

    type: Literal["seek"]
    t: float = Field(ge=0.0)


class SpeedWord(Word):
    """Play `factor` times as fast as it was driven."""

    type: Literal["speed"]
    factor: float = Field(ge=0.1, le=FASTEST)


ReplayWord = PlayWord | SeekWord | SpeedWord
REPLAY_WORDS: TypeAdapter[Any] = TypeAdapter(
    Annotated[ReplayWord | AckWord | PingWord, Field(discriminator="type")],
)


class Renderer(Protocol):
    """Who renders recordings."""

    async def open(self, recording: Path) -> Path:
        """The cache of a recording, rendered from now on if it is not yet; UserError if it cannot be."""
        ...

    def leave(self, cache: Path) -> None:
        """A viewer has gone."""
        ...

    def tend(self) -> None:
        """Look after the process; to be called often."""
        ...

    def state(self, cache: Path, progress: Progress) -> str:
        """waiting, rendering, ready or failed."""
        ...


class Player:
    """What one viewer sees of a recording. Words come in by `hear`; `run` sends until cancelled."""

    def __init__(self, name: str, cache: Path, renderer: Renderer, viewer: Viewer):
        self.name = name
        self.cache = cache
        self.renderer = renderer
        self.viewer = viewer
        self.reader = CacheReader(cache)
        self.progress = Progress()
        self.t = 0.0
        self.speed = 1.0
        self.is_playing = True
        self.sought: float | None = 0.0  # a time to be shown as soon as it is rendered
        self.shown: set[str] = set()  # topics that the viewer has
        self.told: bytes = b""
        self.changed = asyncio.Event()

    def clock(self) -> dict[str, float]:
        """The time that the viewer sees, and how fast it goes."""
        return {"t": round(self.t, 4), "speed": self.speed if self.is_playing else 0.0}

    def hear(self, word: ReplayWord) -> None:
        """Obey the viewer."""
        match word:
            case PlayWord(type="play"):
                self.is_playing = True
                if self.progress.complete and self.t >= self.progress.duration:
                    self.sought = 0.0
            case PlayWord():
                self.is_playing = False
            case SeekWord():
                self.sought = word.t
            case SpeedWord():
                self.speed = word.factor
        self.changed.set()

    async def run(self) -> None:
        """Show what is due, twenty times a second and at every word."""
        loop = asyncio.get_running_loop()
        before = loop.time()
        try:
            while True:
                self.renderer.tend()
                self.changed.clear()
                now = loop.time()
                await self.step(now - before)
                before = now
                self.tell()
                try:
                    async with asyncio.timeout(PERIOD):
                        await self.changed.wait()
                except TimeoutError:
                    pass
        finally:
            await asyncio.to_thread(self.reader.close)

    async def step(self, passed: float) -> None:
        """Take up the progress, then show what a seek or the passing of time (s) asks for."""
        if not self.progress.complete:
            self.progress = await asyncio.to_thread(self.reader.progress)
        until = self.progress.rendered
        if self.sought is not None:
            goal = min(self.sought, self.progress.duration)
            if self.progress.duration > 0.0 and goal <= until:
                await self.jump(goal)
        elif self.is_playing and self.t < until:
            await self.go_on(min(until, self.t + passed * self.speed))
        if self.progress.complete and self.t >= until and self.sought is None:
            self.is_playing = False

    async def jump(self, t: float) -> None:
        """Show a time, whatever was shown before; unless another is asked for meanwhile."""
        asked = self.sought
        frames = await asyncio.to_thread(self.reader.at, t)
        if self.sought != asked:
            return
        self.sought, self.t = None, t
        self.viewer.waiting.clear()
        self.told = b""  # it may have waited too
        topics = {kind_of(topic) for topic, _ in frames}
        if self.shown - topics:  # nothing replaces what there was not yet
            self.viewer.put("notice", encode("notice", {"kind": "begin"}))
        self.shown = topics
        for topic, body in frames:
            self.viewer.put(topic, body)

    async def go_on(self, t: float) -> None:
        """Show what came up to a later time; unless there was a word meanwhile, which comes first."""
        frames = await asyncio.to_thread(self.reader.between, self.t, t)
        if self.sought is not None or not self.is_playing:
            return
        self.t = t
        for topic, body in frames:
            self.shown.add(kind_of(topic))
            self.viewer.put(topic, body)

    def tell(self) -> None:
        """The topic `replay`, if it has changed."""
        progress = self.progress
        fields = {
            "name": self.name,
            "t": round(self.t if self.sought is None else min(self.sought, progress.duration or self.sought), 3),
            "duration": round(progress.duration, 3),
            "rendered": round(progress.rendered, 3),
            "playing": self.is_playing,
            "speed": self.speed,
            "state": self.renderer.state(self.cache, progress),
            "note": progress.error or progress.note,
        }
        body = encode("replay", fields)
        if body != self.told:
            self.told = body
            self.viewer.put("replay", body)
