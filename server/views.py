"""What viewers get of a robot: the topics of the stream and the documents of REST, made from a Snapshot.

Arrays are narrowed for the wire: poses as float32, the local map as one byte per cell, wall points as centimetres in
16 bits. Knows no socket and no web framework. Uses its sibling `layers`.
"""

from __future__ import annotations

import math
import zlib
from datetime import datetime
from typing import Any

import numpy as np
from pydantic import BaseModel, Field

from server.layers import CENTIMETRE, View, fine_unit, layer, pack_curves, pack_points
from server.messages import Snapshot
from server.stops import StopEntry
from slam.pose import between, compose


class LinkStatus(BaseModel):
    """Bytes and frames of the radio since the start, and how long ago the robot was last heard."""

    names: list[str] = Field(examples=[["virtual:"]])
    connected: bool = Field(examples=[True])
    error: str = Field(examples=[""], description="why a line is lost or not found; empty while all are open")
    side_lines: dict[str, str] = Field(
        default={},
        examples=[{"laser": "", "mouse0": "no such device"}],
        description="what is wrong with the lines of a laser and of mice; empty while nothing is",
    )
    reconnects: int = Field(examples=[0], description="how often lost lines were opened again")
    silence_s: float | None = Field(examples=[0.02], description="since the last good frame; null before the first")
    lost_percent: float = Field(examples=[0.4], description="of the frames of the last seconds")
    counters: dict[str, float] = Field(examples=[{"frames": 5120, "lost": 3, "rejected": 1}])


class RunStatus(BaseModel):
    """The run that a robot is on by itself, or was on last."""

    number: int = Field(examples=[1], description="since the board was switched on, modulo 256; 0 before the first")
    doing: str = Field(examples=["drive"], description="stand, drive, back or turn")
    bumps: int = Field(examples=[12])
    stages: int = Field(examples=[36], description="drives, ways back and turns that the robot has logged")
    lost_stages: int = Field(examples=[0], description="of these, lost on the way and in the robot's own log")


class Place(BaseModel):
    """A place where the robot may be, and the share of all that is believed."""

    x: float = Field(examples=[0.31])
    y: float = Field(examples=[0.88])
    heading: float = Field(examples=[1.57])
    share: float = Field(examples=[0.52])


class Whereabouts(BaseModel):
    """The places where the robot may be on a known map, the likeliest first, and the same in words."""

    localized: bool = Field(examples=[False])
    places: list[Place]
    words: str = Field(examples=["Not localized: it may be in 2 places, 52 % and 48 %."])


class RobotStatus(BaseModel):
    """The robot's own word about itself; null where it has not spoken yet."""

    name: str = Field(examples=["crunch"])
    state: str | None = Field(examples=["armed"])
    stop_reason: str | None = Field(examples=["none"])
    battery_volts: float | None = Field(examples=[28.1])
    battery_low_volts: float = Field(examples=[26.4], description="from which down it should be charged")
    battery_empty_volts: float = Field(examples=[24.0], description="from which down the robot drives no more")
    battery_amperes: float | None = Field(examples=[0.9])
    charger_volts: float | None = Field(examples=[0.0])
    charger_amperes: float | None = Field(default=None, examples=[0.0])
    motor_amperes: tuple[float, float] | None = Field(default=None, examples=[(0.4, 0.5)], description="left, right")
    powers: tuple[float, float] | None = Field(
        default=None, examples=[(0.31, 0.28)], description="left, right, of -1 to 1, where the robot knows no speeds"
    )
    mice: dict[str, Any] | None = Field(
        default=None,
        examples=[{"steps": 300, "filled_in": 2, "left_out": [4, 2]}],
        description="where the odometry is that of optical mice: its steps, those that the motors' odometry filled in, "
        "and of each mouse those without it",
    )
    run: RunStatus | None = Field(
        default=None, description="of a robot whose own program drives it: its run; null for others and before its word"
    )
    whereabouts: Whereabouts | None = Field(
        default=None, description="where on the map that was given the robot may be; null where none was given"
    )
    tilt_rad: float | None = Field(examples=[0.021], description="null for a robot that cannot tilt")
    pose: tuple[float, float, float] = Field(examples=[(1.25, 0.5, 0.1)], description="x m, y m, heading rad, world")
    distance_m: float = Field(examples=[12.5])
    virtual: bool = Field(examples=[True])
    layers: list[str] = Field(
        default=[], examples=[["pose", "histogram", "local", "path", "tile"]], description="topics that this robot has"
    )
    last_words: dict[str, Any] | None = Field(
        default=None,
        examples=[{"state": "armed", "reason": "none", "since": 12.4, "uptime": 61.0}],
        description="how the drive board's run ended that its last reset cut off",
    )
    boards: dict[str, dict[str, Any]] = Field(examples=[{"drive": {"uptime": 61.0, "reset_cause": 1}}])


class MapStatus(BaseModel):
    """The best map's figures."""

    vertices: int = Field(examples=[26])
    fixed_depth: int = Field(examples=[19], description="vertices up to this one are settled")
    path_length_m: float = Field(examples=[12.4])
    affinity: float = Field(examples=[41.2])
    plausibility: float = Field(examples=[-12.8])


class FilterStatus(BaseModel):
    """The path filter and the process it runs in."""

    state: str = Field(examples=["idle"], description="starting, idle, busy, restarting or failed")
    reason: str = Field(examples=[""])
    particles: int = Field(examples=[2000])
    wanted_particles: int = Field(examples=[2000], description="more than `particles` while particles are shed")
    effective_particles: float = Field(examples=[1312.4])
    resamplings: int = Field(examples=[4])
    waiting: int = Field(examples=[0], description="vertices not yet in the estimate")
    restarts: int = Field(examples=[0])
    load: float = Field(examples=[0.02], description="share of time that it computes")
    process_id: int | None = Field(examples=[4711], description="of the worker; null while it is replaced")


class DriverStatus(BaseModel):
    """Who drives, and whether a stop holds."""

    viewer: str | None = Field(examples=["viewer-3"])
    leased: bool = Field(examples=[True], description="whether the driver spoke within the lease")
    stopped_by: str | None = Field(examples=[None], description="who pressed stop, until the driver resumes")
    autopilot: bool | None = Field(examples=[False], description="null for a robot that has none")
    exploring: str | None = Field(
        default=None,
        examples=["driving"],
        description="off, looking, driving, following or done; null where the autopilot is none that explores",
    )
    abandoned: int | None = Field(
        default=None, examples=[0], description="edges of the map that the explorer could not get to; null as above"
    )
    asked_by: str | None = Field(examples=["viewer-4"], description="who asks for control, until the driver answers")
    answer_s: float | None = Field(examples=[7.2], description="seconds that the driver has left to answer")
    shared: bool = Field(examples=[True], description="whether obstacles bend the driver's direction now")
    goal: tuple[float, float] | None = Field(examples=[(2.0, 1.5)])
    runs_itself: bool = Field(
        default=False,
        examples=[False],
        description="whether its own program drives it: armed it begins, and a stop ends it",
    )
    viewers: int = Field(examples=[1])
    max_speed: float = Field(examples=[0.5], description="m/s that the rules and the robot permit")
    max_turn: float = Field(examples=[1.5], description="rad/s, as above")


class SessionStatus(BaseModel):
    """The session: what people call it, and where it is kept."""

    number: int = Field(examples=[1], description="counts the sessions of this server")
    name: str = Field(default="", examples=["Third floor, east"], description="empty until somebody names it")
    running: bool = Field(default=True, examples=[True], description="false once it has ended; nothing moves then")
    began: datetime = Field(examples=["2026-01-01T12:00:00Z"])
    recording: str | None = Field(default=None, examples=["run-20260101-120000"], description="null if not recorded")


class LoopStatus(BaseModel):
    """How late the event loop is, over the last 20 s: everything that steers and shows goes through it."""

    late_p50_ms: float = Field(examples=[0.6])
    late_p99_ms: float = Field(examples=[4.1])
    late_worst_ms: float = Field(examples=[11.8])


class Status(BaseModel):
    """Everything at a glance; lengths in metres, angles in radians, times in seconds since the session's start."""

    t: float = Field(examples=[61.32])
    version: str = Field(examples=["0.1.0"])
    session: SessionStatus
    recording: str | None = Field(examples=["recordings/run-20260101-120000.rlog"])
    link: LinkStatus
    robot: RobotStatus
    map: MapStatus
    filter: FilterStatus
    driver: DriverStatus
    stops: list[StopEntry] = Field(description="the newest 20, newest first")
    loop: LoopStatus


class Profile(BaseModel):
    """Nodes of the particles' tree at each vertex, per particle, and the deepest vertex with one node."""

    profile: list[float] = Field(examples=[[0.0005, 0.0005, 0.21, 1.0]])
    fixed_depth: int = Field(examples=[1])


def pose_view(snapshot: Snapshot, now: float) -> View:
    """Where the robot is and where it goes; `t` is the present, `age` how old the newest reading is."""
    return View(
        {
            "t": round(now, 4),
            "age": round(max(0.0, now - snapshot.t), 3),
            "pose": rounded(snapshot.pose),
            "odometry": rounded(snapshot.odometry),
            "tilt": finite(snapshot.tilt),
            "distance": round(float(snapshot.distance), 2),
            "goal": None if snapshot.goal is None else rounded(snapshot.goal),
        },
        {},
    )


@layer("histogram")
def histogram_view(snapshot: Snapshot) -> View | None:
    """The polar histogram, its valleys, the goal's bearing and the commanded one (Figure 3 of the thesis)."""
    if not len(snapshot.densities):
        return None
    return View(
        {
            "threshold": float(snapshot.threshold),
            "valleys": [rounded(valley) for valley in snapshot.valleys],
            "goal": finite(snapshot.goal_bearing),
            "steering": finite(snapshot.steering),
        },
        {"densities": np.asarray(snapshot.densities, np.float32)},
    )


@layer("local", every=4)
def local_view(snapshot: Snapshot) -> View | None:
    """The local map as occupancy of 0 to 255, what the sensors saw last, and the walls (Figure 2 of the thesis).

    `cells` is deflated (zlib's format): rows of `shape`, y upwards.
    """
    if not snapshot.local_map.size:
        return None
    cells = probabilities(snapshot.local_map)
    beams: dict[str, dict[str, float]] = {}
    arrays: dict[str, np.ndarray] = {"cells": np.frombuffer(zlib.compress(cells.tobytes(), 6), np.uint8)}
    for sensor, beam in snapshot.beams.items():
        beams[sensor] = {"half_angle": float(beam["half_angle"]), "max_range": float(beam["max_range"])}
        for name in ("bearings", "offsets", "ranges"):
            arrays[f"{sensor}.{name}"] = np.broadcast_to(np.asarray(beam[name], np.float32), np.shape(beam["bearings"]))
    arrays |= pack_curves(snapshot.curves)
    return View(
        {
            "resolution": float(snapshot.local_resolution),
            "origin": rounded(snapshot.local_origin),
            "odometry": rounded(snapshot.local_pose),
            "shape": cells.shape,
            "scale": CENTIMETRE,
            "beams": beams,
        },
        arrays,
    )


@layer("path")
def path_view(snapshot: Snapshot) -> View:
    """The best path with how certain each vertex is; the walls seen from it come as tiles.

    `profile` and `spread` (m) have a number for each vertex; `spread` is empty where that is not known. Before the
    first vertex all are empty.
    """
    n_vertices = len(snapshot.vertex_curves)  # a path without them is only where the robot stands
    return View(
        {"fixed_depth": int(snapshot.fixed_depth), "n_particles": int(snapshot.n_particles)},
        {
            "path": np.asarray(snapshot.path, np.float32).reshape(-1, 3)[:n_vertices],
            "profile": np.asarray(snapshot.profile, np.float32)[:n_vertices],
            "spread": np.asarray(snapshot.spread, np.float32)[:n_vertices],
        },
    )


@layer("odometry", every=10)
def odometry_view(snapshot: Snapshot) -> View | None:
    """Where the wheels alone have each vertex, laid on the best path's first one, in centimetres from it.

    None for a robot that shows all of its movements instead.
    """
    if snapshot.felt is not None:
        return None
    vertices = np.asarray(snapshot.vertex_odometry, float).reshape(-1, 3)
    first = np.asarray(snapshot.path, float)[0] if len(vertices) else np.zeros(3)
    laid = compose(first, between(vertices[:1], vertices))
    return View({"origin": rounded(first[:2]), "scale": CENTIMETRE}, {"points": pack_points(laid[:, :2] - first[:2])})


@layer("particles")
def particles_view(snapshot: Snapshot) -> View:
    """Where the particles have the newest vertex, in centimetres from `origin`; none before the first vertex.

    Of a robot that feels its way they come finer, and with `headings` (n,) in 256ths of a turn.
    """
    poses = np.asarray(snapshot.particles, float).reshape(-1, 3)[: None if snapshot.vertex_curves else 0]
    origin = np.round(poses[:, :2].mean(axis=0), 2) if len(poses) else np.zeros(2)
    places = poses[:, :2] - origin
    if snapshot.felt is None:
        return View({"origin": rounded(origin), "scale": CENTIMETRE}, {"points": pack_points(places)})
    unit = fine_unit(places)
    headings = (np.round(poses[:, 2] * (128.0 / math.pi)).astype(int) % 256).astype(np.uint8)
    return View({"origin": rounded(origin), "scale": unit}, {"points": pack_points(places, unit), "headings": headings})


def probabilities(log_odds: np.ndarray) -> np.ndarray:
    """Log odds as occupancy of 0 (free) to 255 in 5 steps on either side of 128, which is unknown."""
    certainty = np.tanh(0.5 * log_odds)
    return (128.0 + np.round(5.0 * certainty) * (127.0 / 5.0)).astype(np.uint8)


def path_length(path: np.ndarray) -> float:
    """Metres along a path (n, 3)."""
    return float(np.hypot(*np.diff(path[:, :2], axis=0).T).sum()) if len(path) > 1 else 0.0


def rounded(values: Any) -> list[float]:
    """Numbers to a tenth of a millimetre, as JSON has them."""
    return [round(float(value), 4) for value in values]


def finite(value: float | None) -> float | None:
    """None for what JSON cannot say."""
    return None if value is None or not math.isfinite(value) else round(float(value), 4)
