"""What tests of links need: somebody who listens, and a link that runs meanwhile."""

import asyncio
import contextlib


class Ear:
    """Collects what a link receives."""

    def __init__(self):
        self.data = b""
        self.times = []

    def __call__(self, data, t):
        self.data += data
        self.times.append(t)


async def until(claim):
    """Waits for a claim to become true."""
    async with asyncio.timeout(60.0):
        while not claim():
            await asyncio.sleep(0.002)


@contextlib.asynccontextmanager
async def running(link, ear=None):
    """Runs a link for the length of a block."""
    task = asyncio.create_task(link.run(ear or Ear()))
    try:
        yield task
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
