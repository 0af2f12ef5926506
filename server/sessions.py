"""Sessions, one at a time on the same links: each has a robot, a path filter, a recording and a name of its own.

Beginning and ending are told to `bridge`, which shows and drives whatever runs; the filter's worker is a task of the
group that `run` opens. Uses its siblings `bridge` and `replay` (warming kernels up), and `recorded` (checking sensors).
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import importlib.metadata
import logging
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from server.bridge import Bridge, Robot
from server.config import Config, revised
from server.errors import UserError
from server.estimator import WorkerEstimator
from server.messages import Snapshot
from server.recorded import check_senses
from server.recording import Header, LinkName, Recorder
from server.replay import warm_up
from server.rest.sessions import NotRunning, SessionSummary
from server.robots.kinds import ROBOTS
from server.session import session_of
from server.views import SessionStatus, path_length

log = logging.getLogger(__name__)

SETTLING = 30.0  # s that the filter is given to answer for the last vertices; it may just be starting
SETTLED_POLL = 0.05  # s between two looks at whether it has
FEWEST = 2  # vertices of a map that is kept: a robot that only stood has none

KeepMap = Callable[[Snapshot, SessionStatus], str | None]


class Sessions:
    """The sessions of one server; the newest is the bridge's, running or not. A `SessionKeeper`."""

    def __init__(
        self, bridge: Bridge, config: Config, seed: int, threads: int, folder: Path | None, robot: str = "crunch"
    ):
        self.bridge = bridge
        self.robot = robot  # its name
        self.config = config
        self.seed = seed
        self.threads = threads
        self.folder = folder
        self.keep_map: KeepMap = lambda snapshot, about: None
        self.past: list[SessionSummary] = []
        self.number = 0
        self.group: asyncio.TaskGroup | None = None
        self.filtering: asyncio.Task[None] | None = None
        self.changing = asyncio.Lock()  # of two who begin or end at once, the second waits
        self.is_put_away = True  # whether the newest session's recording is closed and its map kept
        self.recorder: Recorder | None = None  # the newest session's

    async def run(self) -> None:
        """Keep the filter of the present session alive until cancelled."""
        async with asyncio.TaskGroup() as group:
            self.group = group
            self._feed()
            await asyncio.Event().wait()

    async def sync(self) -> None:
        """The recording onto the disk, off the loop."""
        if self.bridge.recorder:
            await asyncio.to_thread(self.bridge.recorder.sync)

    def summaries(self) -> list[SessionSummary]:
        """All sessions, the newest first."""
        is_past = bool(self.past) and self.past[0].number == self.number
        return list(self.past) if is_past else [self._summary(), *self.past]

    def rename(self, name: str) -> SessionSummary:
        """Call the newest session something else; its recording remembers."""
        self.bridge.about = self.bridge.about.model_copy(update={"name": name})
        self._note_name()
        if self.past and self.past[0].number == self.number:
            self.past[0] = self.past[0].model_copy(update={"name": name})
        self.bridge.publish_status()
        return self.summaries()[0]

    async def begin(self, name: str = "", settings: dict[str, Any] | None = None) -> SessionSummary:
        """End the session that runs, and begin a new one; UserError for settings or a folder that cannot be used."""
        async with self.changing:
            config = revised(self.config, settings or {})
            check_senses(self.robot, config)
            if settings:
                await asyncio.to_thread(warm_up, getattr(config, self.robot), 1)
            robot = await asyncio.to_thread(ROBOTS[self.robot].fold, getattr(config, self.robot))
            if self.bridge.about.running:
                await self._end()
            self.open(name, config, robot)
            self._feed()
            return self._summary()

    async def end(self) -> SessionSummary:
        """End the session that runs; NotRunning if none does."""
        async with self.changing:
            if not self.bridge.about.running:
                raise NotRunning("no session runs")
            return await self._end()

    def open(self, name: str = "", config: Config | None = None, robot: Robot | None = None) -> None:
        """Begin a session whose filter starts with `run`; UserError if it cannot be recorded."""
        config = config or self.config
        kind, params = ROBOTS[self.robot], getattr(config, self.robot)
        recorder = self._open_recording(config)
        self.number += 1
        self.recorder, self.is_put_away = recorder, False
        about = SessionStatus(
            number=self.number,
            name=name,
            began=datetime.now(UTC),
            recording=recorder.path.stem if recorder else None,
        )
        folded: Robot = robot or kind.fold(params)
        estimator = WorkerEstimator(
            functools.partial(kind.make_estimator, params, self.seed, self.threads),
            self.bridge.believe,
            1 if kind.bumps else params.filter.particles,  # a cart's estimators take as many as they need
            config.estimator,
        )
        session = session_of(self.robot, folded, params, recorder)
        self.bridge.begin(folded, session, estimator, recorder, config.model_dump(mode="json"), about)
        if name:
            self._note_name()

    def close(self) -> None:
        """End the session without waiting for anything: the server leaves, even where an ending was cut short."""
        if self.is_put_away:
            return
        if self.bridge.about.running:
            self.bridge.end()
        self._put_away(self._summary(), self.bridge.look())

    async def _end(self) -> SessionSummary:
        self.bridge.end()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(SETTLING):
                while not self._is_settled():
                    await asyncio.sleep(SETTLED_POLL)
        if self.filtering is not None:
            self.filtering.cancel()
            await asyncio.wait([self.filtering])
        summary = await asyncio.to_thread(self._put_away, self._summary(), self.bridge.look())
        self.past.insert(0, summary)
        self.bridge.publish_status()
        return summary

    def _is_settled(self) -> bool:
        """Whether the filter has said its last word."""
        if self.bridge.estimator is None:
            return True
        status = self.bridge.estimator.status()
        return self.bridge.estimator.is_settled() or status.state == "failed"

    def _put_away(self, summary: SessionSummary, snapshot: Snapshot) -> SessionSummary:
        """Close the recording and keep the map; why that failed stands in the summary; the recording can make it."""
        self.is_put_away = True
        if self.recorder:
            self.recorder.close()
            print(f"Recorded in {self.recorder.path}", flush=True)
        if summary.vertices < FEWEST:
            return summary
        try:
            return summary.model_copy(update={"map": self.keep_map(snapshot, summary)})
        except (UserError, OSError) as error:
            log.warning("the session's map was not kept: %s", error)
            return summary.model_copy(update={"map_error": str(error)})

    def _feed(self) -> None:
        """Start the filter of the session, once `run` runs."""
        if self.group is not None and isinstance(self.bridge.estimator, WorkerEstimator):
            self.filtering = self.group.create_task(self.bridge.estimator.run())

    def _summary(self) -> SessionSummary:
        snapshot = self.bridge.look()  # now, and not a moment ago
        status = self.bridge.status()
        return SessionSummary(
            **self.bridge.about.model_dump(),
            duration_s=status.t,
            vertices=status.map.vertices,
            path_length_m=round(path_length(snapshot.path), 3),
        )

    def _note_name(self) -> None:
        self.bridge.session.mark({"name": self.bridge.about.name}, self.bridge.t)

    def _open_recording(self, config: Config) -> Recorder | None:
        """A new recording in the folder for them, named by the date."""
        if self.folder is None:
            return None
        links = self.bridge.links.items()
        header = Header(
            robot=self.robot,
            links=tuple(LinkName(id=link_id, spec=link.spec) for link_id, link in links),
            unix_ns=time.time_ns(),
            monotonic_ns=round(self.bridge.clock() * 1e9),
            configuration=config.model_dump(mode="json"),
            seed=self.seed,
            software={"crunch": importlib.metadata.version("crunch")},
        )
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            remedy = "name another with --recordings"
            raise UserError(f"{self.folder}: cannot be made ({error.strerror}); {remedy}") from None
        return Recorder(free_name(self.folder), header)


def free_name(folder: Path) -> Path:
    """run-DATE-TIME.rlog, with a number behind it if two sessions start in one second."""
    stem = time.strftime("run-%Y%m%d-%H%M%S")
    path, number = folder / f"{stem}.rlog", 2
    while path.exists():
        path, number = folder / f"{stem}-{number}.rlog", number + 1
    return path
