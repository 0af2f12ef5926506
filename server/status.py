"""The status of a session, put together from what its parts say of themselves. Uses its siblings `felt_views`
and `views`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from server.control import Control
from server.estimator import EstimatorStatus
from server.explorer import Progress
from server.felt_views import run_status, whereabouts
from server.messages import Snapshot
from server.pulse import Lateness
from server.session import Session
from server.transport import Link
from server.views import (
    DriverStatus,
    FilterStatus,
    LinkStatus,
    LoopStatus,
    MapStatus,
    RobotStatus,
    finite,
    path_length,
    rounded,
)


def map_status(snapshot: Snapshot, has_vertices: bool) -> MapStatus:
    """The best map's figures; before the first vertex the path is only the present pose."""
    return MapStatus(
        vertices=len(snapshot.path) if has_vertices else 0,
        fixed_depth=snapshot.fixed_depth,
        path_length_m=round(path_length(snapshot.path), 3),
        affinity=round(snapshot.affinity, 3),
        plausibility=round(snapshot.plausibility, 3),
    )


def link_status(session: Session, links: Mapping[str, Link], is_connected: bool, t: float) -> LinkStatus:
    """How the radio is doing at the session's time t, if a line to the boards is open."""
    health = session.health(t)
    boards = [board for board in health["boards"].values() if board["age"] is not None]
    faults = {link_id: fault for link_id, fault in health["faults"].items() if link_id in links}
    errors = [f"{link.spec}: {link.error}" for link in links.values() if link.error]
    counters = {"frames": sum(health["frames"].values()), "lost": health["lost"], "rejected": health["rejected"]}
    return LinkStatus(
        names=[link.spec for link in links.values()],
        connected=is_connected,
        error="; ".join([*errors, *filter(None, faults.values())]),
        side_lines={link_id: links[link_id].error or fault for link_id, fault in faults.items()},
        reconnects=sum(link.reconnects for link in links.values()),
        silence_s=round(max(0.0, min(board["age"] for board in boards)), 3) if boards else None,
        lost_percent=round(100.0 * max((board["loss"] for board in boards), default=0.0), 2),
        counters={**counters, **{f"refused_{reason}": count for reason, count in health["refused"].items()}},
    )


def robot_status(snapshot: Snapshot, is_virtual: bool, layers: list[str]) -> RobotStatus:
    """The boards' own words, and which topics there are."""
    motors, power = snapshot.motors or snapshot.cart, snapshot.power
    drive = snapshot.balance or motors or snapshot.boards.get("drive") or snapshot.boards.get("motor")
    low, empty = snapshot.battery_limits
    x, y, theta = rounded(snapshot.pose)
    return RobotStatus(
        name=snapshot.robot,
        state=drive.state if drive else None,
        stop_reason=drive.reason if drive else None,
        battery_volts=power.battery_volts if power else motors.battery_volts if motors else None,
        battery_low_volts=low,
        battery_empty_volts=empty,
        battery_amperes=power.battery_amperes if power else None,
        charger_volts=power.charger_volts if power else None,
        charger_amperes=power.charger_amperes if power else None,
        motor_amperes=(power.left_motor_amperes, power.right_motor_amperes) if power else None,
        powers=(round(snapshot.motors.left, 4), round(snapshot.motors.right, 4)) if snapshot.motors else None,
        mice=dataclasses.asdict(snapshot.mice) if snapshot.mice else None,
        run=run_status(snapshot),
        whereabouts=whereabouts(snapshot),
        tilt_rad=finite(snapshot.tilt),
        pose=(x, y, theta),
        distance_m=round(snapshot.distance, 3),
        virtual=is_virtual,
        layers=layers,
        last_words=dataclasses.asdict(snapshot.last_words) if snapshot.last_words else None,
        boards={name: dataclasses.asdict(board) for name, board in snapshot.boards.items()},
    )


def filter_status(snapshot: Snapshot, worker: EstimatorStatus) -> FilterStatus:
    """How the path filter is doing; one of bumps has as many particles as it needs, and sheds none."""
    counts = (
        (snapshot.n_particles, snapshot.n_particles) if snapshot.felt else (worker.n_particles, worker.wanted_particles)
    )
    return FilterStatus(
        state=worker.state,
        reason=worker.reason,
        particles=counts[0],
        wanted_particles=counts[1],
        effective_particles=round(snapshot.effective_particles, 1),
        resamplings=snapshot.resamplings,
        waiting=worker.waiting,
        restarts=worker.restarts,
        load=round(worker.load, 4),
        process_id=worker.process_id,
    )


def driver_status(
    snapshot: Snapshot, control: Control, n_viewers: int, t: float, exploring: Progress | None = None
) -> DriverStatus:
    """Who drives at the session's time t, and how fast the robot then goes at most."""
    fastest, turning = snapshot.fastest
    return DriverStatus(
        viewer=control.driver,
        leased=control.has_lease(t),
        stopped_by=control.stopped_by,
        autopilot=control.autopilot,
        exploring=exploring.state if exploring else None,
        abandoned=exploring.abandoned if exploring else None,
        asked_by=control.asked_by,
        answer_s=control.answer_time(t),
        shared=control.wish is not None and control.wish.shared,
        goal=snapshot.goal,
        runs_itself=control.runs_itself,
        viewers=n_viewers,
        max_speed=round(min(control.params.max_speed, fastest), 3),
        max_turn=round(min(control.params.max_turn, turning), 3),
    )


def loop_status(late: Lateness) -> LoopStatus:
    """How late the event loop is."""
    return LoopStatus(
        late_p50_ms=round(1e3 * late.p50, 3),
        late_p99_ms=round(1e3 * late.p99, 3),
        late_worst_ms=round(1e3 * late.worst, 3),
    )
