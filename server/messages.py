"""What a robot is told and what it answers: typed, frozen, SI units and radians, each with its time in host seconds.

Nothing here knows a byte format, a robot or a file. What the boards are told is in its sibling `commands`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from server.commands import ArmCommand, DriveCommand, PowersCommand, RunCommand, StopCommand, UploadCommand
from slam.bumps import Band
from slam.cart_odometry import Stage
from slam.pose_clusters import Belief
from slam.uncertainty import Branches
from slam.walls import Walls


@dataclass(frozen=True, slots=True)
class Wheels:
    """Wheel rotations against the body as distances rolled (m), counted modulo `wrap`, and the body's tilt (rad)."""

    t: float
    left: float
    right: float
    tilt: float
    wrap: float


@dataclass(frozen=True, slots=True)
class Odometry:
    """Pose (x, y, theta) in the odometry frame, for robots and logs that integrate their own motion."""

    t: float
    x: float
    y: float
    theta: float


@dataclass(frozen=True, slots=True, eq=False)
class Ranges:
    """One sweep of one kind of rangefinder (`sensor` names it): metres; inf is no return, nan was not measured."""

    t: float
    sensor: str
    ranges: np.ndarray


@dataclass(frozen=True, slots=True)
class Balance:
    """How the drive board does: tilt rate (rad/s), position error (m), duties in -1..1, state, last stop's reason."""

    t: float
    tilt_rate: float
    position_error: float
    left_duty: float
    right_duty: float
    state: str
    reason: str
    acknowledged: int


@dataclass(frozen=True, slots=True)
class Power:
    """Volts and amperes of battery, charger and the two motors."""

    t: float
    battery_volts: float
    battery_amperes: float
    charger_volts: float
    charger_amperes: float
    left_motor_amperes: float
    right_motor_amperes: float


@dataclass(frozen=True, slots=True)
class Motors:
    """What the motor board gives its motors now (powers in -1..1, shares of full), its battery (V), state, last stop's
    reason."""

    t: float
    left: float
    right: float
    battery_volts: float
    state: str
    reason: str
    acknowledged: int


@dataclass(frozen=True, slots=True)
class Cart:
    """How the bumper cart does: its counters (ticks, which wrap at 65,536), battery (V), what it is doing, and why it
    stood last.

    `logged` stages and `bumps` are of the run, which is the board's `run`-th since it was switched on, modulo 256;
    `bumper` has the bits of `slam.cart_odometry`.
    """

    t: float
    left: int
    right: int
    battery_volts: float
    logged: int
    bumps: int
    doing: str
    bumper: int
    run: int
    state: str
    reason: str
    acknowledged: int


@dataclass(frozen=True, slots=True)
class CartStage:
    """A stage that the bumper cart logged, by its number in a run; `is_kept` where it was told again from the log.

    The time is when it was told: of a stage that was not told again that is when it ended.
    """

    t: float
    run: int
    number: int
    stage: Stage
    is_kept: bool = False


@dataclass(frozen=True, slots=True)
class MouseCounts:
    """What one of the optical mice counted since it was last heard: to its right (x) and ahead (y).

    Not `is_whole` where some of it was lost on the way.
    """

    t: float
    mouse: int
    x: int
    y: int
    is_whole: bool = True


@dataclass(frozen=True, slots=True)
class Status:
    """A board's once-a-second word about itself; `board` is 'drive', 'sensor' or 'motor'; uptime, worst loop in s."""

    t: float
    board: str
    version: int
    state: str
    reason: str
    reset_cause: int
    uptime: float
    boot_count: int
    worst_loop: float
    rx_errors: int
    build: int


@dataclass(frozen=True, slots=True)
class Setting:
    """A board's answer to an adjustment: what came of it, and the setting's value in force.

    `sequence` is the adjustment's own number; `record` is how the settings in the EEPROM are, `is_stored` whether they
    hold this value. The value that answers `zero gyro` is the gyro's zero (rad/s).
    """

    t: float
    board: str
    verb: str
    setting: str
    sequence: int
    outcome: str
    record: str
    is_stored: bool
    value: float


@dataclass(frozen=True, slots=True)
class LastWords:
    """How the drive board's run ended that its last reset cut off: state, reason, and its uptimes (s) since when and
    at the end."""

    t: float
    state: str
    reason: str
    since: float
    uptime: float


@dataclass(frozen=True, slots=True)
class Drive:
    """A person's wish: forward speed (m/s) and turn rate (rad/s); `shared` lets the histogram bend it off obstacles."""

    t: float
    speed: float
    turn: float
    shared: bool = False


@dataclass(frozen=True, slots=True)
class Goal:
    """Where to steer with the vector field histogram, in the world frame (m); None clears it.

    `route` are places to pass on the way, in order; empty is straight on.
    """

    t: float
    place: tuple[float, float] | None
    speed: float = 0.3
    route: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Stop:
    """Stand still now, whoever drives."""

    t: float


@dataclass(frozen=True, slots=True)
class Arm:
    """Let the drive board arm (or disarm it)."""

    t: float
    armed: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The path filter's answer after a vertex.

    All but the figures of `n_particles`, `effective_particles` and `resamplings` is of the island that is told. `path`
    is (n_vertices, 3), the best particle's poses in the world, refined if that is not switched off; `profile` is
    (n_vertices,), nodes at each depth divided by particles; `particles` is (m, 3), some of the newest poses; affinity
    and plausibility are the best particle's sums. `spread` (n_vertices,) is the standard deviation (m) of each vertex
    in the world, `revisit_spread` the same as seen from the newest vertex: what seeing the place again would settle.
    Both are empty where they are not known, and `branches` is None where an estimator has no particles. `belief` tells
    where on a given map the robot may be, and `walls` are curves (k, 2) of a map that is not what the vertices saw.
    """

    t: float
    path: np.ndarray
    profile: np.ndarray
    particles: np.ndarray
    fixed_depth: int
    n_particles: int
    effective_particles: float
    resamplings: int
    affinity: float
    plausibility: float
    spread: np.ndarray = field(default_factory=lambda: np.zeros(0))
    revisit_spread: np.ndarray = field(default_factory=lambda: np.zeros(0))
    branches: Branches | None = None
    belief: Belief | None = None
    walls: list[np.ndarray] | None = None


@dataclass(frozen=True, slots=True)
class MiceHealth:
    """Steps of an odometry by mice, those that the motors' filled in, and of each mouse those that left it out."""

    steps: int
    filled_in: int
    left_out: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Felt:
    """What there is of a robot that runs by itself and knows nothing but its bumps.

    `track` (n, 2) are its movements added end to end, `bumpers` (m, 3, 2) its bumper's left, middle and right points at
    each bump on it, and `laid` (3,) is the pose of both in the world. `lost` stages of the run will never come. Where a
    map was given, `bump_space` is where it may bump there.
    """

    track: np.ndarray
    bumpers: np.ndarray
    laid: np.ndarray
    lost: int
    bump_space: Band | None = None


@dataclass(frozen=True, slots=True)
class Label:
    """A name that somebody gave to a place (m, world)."""

    id: int
    text: str
    x: float
    y: float


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """Effect: a vertex for the estimator.

    `pose` (3,) in the odometry frame, `walls` what was seen there, or felt: the bumper cart's are the stages since the
    vertex before. `travelled` m of path since then.
    """

    t: float
    index: int
    pose: np.ndarray
    walls: Any  # Walls, or (Stage, ...)
    travelled: float


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """What a viewer needs of a robot; the newest replaces the older. Poses are (x, y, theta)."""

    t: float
    robot: str
    pose: np.ndarray  # (3,) best estimate now, world
    odometry: np.ndarray  # (3,) now, odometry frame
    tilt: float  # rad; nan for a robot that cannot tilt
    distance: float  # m driven since the start
    local_map: np.ndarray  # (n, n) float32 log odds; row = y, column = x
    local_resolution: float  # m per cell
    local_origin: np.ndarray  # (2,) of cell (0, 0)'s corner in the map's frame: the odometry's, or one that moves along
    local_pose: np.ndarray  # (3,) of the robot in that frame
    beams: dict[str, dict]  # sensor -> bearings, offsets (m, along the bearing), half_angle, max_range, ranges
    curves: list[np.ndarray]  # extracted wall curves now, each (k, 2), robot frame
    densities: np.ndarray  # (sectors,) polar histogram, sector 0 forward in the robot frame
    threshold: float
    valleys: list[tuple[float, float]]  # (start, end) bearings, counter-clockwise, robot frame
    goal: tuple[float, float] | None  # world
    goal_bearing: float | None  # robot frame
    steering: float | None  # commanded bearing, robot frame
    path: np.ndarray  # (n, 3) best path, world
    walls: list[np.ndarray]  # wall curves of the best map, each (k, 2), world
    vertex_curves: list[list[np.ndarray]]  # of each vertex's walls, each (k, 2), in the vertex's frame; never change
    observations: list[Walls]  # what each vertex saw; never change
    vertex_times: np.ndarray  # (n,) when each of them was made
    vertex_odometry: np.ndarray  # (n, 3) where, in the odometry frame
    profile: np.ndarray
    fixed_depth: int
    particles: np.ndarray  # (m, 3)
    n_particles: int
    effective_particles: float
    resamplings: int
    affinity: float
    plausibility: float
    balance: Balance | None = None
    looked: float = -math.inf  # s, when the newest sweep came; what is older than a moment is nothing to drive by
    power: Power | None = None
    motors: Motors | None = None
    cart: Cart | None = None
    mice: MiceHealth | None = None  # where the odometry is theirs
    battery_limits: tuple[float, float] = (26.4, 24.0)  # V from which down it is low, and empty
    fastest: tuple[float, float] = (math.inf, math.inf)  # m/s and rad/s that the robot goes at most
    boards: dict[str, Status] = field(default_factory=dict)
    last_words: LastWords | None = None
    route: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))  # places to pass on the way to the goal, world
    spread: np.ndarray = field(default_factory=lambda: np.zeros(0))  # as in Estimate
    revisit_spread: np.ndarray = field(default_factory=lambda: np.zeros(0))
    branches: Branches | None = None
    belief: Belief | None = None
    felt: Felt | None = None
    labels: tuple[Label, ...] = ()


Message = (
    Wheels
    | Odometry
    | Ranges
    | Balance
    | Power
    | Motors
    | Cart
    | CartStage
    | MouseCounts
    | Status
    | LastWords
    | Setting
    | Drive
    | Goal
    | Stop
    | Arm
    | Estimate
)
Effect = DriveCommand | StopCommand | ArmCommand | PowersCommand | RunCommand | UploadCommand | Keyframe


def nothing_known(t: float, pose: np.ndarray, n_particles: int) -> Estimate:
    """The estimate before the filter's first answer."""
    return Estimate(
        t, np.asarray(pose, float)[None], np.ones(1), np.asarray(pose, float)[None], 0, n_particles, float(n_particles),
        0, 0.0, 0.0,
    )  # fmt: skip


def shown_of(estimate: Estimate) -> dict[str, Any]:
    """What a snapshot repeats of an estimate: all but its time and its walls."""
    return {part.name: getattr(estimate, part.name) for part in fields(estimate) if part.name not in ("t", "walls")}
