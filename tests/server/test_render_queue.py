"""One rendering at a time, only while somebody watches; what is rendered is kept."""

import asyncio
import multiprocessing
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from server.errors import UserError
from server.render_queue import RenderQueue
from server.replay_cache import CacheReader, Progress
from tests.server.rendered import drive


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two recordings of some seconds, and one of minutes."""
    drive(tmp_path / "short.rlog", 6.0)
    shutil.copy(tmp_path / "short.rlog", tmp_path / "other.rlog")
    drive(tmp_path / "long.rlog", 400.0)
    return tmp_path


def progress(cache: Path) -> Progress:
    reader = CacheReader(cache)
    try:
        return reader.progress()
    finally:
        reader.close()


async def tended(queue: RenderQueue, holds: Callable[[], bool]) -> None:
    """Until it is true, with viewers that look."""
    async with asyncio.timeout(120.0):
        while not holds():
            queue.tend()
            assert len(multiprocessing.active_children()) <= 1, "one at a time"
            await asyncio.sleep(0.02)


def test_two_recordings_are_rendered_one_after_the_other_and_kept(folder):
    async def story():
        queue = RenderQueue(folder)
        caches = [await queue.open(folder / name) for name in ("short.rlog", "other.rlog")]
        states = [queue.state(cache, progress(cache)) for cache in caches]
        assert states == ["rendering", "waiting"]
        await tended(queue, lambda: all(progress(cache).complete for cache in caches))
        await tended(queue, lambda: queue.process is None)
        before = [cache.stat().st_ino for cache in caches]
        again = await queue.open(folder / "short.rlog")
        assert again == caches[0]
        assert queue.process is None, "it is not rendered twice"
        assert [cache.stat().st_ino for cache in caches] == before
        queue.close()

    asyncio.run(story())


def test_nobody_watches_and_the_process_ends(folder):
    async def story():
        queue = RenderQueue(folder, grace=0.1)
        cache = await queue.open(folder / "long.rlog")
        other = await queue.open(folder / "long.rlog")
        assert cache == other
        await tended(queue, lambda: progress(cache).rendered > 0.0)
        queue.leave(cache)
        await asyncio.sleep(0.3)
        assert queue.process is not None, "the other one still watches"
        process = queue.process
        queue.leave(cache)
        queue.leave(await queue.open(folder / "long.rlog"))  # a page that is loaded anew
        await tended(queue, lambda: queue.process is None)
        assert not process.is_alive()
        assert not cache.exists()
        assert queue.watched == {}

    asyncio.run(story())


def test_who_waits_comes_before_what_nobody_watches(folder):
    async def story():
        queue = RenderQueue(folder, grace=60.0)
        queue.leave(await queue.open(folder / "long.rlog"))
        cache = await queue.open(folder / "short.rlog")
        assert queue.state(cache, progress(cache)) == "rendering"
        queue.close()

    asyncio.run(story())


def test_who_waits_in_vain_is_forgotten(folder):
    async def story():
        queue = RenderQueue(folder, grace=0.0)
        await queue.open(folder / "long.rlog")
        waiting = await queue.open(folder / "short.rlog")
        queue.leave(waiting)
        await asyncio.sleep(0.05)
        assert queue.waiting == []
        queue.close()
        assert multiprocessing.active_children() == []

    asyncio.run(story())


def test_a_process_that_is_killed_is_told_and_can_be_tried_again(folder):
    async def story():
        queue = RenderQueue(folder)
        cache = await queue.open(folder / "long.rlog")
        assert queue.process is not None
        assert queue.process.pid is not None
        os.kill(queue.process.pid, signal.SIGKILL)
        await tended(queue, lambda: queue.state(cache, progress(cache)) == "failed")
        assert not cache.exists()
        await queue.open(folder / "long.rlog")
        assert queue.state(cache, progress(cache)) == "rendering"
        queue.close()

    asyncio.run(story())


def test_what_cannot_be_read_is_told_before_anything_starts(folder):
    (folder / "foreign.rlog").write_text("a diary")

    async def story():
        queue = RenderQueue(folder)
        with pytest.raises(UserError, match="not the beginning"):
            await queue.open(folder / "foreign.rlog")
        assert queue.watched == {}
        assert queue.process is None

    asyncio.run(story())
