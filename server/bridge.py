"""Where the robot, the people who watch it and the path filter meet: one live session, as plain calls.

Bytes, words, estimates and the passing of time come in; commands go to the links, keyframes to the estimator, frames to
the viewers. Nothing here waits: `live` calls it from the loop. It is the `Cockpit` that `api` asks for.
"""

from __future__ import annotations

import importlib.metadata
import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any, Protocol

from server.adviser import Adviser
from server.commands import DriveCommand, PowersCommand
from server.control import Control, Refused
from server.dashboard import Dashboard
from server.estimator import Estimator
from server.explorer import Explorer, Progress
from server.guidance import route_view, suggestions_view
from server.labels import Labels
from server.layers import Layers
from server.messages import Effect, Estimate, Keyframe, Message, Snapshot, Stop
from server.navigator import Navigator, NavigatorParams
from server.pulse import Pulse
from server.recording import Recorder
from server.session import Session
from server.status import driver_status, filter_status, link_status, loop_status, map_status, robot_status
from server.stops import HARMLESS
from server.stream import Hub
from server.transport import Link
from server.views import SessionStatus, Status, pose_view
from server.words import AutopilotWord, CommandWord, PlainWord

log = logging.getLogger(__name__)

STEERING_SLACK = 0.03  # s by which a sweep may come early
STATUS_EVERY = 8  # publications between two of the status when nothing calls for it


class Robot(Protocol):
    """The fold that is driven."""

    t: float  # of its newest reading

    def step(self, message: Message) -> list[Effect]:
        """The effects of one message."""
        ...

    def snapshot(self) -> Snapshot:
        """What there is to see."""
        ...

    @property
    def stop_reason(self) -> str | None:
        """Why the drive board stood still last, in its own word; None before its first."""
        ...

    def finish(self) -> list[Keyframe]:
        """The session ends here: the vertices that still wait."""
        ...


class Autopilot(Protocol):
    """What drives by itself: a virtual robot's own driver, or an explorer."""

    @property
    def autopilot(self) -> bool:
        """Whether it drives."""
        ...

    @autopilot.setter
    def autopilot(self, is_on: bool) -> None: ...

    @property
    def finished(self) -> bool:
        """Whether it is at its end."""
        ...


class Bridge:
    """A live session. Times are the session's own, in seconds since its start."""

    def __init__(
        self,
        robot: Robot,
        session: Session,
        links: Mapping[str, Link],
        control: Control,
        configuration: dict[str, Any],
        navigation: NavigatorParams = NavigatorParams(),  # noqa: B008 (parameters are frozen)
    ):
        self.robot = robot
        self.session = session
        self.links = dict(links)
        self.control = control
        self.control.stops.remember = self.note_stop
        self.settings = configuration
        self.hub = Hub()
        self.layers = Layers(self.hub)
        self.navigator = Navigator(navigation)
        self.adviser = Adviser(navigation.suggestions, navigation.cost)
        if not control.runs_itself:
            self.layers.add("route", lambda snapshot: route_view(snapshot, self.navigator.standing))
            self.layers.add("suggestions", lambda snapshot: suggestions_view(self.adviser.suggestions), every=10)
        self.dashboard = Dashboard(None if control.runs_itself else self.propose)
        self.pulse = Pulse()
        self.estimator: Estimator | None = None  # given by `live`, since its answers come back here
        self.recorder: Recorder | None = None
        self.is_virtual = False
        self.explores_for = ""  # who switched the explorer on, if not the command line
        self.reboots = 0  # of the boards, as far as the explorer knows
        self.autopilot: Autopilot | None = None
        self.about = SessionStatus(number=1, began=datetime.now(UTC))
        self.labels = Labels(self.note_label)
        self.clock: Callable[[], float] = next(iter(self.links.values())).now
        self.start = self.clock()
        self.published = 0
        self.newest: Snapshot | None = None
        self.newest_at = -1.0
        self.version = importlib.metadata.version("crunch")

    @property
    def t(self) -> float:
        """The session's present."""
        return self.clock() - self.start

    @property
    def speed(self) -> float:
        """Session's seconds in a second of the people who watch."""
        return next(iter(self.links.values())).speed

    @property
    def is_connected(self) -> bool:
        """Whether a line to the boards is open; those of a laser or of mice move nothing."""
        return any(link.is_connected for link_id, link in self.links.items() if link_id not in self.session.lines)

    # From one session to the next.

    def begin(
        self,
        robot: Robot,
        session: Session,
        estimator: Estimator,
        recorder: Recorder | None,
        configuration: dict[str, Any],
        about: SessionStatus,
    ) -> None:
        """A new session on the same links: time starts at zero, nobody drives yet, and a stop that holds goes on."""
        self.robot, self.session, self.estimator, self.recorder = robot, session, estimator, recorder
        self.settings, self.about = configuration, about
        self.layers.begin()
        self.navigator.begin()
        self.adviser.begin()
        self.labels = Labels(self.note_label)
        self.start = recorder.start_ns * 1e-9 if recorder else self.clock()
        self.newest, self.newest_at = None, -1.0
        drives_itself = self.autopilot is not None and self.autopilot.autopilot  # at the very start, if asked for
        if isinstance(self.autopilot, Explorer):
            self.autopilot.begin()  # on another map
        has_autopilot, stopped_by = self.control.autopilot is not None, self.control.stopped_by
        autopilot = drives_itself if has_autopilot else None
        self.control = Control(self.control.params, autopilot, self.control.runs_itself)
        self.control.stopped_by = stopped_by
        self.control.stops.remember = self.note_stop
        self.sync_autopilot()
        self.publish_status()

    def end(self) -> None:
        """The session is over: the robot stands, nothing more is recorded or mapped. Its map stays to be looked at."""
        self.control.stops.note(self.t, "the session ended", "session")
        self.halt()
        self.about = self.about.model_copy(update={"running": False})
        self.session.sink = self.recorder = None
        if self.estimator is not None:
            for keyframe in self.robot.finish():
                self.estimator.submit(keyframe)
            self.estimator.finish()
        self.publish_status()

    # What comes in.

    def receive(self, link_id: str, data: bytes, arrival: float) -> None:
        """Bytes from a link, which arrived at its clock's `arrival`."""
        t = max(0.0, arrival - self.start)
        self.obey([effect for effect in self.session.receive(link_id, data, t) if not self.is_hasty(effect, t)])

    def believe(self, estimate: Estimate) -> None:
        """The path filter's answer."""
        self.session.mark({"estimate": len(estimate.path), "particles": estimate.n_particles}, self.t)
        self.obey(self.robot.step(estimate))

    def hear(self, viewer: str, word: CommandWord) -> None:
        """A viewer's word; raises Refused."""
        if not self.about.running and not isinstance(word, PlainWord):
            raise Refused("no session runs: begin one under Sessions first")
        before = self.control.standing()
        t = self.t
        self.control.read = self.robot.t
        self.tell(self.control.hear(viewer, word, t), t)
        if isinstance(word, AutopilotWord):
            self.explores_for = viewer
        if before != self.control.standing():
            self.sync_autopilot()
            self.publish_status()

    def note_stop(self, stop: dict[str, Any]) -> None:
        """The recording remembers who stopped the robot, and why."""
        self.session.mark({"stopped": stop}, self.t)

    def note_label(self, event: dict[str, Any]) -> None:
        """The recording remembers what was labelled, and what there is to see has changed."""
        self.session.mark({"label": event}, self.t)
        self.newest = None

    def left(self, viewer: str) -> None:
        """A viewer has gone."""
        t = self.t
        self.tell(self.control.leave(viewer, t), t)
        if self.control.autopilot and isinstance(self.autopilot, Explorer) and self.explores_for == viewer:
            self.end_exploring(t, "who let it explore has left", viewer)
        self.publish_status()

    def tick(self) -> None:
        """The passing of time: repeats the driver's wish, or stops the robot when the driver has fallen silent."""
        before, t = self.control.standing(), self.t
        self.control.stops.watch(t, self.robot.stop_reason, self.is_connected)
        self.tell(self.control.tick(t), t)
        self.tell(self.navigator.tick(t, self.control, self.look), t)
        for link_id, request in self.session.requests(t).items():
            self.links[link_id].write(request)
        if isinstance(self.autopilot, Explorer):
            self.watch_over(self.autopilot, t)
            self.tell(self.autopilot.tick(t, self.snapshot), t)
        if self.control.autopilot and self.autopilot is not None and self.autopilot.finished:
            self.control.autopilot = False
        if self.hub.viewers:
            self.adviser.tick(t, self.snapshot)
        if before != self.control.standing():
            self.publish_status()

    def watch_over(self, explorer: Explorer, t: float) -> None:
        """End exploring where the robot fell silent, began anew or stopped of itself: somebody may have it in hand."""
        reboots = sum(clock.reboots for clock in self.session.clocks.values())
        reason = self.robot.stop_reason
        if not explorer.autopilot or self.robot.t <= 0.0:
            self.reboots = reboots
            return
        if t - self.robot.t > self.control.params.stale:
            self.end_exploring(t, "the robot fell silent", "explorer")
        elif reboots != self.reboots:
            self.end_exploring(t, "the robot began anew", "explorer")
        elif reason is not None and reason not in HARMLESS:
            self.end_exploring(t, reason, "explorer")

    def end_exploring(self, t: float, why: str, who: str) -> None:
        """Nobody drives any more, and the robot stands."""
        self.control.stops.note(t, why, who)
        self.control.autopilot = False
        self.sync_autopilot()
        self.tell([Stop(t)], t)

    def halt(self) -> None:
        """Stand still at once, whatever happens next; for the end of the session."""
        if self.control.autopilot:
            self.control.autopilot = False
        self.sync_autopilot()
        self.control.forget()
        t = self.t
        self.tell([Stop(t)], t)

    # What goes out.

    def tell(self, messages: list[Message], t: float) -> None:
        """Hand a person's messages to the robot."""
        for message in messages:
            self.obey(self.session.command(message, t))  # type: ignore[arg-type]  # control only makes commands

    def obey(self, effects: list[Effect]) -> None:
        """Do what the robot decided."""
        for effect in effects:
            if not isinstance(effect, Keyframe):
                link = self.links.get(self.session.drive_link) or next(iter(self.links.values()))
                link.write(self.session.encode(effect))
            elif self.estimator is not None and self.about.running:
                self.estimator.submit(effect)

    def is_hasty(self, effect: Effect, t: float) -> bool:
        """Whether the robot's own steering speaks sooner than the radio should hear it."""
        if isinstance(effect, PowersCommand):  # sweeps come as often as the radio is to hear of them
            return (effect.left, effect.right) != (0.0, 0.0) and not self.control.may_steer(t, STEERING_SLACK)
        return isinstance(effect, DriveCommand) and not self.control.may_steer(t)

    def sync_autopilot(self) -> None:
        """Tell the autopilot whether it drives."""
        if self.autopilot is not None:
            self.autopilot.autopilot = bool(self.control.autopilot) and self.about.running

    def publish(self, is_last: bool = False) -> None:
        """Show the present to all viewers; called at frame rate."""
        self.published += 1
        if not self.hub.viewers and not self.dashboard.is_watched:
            return
        snapshot = self.look()
        if self.control.goal is not None and snapshot.goal is None:
            self.control.arrive()
            self.publish_status()
        self.hub.publish("pose", *pose_view(snapshot, self.t))
        self.layers.show(snapshot, is_last)
        if self.published % STATUS_EVERY == 0:
            self.publish_status()
        self.dashboard.update(snapshot)

    def propose(self, x: float, y: float) -> None:
        """Show all viewers a place where somebody would have the robot go; whoever drives may send it there."""
        self.hub.notify({"kind": "proposal", "x": round(x, 3), "y": round(y, 3)})

    def publish_status(self) -> None:
        """Show the status, out of turn when somebody's word changed it."""
        self.hub.publish("status", self.status().model_dump(mode="json"))

    # What there is to see.

    def look(self) -> Snapshot:
        """A fresh snapshot."""
        seen = self.robot.snapshot()
        labels = self.labels.placed(seen.path[: len(seen.observations)])
        self.newest, self.newest_at = replace(seen, labels=labels), self.t
        return self.newest

    def snapshot(self) -> Snapshot:
        """A snapshot not older than a frame."""
        if self.newest is None or self.t - self.newest_at > 0.1:
            return self.look()
        return self.newest

    def configuration(self) -> dict[str, Any]:
        """The settings that the session runs with."""
        return self.settings

    def exploring(self) -> Progress | None:
        """How the explorer gets on; None where there is none."""
        return self.autopilot.progress if isinstance(self.autopilot, Explorer) else None

    def status(self) -> Status:
        """Everything at a glance."""
        assert self.estimator is not None
        t, snapshot, worker = self.t, self.snapshot(), self.estimator.status()
        return Status(
            t=round(t, 3),
            version=self.version,
            session=self.about,
            recording=str(self.recorder.path) if self.recorder else None,
            link=link_status(self.session, self.links, self.is_connected, t),
            robot=robot_status(snapshot, self.is_virtual, self.layers.names(snapshot)),
            map=map_status(snapshot, worker.vertices > 0),
            filter=filter_status(snapshot, worker),
            driver=driver_status(snapshot, self.control, len(self.hub.viewers), t, self.exploring()),
            stops=self.control.stops.newest(),
            loop=loop_status(self.pulse.lateness()),
        )
