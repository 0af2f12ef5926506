"""How good a trajectory or a map is: ATE, RPE, the relations metric, closed loops, agreement with a grid.

Trajectories are poses (n, 3) in metres and radians; `slam.timeline` finds which rows of two recordings belong together.
Errors inside are in m and rad; `to_dict` gives m and degrees, with None for what no sample decides, ready for JSON.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from slam.distance_field import distance_field
from slam.grid import Grid
from slam.pose import between, compose, transform, wrap
from slam.timeline import interpolate


@dataclass(frozen=True)
class Spread:
    """Statistics of n absolute errors; `std` is the population's. All nan where n is 0."""

    n: int
    rmse: float
    mean: float
    median: float
    std: float
    p90: float
    max: float

    @classmethod
    def of(cls, errors: np.ndarray) -> Spread:
        """Spread of errors (n,), all at least 0."""
        if errors.size == 0:
            return cls(0, *[math.nan] * 6)
        rmse = math.sqrt(float(np.mean(np.square(errors))))
        mean, std = float(np.mean(errors)), float(np.std(errors))
        median, p90 = (float(quantile) for quantile in np.quantile(errors, [0.5, 0.9]))
        return cls(errors.size, rmse, mean, median, std, p90, float(np.max(errors)))

    def to_dict(self, unit: float = 1.0) -> dict[str, float | int | None]:
        """Plain numbers, divided by the unit."""
        values = {name: getattr(self, name) / unit for name in ("rmse", "mean", "median", "std", "p90", "max")}
        return {"n": self.n} | {name: value if math.isfinite(value) else None for name, value in values.items()}


DEGREE = math.pi / 180.0
SAME_PLACE = 0.1  # m along a wall within which two points of it are compared


@dataclass(frozen=True)
class PoseErrors:
    """Errors of translation (m) and rotation (rad) over the same samples, and how many were offered."""

    translation: Spread
    rotation: Spread
    n_offered: int

    @classmethod
    def of(cls, residuals: np.ndarray, n_offered: int | None = None) -> PoseErrors:
        """From poses (n, 3) that would be the identity if there were no error."""
        translation = Spread.of(np.hypot(residuals[:, 0], residuals[:, 1]))
        rotation = Spread.of(np.abs(wrap(residuals[:, 2])))
        return cls(translation, rotation, len(residuals) if n_offered is None else n_offered)

    def to_dict(self) -> dict:
        """Translation in m, rotation in degrees."""
        return {
            "n": self.translation.n,
            "n_offered": self.n_offered,
            "translation_m": self.translation.to_dict(),
            "rotation_deg": self.rotation.to_dict(DEGREE),
        }


def path_length(poses: np.ndarray) -> np.ndarray:
    """Length (n,) in m of the way to each pose."""
    steps = np.diff(poses[:, :2], axis=0)
    return np.concatenate([np.zeros(min(1, len(poses))), np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])


def alignment(points: np.ndarray, reference_points: np.ndarray) -> np.ndarray:
    """Pose (3,) that moves points (n, 2) as near to their references (n, 2) as squares can measure.

    Umeyama 1991 in the plane and without scale, where the best rotation has a closed form; what evo calls `align` gives
    the same. Points without extent leave the rotation open: it is 0. Raises ValueError for no points.
    """
    if len(points) == 0:
        raise ValueError("no poses to align")
    centre, reference_centre = points.mean(axis=0), reference_points.mean(axis=0)
    a, b = points - centre, reference_points - reference_centre
    theta = math.atan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    x, y = reference_centre - transform(np.array([0.0, 0.0, theta]), centre)
    return np.array([x, y, theta])


def absolute_error(poses: np.ndarray, reference: np.ndarray, is_aligned: bool = True) -> PoseErrors:
    """ATE: distances between matched poses, each (n, 3), after SE(2) alignment of the positions unless told not to."""
    if is_aligned:
        poses = compose(alignment(poses[:, :2], reference[:, :2]), poses)
    return PoseErrors.of(between(reference, poses))


def relative_error(
    poses: np.ndarray,
    reference: np.ndarray,
    step: float = 1.0,
    by: Literal["rows", "metres"] = "metres",
    all_pairs: bool = False,
) -> PoseErrors:
    """RPE: error of the motion over each `step` rows, or metres of the reference's path, between matched poses (n, 3).

    Steps follow each other without overlap, as in evo; with `all_pairs` one begins at every row.
    """
    first, second = step_pairs(reference, step, by, all_pairs)
    motion = between(poses[first], poses[second])
    return PoseErrors.of(between(between(reference[first], reference[second]), motion))


def step_pairs(reference: np.ndarray, step: float, by: str, all_pairs: bool) -> tuple[np.ndarray, np.ndarray]:
    """First and second rows of the steps; a step in metres ends at the first row that is at least as far along."""
    if not step > 0.0 or (by == "rows" and step != int(step)):
        raise ValueError(f"a step must be positive, and whole if it counts rows, not {step}")
    n = len(reference)
    position = np.arange(n, dtype=float) if by == "rows" else path_length(reference)
    ends = np.searchsorted(position, position + step - 1e-9)
    if all_pairs:
        first = np.flatnonzero(ends < n)
        return first, ends[first]
    chain = [0]
    while chain[-1] < n and ends[chain[-1]] < n:
        chain.append(int(ends[chain[-1]]))
    return np.array(chain[:-1], np.int64), np.array(chain[1:], np.int64)


class Relations(NamedTuple):
    """Relative poses known by hand: `motions` (k, 3) from the pose at `first_times` (k,) to that at `second_times`."""

    first_times: np.ndarray
    second_times: np.ndarray
    motions: np.ndarray


def relations_error(
    times: np.ndarray, poses: np.ndarray, relations: Relations, offset: float = 0.0, max_gap: float = np.inf
) -> PoseErrors:
    """Absolute errors of the relative poses (Kuemmerle et al., Autonomous Robots 27, 2009, equation 2 and section 3).

    The trajectory (n,), (n, 3) is interpolated at the relations' times; relation time = trajectory time + offset. A
    relation with an end outside of the trajectory is offered but not used.
    """
    ends = np.concatenate([relations.first_times, relations.second_times]) - offset
    at_ends, is_known = interpolate(times, poses, ends, max_gap)
    first, second = np.split(at_ends, 2)
    used = np.logical_and(*np.split(is_known, 2))
    motions = between(first[used], second[used])
    return PoseErrors.of(between(relations.motions[used], motions), len(used))


@dataclass(frozen=True)
class Revisits:
    """Errors of the relative pose between true visits of one place, and whether they call the loop closed."""

    errors: PoseErrors

    @property
    def is_closed(self) -> bool:
        """Median under 0.35 m, 90th percentile under 1 m, heading's median under 5 degrees; never without a revisit."""
        translation, rotation = self.errors.translation, self.errors.rotation
        return translation.median < 0.35 and translation.p90 < 1.0 and rotation.median < 5.0 * DEGREE

    def to_dict(self) -> dict:
        """The errors, and `closed`."""
        return {"closed": self.is_closed} | self.errors.to_dict()


def revisits(poses: np.ndarray, reference: np.ndarray, max_distance: float = 0.4, min_path: float = 20.0) -> Revisits:
    """Compare matched poses (n, 3) with the truth wherever the truth came back to a place."""
    later, earlier = revisit_pairs(reference, max_distance, min_path)
    motions = between(poses[earlier], poses[later])
    return Revisits(PoseErrors.of(between(between(reference[earlier], reference[later]), motions)))


def revisit_pairs(
    reference: np.ndarray, max_distance: float, min_path: float, spacing: float = 0.25
) -> tuple[np.ndarray, np.ndarray]:
    """Rows (k,) of true revisits and the earlier rows (k,) that they come nearest to.

    A revisit lies less than `max_distance` from a place that was left at least `min_path` metres of the way ago. Rows
    are looked at every `spacing` metres, so that standing still counts once.
    """
    path = path_length(reference)
    rows = np.unique(np.searchsorted(path, np.arange(0.0, path[-1], spacing))) if len(path) else np.empty(0, np.int64)
    points, path = reference[rows, :2], path[rows]
    later, earlier = [], []
    for row in range(len(rows)):
        n_left = int(np.searchsorted(path, path[row] - min_path, side="right"))
        if n_left == 0:
            continue
        distances = np.hypot(*(points[:n_left] - points[row]).T)
        nearest = int(np.argmin(distances))
        if distances[nearest] < max_distance:
            later.append(rows[row])
            earlier.append(rows[nearest])
    return np.array(later, np.int64), np.array(earlier, np.int64)


def wrong_meetings(
    poses: np.ndarray, reference: np.ndarray, meeting: float = 0.4, elsewhere: float = 0.8, min_path: float = 5.0
) -> float:
    """Share of the meetings of a path (n, 3) with itself where the reference (n, 3), row by row, was at two places.

    A meeting: `poses` come within `meeting` m of where they were `min_path` m of the way before. At two places: more
    than `elsewhere` m apart. Rows of nan in the reference are not known and do not count.
    """
    later, earlier = revisit_pairs(poses, meeting, min_path)
    apart = np.hypot(*(reference[later, :2] - reference[earlier, :2]).T)
    apart = apart[np.isfinite(apart)]
    return float(np.mean(apart > elsewhere)) if len(apart) else 0.0


@dataclass(frozen=True)
class MapAgreement:
    """Share of wall points within `tolerance` m of a grid's walls, and the points' distances from them (m)."""

    n: int
    share: float
    tolerance: float
    median_distance: float

    def to_dict(self) -> dict:
        """Plain numbers."""
        distance = self.median_distance if math.isfinite(self.median_distance) else None
        share = self.share if math.isfinite(self.share) else None
        return {"n": self.n, "share": share, "tolerance_m": self.tolerance, "median_distance_m": distance}


def map_agreement(
    wall_points: np.ndarray, grid: Grid, tolerance: float = 0.15, wall_threshold: float = 0.6
) -> MapAgreement:
    """How well wall points (n, 2) in the grid's frame lie on its cells above `wall_threshold` log odds.

    Distances count between centres of cells. A point farther than the tolerance outside of the grid is infinitely far.
    """
    margin = math.ceil(tolerance / grid.resolution) + 1
    is_wall = np.pad(grid.cells > wall_threshold, margin)
    distances = np.full(len(wall_points), np.inf)
    columns, rows = (np.floor((wall_points - (grid.x, grid.y)) / grid.resolution).astype(np.int64) + margin).T
    inside = (rows >= 0) & (columns >= 0) & (rows < is_wall.shape[0]) & (columns < is_wall.shape[1])
    distances[inside] = distance_field(is_wall, grid.resolution)[rows[inside], columns[inside]]
    if distances.size == 0:
        return MapAgreement(0, math.nan, tolerance, math.nan)
    share = float(np.mean(distances <= tolerance + 1e-9))
    return MapAgreement(distances.size, share, tolerance, float(np.quantile(distances, 0.5, method="lower")))


def wall_spread(
    path: np.ndarray, curves: Sequence[Sequence[np.ndarray]], reach: float = 1.0, min_path: float = 20.0
) -> Spread:
    """How far apart (m) walls lie that were seen from one place on visits at least `min_path` m of the path apart.

    `path` (v, 3) are the vertices' poses, `curves[v]` what each saw, (k, 2) in its frame and counter-clockwise. A point
    counts once for every earlier visit: the way along its normal to the nearest wall that the visit's nearest vertex
    saw facing the same way to 25 degrees. Where there is none within `reach` it does not count: walls drawn twice and
    farther apart are missed.
    """
    seen = [wall_points(pose, found) for pose, found in zip(path, curves, strict=True)]
    way = path_length(path)
    distances = [np.empty(0)]
    for later in range(len(path)):
        points, normals = seen[later]
        n_left = int(np.searchsorted(way, way[later] - min_path, side="right"))
        for earlier in nearest_of_visits(np.hypot(*(path[:n_left, :2] - path[later, :2]).T), 2.0 * reach):
            others, other_normals = seen[earlier]
            apart = others[None, :, :] - points[:, None, :]
            across = np.abs(np.sum(apart * normals[:, None, :], axis=2))
            along = np.abs(apart[:, :, 0] * normals[:, None, 1] - apart[:, :, 1] * normals[:, None, 0])
            across[(along > SAME_PLACE) | (normals @ other_normals.T < math.cos(25.0 * DEGREE))] = np.inf
            distances.append(across.min(axis=1, initial=np.inf))
    found = np.concatenate(distances)
    return Spread.of(found[found < reach])


def nearest_of_visits(distances: np.ndarray, reach: float) -> list[int]:
    """The nearest row of each stretch of rows whose `distances` (n,) are below `reach`."""
    near = np.flatnonzero(distances < reach)
    visits = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1)
    return [int(visit[np.argmin(distances[visit])]) for visit in visits if len(visit)]


def wall_points(pose: np.ndarray, curves: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) in the world of curves seen from `pose` (3,), and the walls' normals (n, 2) there, towards it."""
    placed = [transform(pose, curve) for curve in curves if len(curve) > 1]
    if not placed:
        return np.empty((0, 2)), np.empty((0, 2))
    tangents = np.concatenate([np.gradient(curve, axis=0) for curve in placed])
    lengths = np.maximum(np.hypot(tangents[:, 0], tangents[:, 1]), 1e-12)
    return np.concatenate(placed), np.stack([-tangents[:, 1], tangents[:, 0]], axis=1) / lengths[:, None]
