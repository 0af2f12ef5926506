"""The path filter beside the event loop: a worker process that may be slow, hang or die, and nothing mapped is lost.

One batch is under way at a time; keyframes that arrive meanwhile wait and go over together. None is ever dropped: when
too many wait, the filter goes on with fewer particles and takes them back when it has caught up. A process that died
or stopped beating is replaced and fed the session's keyframes again. `InlineEstimator` has the same face without a
process, for replay. Uses `filter_worker` (the process's own side).
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import multiprocessing
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from pydantic import Field

from server.filter_worker import REFINED, Answer, Batch, FilterFactory, estimate_of, serve
from server.messages import Estimate, Keyframe
from slam.params import Params

log = logging.getLogger(__name__)

Deliver = Callable[[Estimate], None]


class EstimatorParams(Params):
    """How the worker is fed and watched."""

    batch: int = Field(default=32, ge=1, le=10_000)  # keyframes that go over together at most
    bound: int = Field(default=16, ge=1, le=10_000)  # waiting keyframes above which particles are shed
    fewest: int = Field(default=100, ge=1)  # particles that are never shed
    calm: float = Field(default=2.0, gt=0.0)  # s without a keyframe after which the path is refined at leisure
    calm_batches: int = Field(default=4, ge=1)  # batches without a queue before shed particles come back
    shown: int = Field(default=500, ge=1, le=100_000)  # particles in an estimate
    startup: float = Field(default=120.0, gt=0.0)  # s for the first beat and the first answer, while kernels compile
    patience: float = Field(default=10.0, gt=0.0)  # s without a beat that count as hung; doubles while it helps nothing
    attempts: int = Field(default=5, ge=1)  # losses without any progress after which the filter is given up


@dataclass(frozen=True, slots=True)
class EstimatorStatus:
    """How the estimator is doing: a state, counts of keyframes and particles, and the share of time it is busy."""

    state: str  # starting, idle, busy, restarting, failed, ended
    vertices: int  # keyframes handed over this session
    waiting: int  # of them not yet answered
    n_particles: int
    wanted_particles: int
    restarts: int
    load: float
    batch_seconds: float
    reason: str
    process_id: int | None


class Estimator(Protocol):
    """What live and replay share: keyframes go in, estimates come out through the `deliver` of the constructor."""

    def submit(self, keyframe: Keyframe) -> None:
        """Add a keyframe; never blocks on the filter's process."""
        ...

    def finish(self) -> None:
        """No keyframe comes any more: the last word is to be delivered."""
        ...

    def is_settled(self) -> bool:
        """Whether everything is delivered that `finish` asked for."""
        ...

    def status(self) -> EstimatorStatus:
        """How the estimator is doing."""
        ...


class InlineEstimator:
    """Computes within `submit`; the same keyframes give the same estimates, bit for bit."""

    def __init__(self, factory: FilterFactory, deliver: Deliver, shown: int = 500):
        self.path_filter = factory()
        self.deliver = deliver
        self.shown = shown
        self.vertices = 0
        self.t = 0.0  # of the newest keyframe

    def submit(self, keyframe: Keyframe) -> None:
        """Extend the filter and deliver its estimate before returning."""
        self.path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
        self.vertices += 1
        if isinstance(self.path_filter, REFINED) and self.path_filter.is_due:
            self.path_filter.refine(is_quick=True)
        self.t = keyframe.t
        self.deliver(estimate_of(self.path_filter, keyframe.t, self.shown))

    def finish(self) -> None:
        """Deliver the refined path, after the last keyframe."""
        if isinstance(self.path_filter, REFINED) and self.path_filter.is_rough:
            self.path_filter.refine()
            self.deliver(estimate_of(self.path_filter, self.t, self.shown))

    def is_settled(self) -> bool:
        """Always."""
        return True

    def status(self) -> EstimatorStatus:
        """Always idle between two calls."""
        n = self.path_filter.n_particles
        return EstimatorStatus("idle", self.vertices, 0, n, n, 0, 0.0, 0.0, "", None)


class ParticleBudget:
    """How many particles the filter can afford: halved while too much waits, doubled back after some calm."""

    def __init__(self, wanted: int, params: EstimatorParams):
        self.wanted = wanted
        self.fewest = min(params.fewest, wanted)
        self.bound = params.bound
        self.calm_batches = params.calm_batches
        self.n_particles = wanted
        self.calm = 0

    def next(self, waiting: int) -> int:
        """Particles for the next batch, when `waiting` keyframes stand in the queue."""
        self.calm = self.calm + 1 if waiting <= 1 else 0
        if waiting > self.bound:
            self.n_particles = max(self.fewest, self.n_particles // 2)
        elif self.calm >= self.calm_batches and self.n_particles < self.wanted:
            self.n_particles = min(self.wanted, 2 * self.n_particles)
            self.calm = 0
        return self.n_particles


class WorkerLost(Exception):
    """The worker process died or hangs."""


class Worker:
    """One run of the process. Talking to it happens in threads, so that a full or dead pipe cannot hold the loop."""

    def __init__(self, factory: FilterFactory, shown: int):
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.beats: Any = context.Value("Q", 0, lock=False)
        self.process = context.Process(
            target=serve, args=(theirs, self.beats, factory, shown), name="path-filter", daemon=True
        )
        self.process.start()
        self.reaping = threading.Lock()  # of two threads that wait for one child, the loser would think it alive
        theirs.close()

    async def receive(self) -> Any:
        """The next answer; raises WorkerLost when the process is gone."""
        return await asyncio.to_thread(self._talk, None)

    async def exchange(self, batch: Batch) -> Answer:
        """Send a batch and wait for its answer; raises WorkerLost when the process is gone."""
        return await asyncio.to_thread(self._talk, batch)

    def _talk(self, batch: Batch | None) -> Any:
        try:
            if batch is not None:
                self.connection.send(batch)
            return self.connection.recv()
        except (EOFError, OSError) as error:
            raise WorkerLost(self.describe_end()) from error

    def kill(self) -> None:
        """End the process whatever it does; a thread that waits for it wakes up, the pipe closes with its last user."""
        self.process.kill()
        with self.reaping:
            self.process.join()

    def describe_end(self) -> str:
        """How a process that is about to end ends."""
        with self.reaping:
            self.process.join(10.0)  # an interpreter on a busy machine takes its time to leave
            code = self.process.exitcode
        if code is None:
            return "closed its pipe"
        return f"ended by signal {-code}" if code < 0 else f"ended with code {code}"


class WorkerEstimator:
    """Feeds a worker process. `run` belongs into the session's task group; everything else is plain calls."""

    def __init__(
        self, factory: FilterFactory, deliver: Deliver, n_particles: int, params: EstimatorParams | None = None
    ):
        self.factory = factory
        self.deliver = deliver
        self.params = params or EstimatorParams()
        self.budget = ParticleBudget(n_particles, self.params)
        self.keyframes: list[Keyframe] = []
        self.answered = 0  # keyframes that the present worker has computed
        self.fed_again = 0  # keyframes below this waited for a worker to start and shed nothing
        self.progress = 0  # most keyframes that any worker has answered
        self.losses = 0  # since the last progress
        self.restarts = 0
        self.load = 0.0
        self.batch_seconds = 0.0
        self.state = "starting"
        self.reason = ""
        self.worker: Worker | None = None
        self.has_answered = False
        self.is_rough = False  # whether the newest estimate's path can still be refined
        self.is_ending = False
        self.last_answer = time.monotonic()
        self.arrived = asyncio.Event()

    def submit(self, keyframe: Keyframe) -> None:
        """Queue a keyframe; it is kept for the whole session."""
        self.keyframes.append(keyframe)
        self.arrived.set()

    def finish(self) -> None:
        """Have the path refined without waiting for a calm moment."""
        self.is_ending = True
        self.arrived.set()

    def is_settled(self) -> bool:
        """Whether the worker has told all that can be told of the keyframes so far."""
        return self.answered == len(self.keyframes) and not self.is_rough

    def status(self) -> EstimatorStatus:
        """How the worker is doing."""
        n = self.budget.n_particles
        return EstimatorStatus(
            state=self.state,
            vertices=len(self.keyframes),
            waiting=len(self.keyframes) - self.answered,
            n_particles=n,
            wanted_particles=self.budget.wanted,
            restarts=self.restarts,
            load=self.load,
            batch_seconds=self.batch_seconds,
            reason=self.reason,
            process_id=self.worker.process.pid if self.worker else None,
        )

    async def run(self) -> None:
        """Keep a worker alive and fed until cancelled; after too many losses in a row only the state says `failed`."""
        try:
            await self._keep_alive()
        finally:
            self.state, self.worker = "ended", None

    async def _keep_alive(self) -> None:
        while self.losses < self.params.attempts:
            self.worker = await asyncio.to_thread(Worker, self.factory, self.params.shown)
            self.answered, self.has_answered = 0, False
            try:
                async with asyncio.TaskGroup() as group:
                    group.create_task(self._watch(self.worker))
                    group.create_task(self._feed(self.worker))
            except* WorkerLost as lost:
                self._lose(lost.exceptions[0])
            finally:
                self.worker.kill()
            await asyncio.sleep(min(2.0, 0.1 * self.losses))
        self.state = "failed"
        log.error("the path filter was given up after %d losses: %s", self.losses, self.reason)
        await asyncio.Event().wait()

    def _lose(self, error: BaseException) -> None:
        self.losses += 1
        self.restarts += 1
        self.state, self.reason = "restarting", str(error)
        log.warning("path filter lost (%s); started again and fed %d keyframes", error, len(self.keyframes))

    async def _feed(self, worker: Worker) -> None:
        """One batch at a time, for ever."""
        await worker.receive()  # its first word
        self.fed_again = len(self.keyframes)
        self.is_rough = is_due = False
        while True:
            is_calm = False
            if self.answered == len(self.keyframes) and not is_due:
                self.state = "idle"
                is_calm = await self._wait()
                if self.answered == len(self.keyframes) and not is_calm:
                    continue
            self.state = "busy"
            batch = self._next_batch(is_calm)
            answer = await worker.exchange(batch)
            self.is_rough, is_due = answer.is_rough, answer.is_due
            if batch.keyframes:
                self._note(batch, answer)
            if self.answered >= self.progress:  # an estimate of a part of what was known would only confuse
                self.progress, self.losses = self.answered, 0
                self.deliver(answer.estimate)

    async def _wait(self) -> bool:
        """Wait for a keyframe; whether none came, and the path can be refined at leisure."""
        self.arrived.clear()
        if self.is_rough and self.is_ending:
            return True
        try:
            async with asyncio.timeout(self.params.calm if self.is_rough else None):
                await self.arrived.wait()
        except TimeoutError:
            return True
        return self.is_rough and self.is_ending

    def _next_batch(self, is_calm: bool) -> Batch:
        """The keyframes that wait; without any the path is refined."""
        if self.answered == len(self.keyframes):
            return Batch((), self.budget.n_particles, is_quick=not is_calm)
        keyframes = self.keyframes[self.answered : self.answered + self.params.batch]
        is_new = self.answered >= self.fed_again
        n = self.budget.next(len(self.keyframes) - self.answered) if is_new else self.budget.n_particles
        return Batch(keyframes, n, is_quick=True)

    def _note(self, batch: Batch, answer: Answer) -> None:
        now = time.monotonic()
        self.has_answered = True
        self.answered += len(batch.keyframes)
        self.batch_seconds = answer.seconds
        self.load += 0.3 * (min(1.0, answer.seconds / max(1e-6, now - self.last_answer)) - self.load)
        self.last_answer = now

    async def _watch(self, worker: Worker) -> None:
        """Raise WorkerLost when the process ends or its counter stands still for too long."""
        loop = asyncio.get_running_loop()
        died = asyncio.Event()
        loop.add_reader(worker.process.sentinel, died.set)
        beats, seen = -1, loop.time()
        try:
            while True:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(died.wait(), 0.25)
                    raise WorkerLost(worker.describe_end())
                if worker.beats.value != beats:
                    beats, seen = worker.beats.value, loop.time()
                if loop.time() - seen > self._patience():
                    raise WorkerLost(f"no sign of life for {loop.time() - seen:.1f} s")
        finally:
            loop.remove_reader(worker.process.sentinel)

    def _patience(self) -> float:
        """A first answer may compile kernels for long; a limit that proved too short doubles."""
        return (self.params.patience if self.has_answered else self.params.startup) * 2.0**self.losses
