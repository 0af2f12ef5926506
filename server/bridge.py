"""Where the robot, the people who watch it and the path filter meet: one live session, as plain calls.

Bytes, words, estimates and the passing of time come in; commands go to the links, keyframes to the estimator, frames to
the viewers. Nothing here waits: `live` calls it from the loop. It is the `Cockpit` that `api` asks for.
"""

from __future__ import annotations

import dataclasses
import importlib.metadata
import logging
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from server.control import CommandWord, Control
from server.dashboard import Dashboard
from server.estimator import Estimator
from server.messages import DriveCommand, Effect, Estimate, Keyframe, Message, Snapshot, Stop
from server.recording import Recorder
from server.session import Session
from server.stream import Hub
from server.transport import Link
from server.views import (
    DriverStatus,
    FilterStatus,
    LinkStatus,
    MapStatus,
    RobotStatus,
    Status,
    View,
    histogram_view,
    local_view,
    map_view,
    path_length,
    pose_view,
    rounded,
)

log = logging.getLogger(__name__)

STEERING_PERIOD = 0.09  # s between two commands of the robot's own steering: the radio is narrow
STATUS_EVERY = 4  # publications between two of the status when nothing calls for it


class Robot(Protocol):
    """The fold that is driven."""

    def step(self, message: Message) -> list[Effect]:
        """The effects of one message."""
        ...

    def snapshot(self) -> Snapshot:
        """What there is to see."""
        ...


class Autopilot(Protocol):
    """A virtual robot's own driver."""

    autopilot: bool

    @property
    def finished(self) -> bool:
        """Whether its plan is driven to the end."""
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
    ):
        self.robot = robot
        self.session = session
        self.links = dict(links)
        self.control = control
        self.settings = configuration
        self.hub = Hub()
        self.dashboard = Dashboard()
        self.estimator: Estimator | None = None  # given by `live`, since its answers come back here
        self.recorder: Recorder | None = None
        self.virtual: Autopilot | None = None
        self.clock: Callable[[], float] = next(iter(self.links.values())).now
        self.start = self.clock()
        self.steered = -STEERING_PERIOD
        self.published = 0
        self.shown_map: tuple[int, float, int] | None = None
        self.shown_local: float = -1.0
        self.newest: Snapshot | None = None
        self.newest_at = -1.0
        self.version = importlib.metadata.version("crunch")

    @property
    def t(self) -> float:
        """The session's present."""
        return self.clock() - self.start

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
        before = (self.control.driver, self.control.stopped_by, self.control.autopilot)
        t = self.t
        self.tell(self.control.hear(viewer, word, t), t)
        if before != (self.control.driver, self.control.stopped_by, self.control.autopilot):
            self.sync_autopilot()
            self.publish_status()

    def left(self, viewer: str) -> None:
        """A viewer has gone."""
        t = self.t
        self.tell(self.control.leave(viewer, t), t)
        self.publish_status()

    def tick(self) -> None:
        """The passing of time: repeats the driver's wish, or stops the robot when the driver has fallen silent."""
        t = self.t
        self.tell(self.control.tick(t), t)

    def halt(self) -> None:
        """Stand still at once, whatever happens next; for the end of the session."""
        if self.virtual is not None:
            self.virtual.autopilot = False
        self.control.wish = self.control.goal = None
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
            elif self.estimator is not None:
                self.estimator.submit(effect)

    def is_hasty(self, effect: Effect, t: float) -> bool:
        """Whether the robot's own steering speaks again sooner than the radio should hear it."""
        if not isinstance(effect, DriveCommand):
            return False
        if t - self.steered < STEERING_PERIOD:
            return True
        self.steered = t
        return False

    def sync_autopilot(self) -> None:
        """Tell the virtual robot whether it drives itself."""
        if self.virtual is not None:
            self.virtual.autopilot = bool(self.control.autopilot)

    def publish(self) -> None:
        """Show the present to all viewers; called at frame rate."""
        self.published += 1
        if self.control.autopilot and self.virtual is not None and self.virtual.finished:
            self.control.autopilot = False
        if not self.hub.viewers and self.dashboard.server is None:
            return
        snapshot = self.look()
        if self.control.goal is not None and snapshot.goal is None:
            self.control.arrive()
            self.publish_status()
        self.show("pose", pose_view(snapshot, self.t))
        if snapshot.t != self.shown_local:
            self.shown_local = snapshot.t
            self.show("histogram", histogram_view(snapshot))
            if self.published % 2 == 0:
                self.show("local", local_view(snapshot))
        map_key = (len(snapshot.path), snapshot.affinity, snapshot.resamplings)
        if map_key != self.shown_map:
            self.shown_map = map_key
            self.show("map", map_view(snapshot))
        if self.published % STATUS_EVERY == 0:
            self.publish_status()
        self.dashboard.update(snapshot)

    def show(self, topic: str, view: View) -> None:
        """One frame for everybody."""
        self.hub.publish(topic, view.fields, view.arrays)

    def publish_status(self) -> None:
        """Show the status, out of turn when somebody's word changed it."""
        self.hub.publish("status", self.status().model_dump())

    # What there is to see.

    def look(self) -> Snapshot:
        """A fresh snapshot."""
        self.newest, self.newest_at = self.robot.snapshot(), self.t
        return self.newest

    def snapshot(self) -> Snapshot:
        """A snapshot not older than a frame."""
        if self.newest is None or self.t - self.newest_at > 0.1:
            return self.look()
        return self.newest

    def configuration(self) -> dict[str, Any]:
        """The settings that the session runs with."""
        return self.settings

    def status(self) -> Status:
        """Everything at a glance."""
        snapshot = self.snapshot()
        return Status(
            t=round(self.t, 3),
            version=self.version,
            recording=str(self.recorder.path) if self.recorder else None,
            link=self.link_status(),
            robot=self.robot_status(snapshot),
            map=MapStatus(
                vertices=len(self.session_vertices(snapshot)),
                fixed_depth=snapshot.fixed_depth,
                path_length_m=round(path_length(snapshot.path), 3),
                affinity=round(snapshot.affinity, 3),
                plausibility=round(snapshot.plausibility, 3),
            ),
            filter=self.filter_status(snapshot),
            driver=self.driver_status(snapshot),
        )

    def session_vertices(self, snapshot: Snapshot) -> Any:
        """The vertices of the best path; none before the first estimate, when the path is only the present pose."""
        return snapshot.path if self.estimator is None or self.estimator.status().vertices else ()

    def link_status(self) -> LinkStatus:
        """How the radio is doing."""
        health = self.session.health(self.t)
        boards = [board for board in health["boards"].values() if board["age"] is not None]
        counters = {"frames": sum(health["frames"].values()), "lost": health["lost"], "rejected": health["rejected"]}
        return LinkStatus(
            names=[link.spec for link in self.links.values()],
            connected=any(link.is_connected for link in self.links.values()),
            error="; ".join(f"{link.spec}: {link.error}" for link in self.links.values() if link.error),
            reconnects=sum(link.reconnects for link in self.links.values()),
            silence_s=round(max(0.0, min(board["age"] for board in boards)), 3) if boards else None,
            lost_percent=round(100.0 * max((board["loss"] for board in boards), default=0.0), 2),
            counters={**counters, **{f"refused_{reason}": count for reason, count in health["refused"].items()}},
        )

    def robot_status(self, snapshot: Snapshot) -> RobotStatus:
        """The boards' own words."""
        drive = snapshot.balance or snapshot.boards.get("drive")
        power = snapshot.power
        x, y, theta = rounded(snapshot.pose)
        return RobotStatus(
            name=snapshot.robot,
            state=drive.state if drive else None,
            stop_reason=drive.reason if drive else None,
            battery_volts=power.battery_volts if power else None,
            battery_amperes=power.battery_amperes if power else None,
            charger_volts=power.charger_volts if power else None,
            tilt_rad=round(snapshot.tilt, 4),
            pose=(x, y, theta),
            distance_m=round(snapshot.distance, 3),
            virtual=self.virtual is not None,
            boards={name: dataclasses.asdict(board) for name, board in snapshot.boards.items()},
        )

    def filter_status(self, snapshot: Snapshot) -> FilterStatus:
        """How the path filter is doing."""
        assert self.estimator is not None
        worker = self.estimator.status()
        return FilterStatus(
            state=worker.state,
            reason=worker.reason,
            particles=worker.n_particles,
            wanted_particles=worker.wanted_particles,
            effective_particles=round(snapshot.effective_particles, 1),
            resamplings=snapshot.resamplings,
            waiting=worker.waiting,
            restarts=worker.restarts,
            load=round(worker.load, 4),
            process_id=worker.process_id,
        )

    def driver_status(self, snapshot: Snapshot) -> DriverStatus:
        """Who drives."""
        params = self.control.params
        return DriverStatus(
            viewer=self.control.driver,
            leased=self.control.has_lease(self.t),
            stopped_by=self.control.stopped_by,
            autopilot=self.control.autopilot,
            goal=snapshot.goal,
            viewers=len(self.hub.viewers),
            max_speed=params.max_speed,
            max_turn=params.max_turn,
        )
