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

from server.maps import FloorMap, occupancy, world_curves
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
    vertices are settled. `noise` is odometry's, in rad and m per root metre.
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
        fixed_depth=snapshot.fixed_depth,
        n_particles=snapshot.n_particles,
        noise=(noise.turn_noise, noise.distance_noise),
        spread=np.asarray(snapshot.spread[:n], float),
    )


def in_frame(survey: Survey, frame: np.ndarray) -> Survey:
    """The same survey with its world's axes laid where a frame (3,) stands in it."""
    return replace(survey, path=between(np.asarray(frame, float), survey.path))


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
    grid = occupancy(survey.path, list(survey.walls)) if has_grid else None
    walls = world_curves(survey.path, list(survey.walls))
    return FloorMap(survey.path, walls, survey.settled, grid, labels=labels, spread=survey.spread)


def wall_skew(survey: Survey) -> float:
    """The building's main wall direction against the axes, from -45 to 45 degrees, in radians."""
    pairs = zip(survey.path[:, 2], survey.walls, strict=True)
    votes = sum((wall_direction(walls) * np.exp(4j * theta) for theta, walls in pairs), 0j)
    return float(np.angle(votes)) / 4.0


def pack(survey: Survey) -> bytes:
    """The survey as bytes: numpy's compressed archive."""
    n_rays = len(survey.walls[0].distances) if survey.walls else 0
    content = io.BytesIO()
    np.savez_compressed(
        content,
        allow_pickle=False,
        format=np.array(FORMAT),
        robot=np.array(survey.robot),
        path=survey.path,
        distances=np.array([seen.distances for seen in survey.walls], np.float32).reshape(-1, n_rays),
        free=np.array([seen.free for seen in survey.walls], np.float32).reshape(-1, n_rays),
        times=survey.times,
        odometry=survey.odometry,
        profile=survey.profile,
        spread=survey.spread,
        tree=np.array([survey.fixed_depth, survey.n_particles]),
        noise=np.array(survey.noise),
    )
    return content.getvalue()


def unpack(content: bytes) -> Survey:
    """The survey in bytes that `pack` made; SurveyError for others."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            if str(arrays["format"]) != FORMAT:
                raise SurveyError(f"its format is {arrays['format']}, not {FORMAT}")
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
            )
    except (EOFError, KeyError, OSError, ValueError, zipfile.BadZipFile) as error:
        raise SurveyError(str(error)) from None
