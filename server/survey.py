"""A survey: all that a robot found out about a building, as it is kept. Every file and picture of a map comes from it.

It holds the best path, what each vertex saw, and when and where odometry had it. A frame (x, y, theta) is the pose, in
the robot's own world, of the axes that a person chose for the map; the survey itself never changes. Uses its sibling
`maps`.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from server.formats.ros_map import OccupancyMap
from server.maps import FloorMap, occupancy, swept_map, world_curves
from server.messages import Label, Snapshot
from slam.motion import MotionParams
from slam.pose import between, inverse, transform
from slam.wall_direction import wall_direction
from slam.walls import Walls

FORMAT = "crunch-survey-1"


class SurveyError(ValueError):
    """Bytes that are no survey."""


@dataclass(frozen=True, eq=False)
class Survey:
    """n vertices: `path` (n, 3) in the world, `walls` seen there, `times` (n,) s, `odometry` (n, 3), tree's `profile`.

    `spread` (n,) m is the standard deviation of each vertex, empty where that is not known. The first `fixed_depth + 1`
    vertices are settled. `noise` is odometry's, in rad and m per root metre. `drawn` are curves (k, 2) of a map
    that is not what the vertices saw, as that of a robot which only bumps.
    """

    robot: str
    path: np.ndarray
    walls: Sequence[Walls]
    times: np.ndarray
    odometry: np.ndarray
    profile: np.ndarray
    fixed_depth: int = 0
    n_particles: int = 0
    noise: tuple[float, float] = (MotionParams().turn_noise, MotionParams().distance_noise)
    spread: np.ndarray = field(default_factory=lambda: np.zeros(0))
    drawn: tuple[np.ndarray, ...] | None = None

    @property
    def settled(self) -> int:
        """How many first vertices the particles of the island that is told share."""
        return min(self.fixed_depth + 1, len(self.path))


def survey_of(snapshot: Snapshot, motion: MotionParams | None = None) -> Survey:
    """What the robot has found out so far; without vertices before the first estimate."""
    n = len(snapshot.observations)
    noise = motion or MotionParams()
    return Survey(
        robot=snapshot.robot,
        path=np.array(snapshot.path[:n], float).reshape(-1, 3),
        walls=tuple(snapshot.observations),
        times=snapshot.vertex_times,
        odometry=snapshot.vertex_odometry,
        profile=np.asarray(snapshot.profile[:n], float),
        fixed_depth=-1 if snapshot.felt else snapshot.fixed_depth,  # nothing of what bumps tell is settled
        n_particles=snapshot.n_particles,
        noise=(noise.turn_noise, noise.distance_noise),
        spread=np.asarray(snapshot.spread[:n], float),
        drawn=tuple(snapshot.walls) if snapshot.felt else None,
    )


def titled(robot: str) -> str:
    """A robot's name as people write it: Bumper Cart for bumper_cart."""
    return robot.replace("_", " ").title()


def in_frame(survey: Survey, frame: np.ndarray) -> Survey:
    """The same survey with its world's axes laid where a frame (3,) stands in it."""
    frame = np.asarray(frame, float)
    drawn = survey.drawn and tuple(transform(inverse(frame), curve) for curve in survey.drawn)
    return replace(survey, path=between(frame, survey.path), drawn=drawn)


def labels_in_frame(labels: Sequence[Label], frame: np.ndarray) -> tuple[Label, ...]:
    """Labels of the world, in a frame (3,) of it."""
    return moved_labels(labels, inverse(np.asarray(frame, float)))


def labels_from_frame(labels: Sequence[Label], frame: np.ndarray) -> tuple[Label, ...]:
    """Labels of a frame (3,), in the world that it stands in."""
    return moved_labels(labels, np.asarray(frame, float))


def moved_labels(labels: Sequence[Label], pose: np.ndarray) -> tuple[Label, ...]:
    """Labels transformed by a pose (3,)."""
    places = [transform(pose, np.array([label.x, label.y])) for label in labels]
    return tuple(replace(label, x=float(x), y=float(y)) for label, (x, y) in zip(labels, places, strict=True))


def floor_of(survey: Survey, labels: Sequence[Label] = (), has_grid: bool = True) -> FloorMap:
    """The survey's map; without a grid it is made at once."""
    grid = grid_of(survey) if has_grid else None
    walls = world_curves(survey.path, list(survey.walls)) if survey.drawn is None else list(survey.drawn)
    return FloorMap(survey.path, walls, survey.settled, grid, labels=labels, spread=survey.spread)


def grid_of(survey: Survey) -> OccupancyMap:
    """The survey's grid; of a map that was drawn it has the walls, for what its vertices saw free nobody kept."""
    if survey.drawn is None:
        return occupancy(survey.path, list(survey.walls))
    return swept_map(survey.path, list(survey.drawn), 0.0, 0.0)


def wall_skew(survey: Survey) -> float:
    """The building's main wall direction against the axes, from -45 to 45 degrees, in radians."""
    if survey.drawn is not None:
        steps = np.concatenate([np.zeros((0, 2)), *(np.diff(curve, axis=0) for curve in survey.drawn)])
        lengths, directions = np.hypot(*steps.T), np.arctan2(steps[:, 1], steps[:, 0])
        return float(np.angle(np.sum(lengths * np.exp(4j * directions)))) / 4.0
    pairs = zip(survey.path[:, 2], survey.walls, strict=True)
    votes = sum((wall_direction(walls) * np.exp(4j * theta) for theta, walls in pairs), 0j)
    return float(np.angle(votes)) / 4.0


def pack(survey: Survey) -> bytes:
    """The survey as bytes: numpy's compressed archive."""
    n_rays = len(survey.walls[0].distances) if survey.walls else 0
    drawn = {} if survey.drawn is None else {"drawn": np.concatenate([np.zeros((0, 2)), *survey.drawn])}
    if survey.drawn is not None:
        drawn["lengths"] = np.array([len(curve) for curve in survey.drawn], int)
    content = io.BytesIO()
    np.savez_compressed(
        content,
        allow_pickle=False,
        format=np.array(FORMAT),
        robot=np.array(survey.robot),
        path=survey.path,
        distances=np.array([seen.distances for seen in survey.walls], np.float32).reshape(len(survey.walls), n_rays),
        free=np.array([seen.free for seen in survey.walls], np.float32).reshape(len(survey.walls), n_rays),
        times=survey.times,
        odometry=survey.odometry,
        profile=survey.profile,
        spread=survey.spread,
        tree=np.array([survey.fixed_depth, survey.n_particles]),
        noise=np.array(survey.noise),
        **drawn,
    )
    return content.getvalue()


def unpack(content: bytes) -> Survey:
    """The survey in bytes that `pack` made; SurveyError for others."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            if str(arrays["format"]) != FORMAT:
                raise SurveyError(f"its format is {arrays['format']}, not {FORMAT}")
            drawn = None
            if "drawn" in arrays:
                drawn = tuple(np.split(arrays["drawn"], np.cumsum(arrays["lengths"]))[:-1])
            walls = [Walls(*rays) for rays in zip(arrays["distances"], arrays["free"], strict=True)]
            return Survey(
                robot=str(arrays["robot"]),
                path=arrays["path"],
                walls=[Walls(seen.distances.astype(float), seen.free.astype(float)) for seen in walls],
                times=arrays["times"],
                odometry=arrays["odometry"],
                profile=arrays["profile"],
                fixed_depth=int(arrays["tree"][0]),
                n_particles=int(arrays["tree"][1]),
                noise=(float(arrays["noise"][0]), float(arrays["noise"][1])),
                spread=arrays["spread"],
                drawn=drawn,
            )
    except (EOFError, KeyError, OSError, ValueError, zipfile.BadZipFile) as error:
        raise SurveyError(str(error)) from None
