"""The path filter's worker: the same estimates as inline, nothing lost when it dies, hangs or is too slow."""

import asyncio
import functools
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from server.estimator import EstimatorParams, InlineEstimator, ParticleBudget, Worker, WorkerEstimator
from server.messages import Estimate, Keyframe
from slam.path_filter import PathFilter, PathFilterParams
from slam.walls import Walls
from tests.served import wait_until

N_RAYS = 120
QUICK = EstimatorParams(patience=5.0, bound=100)  # a worker that only waits for a busy machine is not hung
FACTORY = functools.partial(PathFilter, PathFilterParams(particles=200), 3)


class SlowFilter(PathFilter):
    """Takes its time, as many particles would."""

    def extend(self, pose: np.ndarray, walls: Walls, travelled: float | None = None) -> None:
        """As the filter does, later."""
        time.sleep(2e-4 * self.n_particles)
        super().extend(pose, walls, travelled)


class BrokenFilter(PathFilter):
    """Breaks at its third vertex, every time."""

    def extend(self, pose: np.ndarray, walls: Walls, travelled: float | None = None) -> None:
        """As the filter does, but not for long."""
        if self.vertices == 2:
            os._exit(9)
        super().extend(pose, walls, travelled)


def keyframes(count: int) -> list[Keyframe]:
    """Vertices along a straight corridor, 1.6 m wide."""
    angles = 2.0 * np.pi * np.arange(N_RAYS) / N_RAYS
    with np.errstate(divide="ignore"):
        distances = np.where(np.abs(np.sin(angles)) > 0.4, 0.8 / np.abs(np.sin(angles)), np.inf)
    walls = Walls(distances, np.where(np.isfinite(distances), distances, 1.0))
    return [Keyframe(float(i), i, np.array([0.5 * i, 0.0, 0.0]), walls, 0.5 * (i > 0)) for i in range(count)]


def inline_estimates(frames: list[Keyframe]) -> list[Estimate]:
    """What the filter says after each vertex."""
    found: list[Estimate] = []
    estimator = InlineEstimator(FACTORY, found.append)
    for frame in frames:
        estimator.submit(frame)
    return found


async def until(condition, seconds: float = 120.0) -> None:
    """Wait for something that happens in its own time."""
    async with asyncio.timeout(seconds):
        while not condition():
            await asyncio.sleep(0.01)


async def run_beside(estimator: WorkerEstimator, story) -> None:
    """Run the estimator while the story is told."""
    running = asyncio.create_task(estimator.run())
    try:
        await story()
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
    assert estimator.worker is None or not estimator.worker.process.is_alive()


def process_of(estimator: WorkerEstimator) -> int:
    process_id = estimator.status().process_id
    assert process_id is not None
    return process_id


def assert_same(one: Estimate, other: Estimate) -> None:
    np.testing.assert_array_equal(one.path, other.path)
    np.testing.assert_array_equal(one.profile, other.profile)
    assert (one.affinity, one.resamplings) == (other.affinity, other.resamplings)


def test_a_killed_worker_is_known_dead_while_another_thread_reaps_it(monkeypatch):
    worker = Worker(FACTORY, 10)
    wait = os.waitpid

    def slow_wait(process_id: int, options: int) -> tuple[int, int]:
        """The child is gone and nobody has been told yet."""
        result = wait(process_id, options)
        time.sleep(0.2)
        return result

    monkeypatch.setattr(os, "waitpid", slow_wait)
    other = threading.Thread(target=worker.describe_end)
    other.start()
    worker.process.kill()
    time.sleep(0.1)
    worker.kill()
    assert not worker.process.is_alive()
    other.join()


def test_worker_gives_the_inline_estimate_bit_for_bit_however_batched():
    frames, arrived = keyframes(24), []
    estimator = WorkerEstimator(FACTORY, arrived.append, 200, QUICK)

    async def story():
        for frame in frames[:5]:
            estimator.submit(frame)
            await until(lambda n=frame.index + 1: arrived and len(arrived[-1].path) == n)
        for frame in frames[5:]:
            estimator.submit(frame)
        await until(lambda: len(arrived[-1].path) == len(frames))

    asyncio.run(run_beside(estimator, story))
    inline = inline_estimates(frames)
    for estimate in arrived:
        assert_same(estimate, inline[len(estimate.path) - 1])
    assert estimator.status().waiting == 0
    assert estimator.status().restarts == 0


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "hung"])
def test_lost_worker_is_replaced_and_fed_everything_again(number):
    frames, arrived = keyframes(20), []
    estimator = WorkerEstimator(FACTORY, arrived.append, 200, QUICK)

    async def story():
        for frame in frames[:10]:
            estimator.submit(frame)
        await until(lambda: arrived and len(arrived[-1].path) == 10)
        os.kill(process_of(estimator), number)
        for frame in frames[10:]:
            estimator.submit(frame)
        await until(lambda: len(arrived[-1].path) == 20)

    asyncio.run(run_beside(estimator, story))
    assert estimator.status().restarts == 1
    assert estimator.status().vertices == 20
    assert_same(arrived[-1], inline_estimates(frames)[-1])
    lengths = [len(estimate.path) for estimate in arrived]
    assert lengths == sorted(lengths), "the map never shrinks while it is computed again"


def test_hopeless_filter_is_given_up_and_the_session_goes_on():
    factory = functools.partial(BrokenFilter, PathFilterParams(particles=8), 0)
    params = EstimatorParams(attempts=2)
    estimator = WorkerEstimator(factory, lambda _: None, 8, params)

    async def story():
        for frame in keyframes(4):
            estimator.submit(frame)
        await until(lambda: estimator.status().state == "failed")
        estimator.submit(keyframes(5)[4])

    asyncio.run(run_beside(estimator, story))
    assert estimator.status().vertices == 5
    assert "code 9" in estimator.status().reason


def test_full_pipe_never_holds_the_loop():
    """A stopped worker with hundreds of keyframes before it: the loop goes on turning."""
    estimator = WorkerEstimator(FACTORY, lambda _: None, 200, EstimatorParams(batch=400, patience=60.0))
    longest = 0.0

    async def story():
        nonlocal longest
        await until(lambda: estimator.status().state == "idle")
        os.kill(process_of(estimator), signal.SIGSTOP)
        for frame in keyframes(400):  # about 800 kB, far more than a pipe holds
            estimator.submit(frame)
        turns = 0
        while turns < 50:
            await asyncio.sleep(0.001)
            turns += 1
        longest = turns

    asyncio.run(run_beside(estimator, story))
    assert longest == 50


def test_slow_filter_sheds_particles_and_takes_them_back():
    factory = functools.partial(SlowFilter, PathFilterParams(particles=400), 0)
    params = EstimatorParams(batch=4, bound=6, fewest=50, calm_batches=2)
    frames, arrived = keyframes(60), []
    estimator = WorkerEstimator(factory, arrived.append, 400, params)
    fewest = 400

    async def story():
        nonlocal fewest
        await until(lambda: estimator.status().state == "idle")
        for frame in frames[:40]:
            estimator.submit(frame)
        await until(lambda: arrived and len(arrived[-1].path) == 40)
        fewest = min(estimate.n_particles for estimate in arrived)
        for frame in frames[40:]:
            estimator.submit(frame)
            await until(lambda n=frame.index + 1: len(arrived[-1].path) == n)

    asyncio.run(run_beside(estimator, story))
    assert fewest < 400
    assert len(arrived[-1].path) == 60, "no vertex was dropped"
    assert arrived[-1].n_particles == 400
    assert estimator.status().n_particles == estimator.status().wanted_particles


def test_budget_halves_above_the_bound_and_never_goes_below_the_fewest():
    budget = ParticleBudget(2000, EstimatorParams(bound=10, fewest=300, calm_batches=2))
    assert [budget.next(11) for _ in range(4)] == [1000, 500, 300, 300]
    assert [budget.next(5) for _ in range(3)] == [300, 300, 300], "some queue: neither more nor fewer"
    assert [budget.next(1) for _ in range(6)] == [300, 600, 600, 1200, 1200, 2000]


def test_small_filters_are_never_asked_for_more_than_they_have():
    budget = ParticleBudget(40, EstimatorParams(bound=1, fewest=100))
    assert [budget.next(50), budget.next(0)] == [40, 40]


def test_a_worker_told_to_leave_with_its_group_stays_until_the_parent_ends_it():
    async def scene():
        found: list[Estimate] = []
        estimator = WorkerEstimator(FACTORY, found.append, 200, QUICK)
        task = asyncio.create_task(estimator.run())
        await until(lambda: estimator.status().state == "idle")
        worker = estimator.status().process_id
        assert worker is not None
        for number in (signal.SIGTERM, signal.SIGINT):
            os.kill(worker, number)
        for frame in keyframes(2):
            estimator.submit(frame)
        await until(lambda: found and len(found[-1].path) == 2)
        assert (estimator.status().restarts, estimator.status().process_id) == (0, worker)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        with pytest.raises(ProcessLookupError):
            os.kill(worker, 0)

    asyncio.run(scene())


def test_a_worker_leaves_when_its_parent_is_gone():
    code = (
        "import os, time\n"
        "from server.estimator import Worker\n"
        "from tests.server.test_estimator import FACTORY\n"
        "if __name__ == '__main__':\n"
        "    worker = Worker(FACTORY, 10)\n"
        "    worker.connection.recv()\n"
        "    print(worker.process.pid, flush=True)\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    parent = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False)
    worker = int(parent.stdout)
    wait_until(lambda: not is_alive(worker))


def is_alive(process_id: int) -> bool:
    """Whether there is such a process, and not only its remains."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{process_id}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
