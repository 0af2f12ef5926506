"""Who renders recordings for viewers: one process at a time, and only while somebody watches.

A recording is rendered once and kept; what was watched longest ago is deleted when all of it takes too much room. Who
leaves may come back at once, as when a page is loaded anew: only after a while its rendering is given up.
Plain calls from the loop: `open` and `leave` as viewers come and go, `tend` as often as they look. Uses its siblings
`render` (the process's own side) and nothing of the session that runs.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import os
from collections import Counter
from multiprocessing.process import BaseProcess
from pathlib import Path

from server import render
from server.errors import UserError
from server.recording import Reader
from server.replay_cache import FOLDER, CacheReader, Progress, cache_path, prune, remove

log = logging.getLogger(__name__)

ROOM = 2 << 30  # bytes of all caches together
GRACE = 5.0  # s after the last viewer left


class RenderQueue:
    """The caches of the recordings in one folder."""

    def __init__(self, folder: Path, room: int = ROOM, grace: float = GRACE):
        self.folder = folder / FOLDER
        self.room = room
        self.grace = grace
        self.watched: Counter[Path] = Counter()  # cache -> viewers
        self.waiting: list[tuple[Path, Path]] = []  # recording and cache, the first comes next
        self.process: BaseProcess | None = None
        self.at: Path | None = None  # the cache that the process writes
        self.failed: set[Path] = set()  # caches whose process ended without a word

    async def open(self, recording: Path) -> Path:
        """The cache of a recording, rendered from now on if it is not yet; `leave` it afterwards. UserError if not."""
        cache, is_complete = await asyncio.to_thread(self._find, recording)
        self.watched[cache] += 1
        self.failed.discard(cache)
        is_on_its_way = cache == self.at or cache in [one for _, one in self.waiting]
        if not is_complete and not is_on_its_way:
            self.waiting.append((recording, cache))
        self.tend()
        return cache

    def leave(self, cache: Path) -> None:
        """A viewer has gone; what nobody waits for any more is not rendered."""
        self.watched[cache] -= 1
        asyncio.get_running_loop().call_later(self.grace, self._give_up, cache)

    def tend(self) -> None:
        """Look after the process: one that has ended, or that nobody watches while others wait, makes room."""
        is_unwatched = self.at is not None and not self.watched[self.at]
        if self.process is not None and (not self.process.is_alive() or (is_unwatched and self.waiting)):
            self._end()
        if self.process is None and self.waiting:
            recording, self.at = self.waiting.pop(0)
            context = multiprocessing.get_context("spawn")
            arguments = (recording, self.at, os.getpid())
            self.process = context.Process(target=render.run, args=arguments, name="render", daemon=True)
            self.process.start()

    def state(self, cache: Path, progress: Progress) -> str:
        """How a cache is: waiting, rendering, ready or failed."""
        if progress.error or cache in self.failed:
            return "failed"
        if progress.complete:
            return "ready"
        return "rendering" if cache == self.at else "waiting"

    def _give_up(self, cache: Path) -> None:
        """Render no more for nobody."""
        if self.watched[cache] > 0:
            return
        del self.watched[cache]
        self.waiting = [one for one in self.waiting if one[1] != cache]
        if cache == self.at:
            self._end()
        self.tend()

    def close(self) -> None:
        """End the process; the server leaves."""
        self.waiting.clear()
        self._end()

    def _find(self, recording: Path) -> tuple[Path, bool]:
        """The cache of a recording as it is now, and whether it is complete; makes room for it."""
        cache = cache_path(recording, render.configuration(Reader(recording).header).model_dump(mode="json"))
        try:
            self.folder.mkdir(exist_ok=True)
            prune(self.folder, self.room, [*self.watched, *([self.at] if self.at else []), cache])
            if not cache.exists():
                return cache, False
            os.utime(cache)  # it is watched again
        except OSError as error:
            raise UserError(
                f"{self.folder}: cannot be used ({error.strerror}); make room or make it writable"
            ) from None
        reader = CacheReader(cache)
        try:
            return cache, reader.progress().complete
        finally:
            reader.close()

    def _end(self) -> None:
        """Reap the process, or kill it; a cache that is not complete goes, one that tells of a mistake is kept."""
        if self.process is None or self.at is None:
            return
        was_alive = self.process.is_alive()
        self.process.kill()
        self.process.join()
        reader = CacheReader(self.at)
        progress = reader.progress()
        reader.close()
        if not progress.complete and not progress.error:
            remove(self.at)
            if not was_alive:
                log.warning("rendering %s ended with code %s", self.at.name, self.process.exitcode)
                self.failed.add(self.at)
        self.process = self.at = None
