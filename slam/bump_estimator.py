"""What takes up a bumper cart's vertices: where it is on a known map, or the map of an area that nobody knows.

Each vertex is a bump, and is seen as the stages (`slam.cart_odometry`) since the one before. Uses its siblings
`bump_localizer`, `bump_mapper`, and `path_filter`, for what an estimate is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slam.area import Area
from slam.bump_localizer import BumpLocalizer, BumpLocalizerParams, Estimate
from slam.bump_mapper import BumpMap, BumpMapper, BumpMapperParams
from slam.cart_odometry import CartParams, Stage
from slam.path_filter import PathEstimate
from slam.pose import compose
from slam.pose_clusters import Belief
from slam.resampling import normalize, systematic
from slam.uncertainty import MIDDLE, NOT_KNOWN, Uncertainty


class LocalizedCart:
    """A cart on a map: poses lie in the map's frame from the first bump on that some place there explains."""

    def __init__(self, area: Area, cart: CartParams, params: BumpLocalizerParams, seed: int = 0):
        self.localizer = BumpLocalizer(area, cart, params, seed)
        self.path: list[np.ndarray] = []
        self.beliefs: list[Belief] = []  # after each bump, as it was then
        self.bumps: list[int] = []  # the localizer's at each vertex, counted from 0; -1 where there was none
        self.found: Estimate | None = None  # after the newest bump

    @property
    def n_particles(self) -> int:
        """How many particles there are now; there are as many as their spread needs."""
        return max(1, len(self.localizer.poses))

    def extend(self, pose: np.ndarray, stages: Sequence[Stage], travelled: float) -> None:
        """Add a bump: the pose (3,) that was reckoned, the stages since the one before, and m driven in them."""
        before = self.localizer.hits
        for stage in stages:
            self.localizer.step(stage)
        self.bumps.append(self.localizer.hits - 1 if self.localizer.hits > before else -1)
        self.found = self.localizer.estimate()
        self.path.append(np.array(pose, float) if self.found is None else self.found.pose)
        self.beliefs.append(Belief(self.found.clusters, self.found.is_localized) if self.found else Belief([], False))

    def estimate(self, max_particles: int = 500) -> PathEstimate:
        """The heaviest cluster's mean after each bump, as it was then until the run is over; then as of all of it.

        RuntimeError before the first bump.
        """
        if not self.path:
            raise RuntimeError("no bump was told yet")
        found, shown = self.found, self.shown(max_particles)
        path = np.array(self.path)
        share = found.clusters[0].share if found and found.clusters else 0.0
        return PathEstimate(
            path, np.ones(len(path)), shown if len(shown) else path[-1:], len(path) - 1, self.n_particles,
            found.effective if found else 1.0, 0, share, 0.0, self.beliefs[-1],
        )  # fmt: skip

    def shown(self, n: int) -> np.ndarray:
        """At most n of the particles (m, 3), drawn by their weights, at all of their images on a symmetric map."""
        localizer = self.localizer
        if not len(localizer.poses):
            return np.zeros((0, 3))
        images = localizer.symmetries
        rows = systematic(normalize(localizer.log_weights), MIDDLE, min(n // len(images), len(localizer.poses)))
        return np.concatenate([compose(motion, localizer.poses[rows]) for motion in images])

    def uncertainty(self, n_leaves: int) -> Uncertainty:
        """Not told of poses that are gone; the clusters' covariances are of now."""
        return NOT_KNOWN

    def resize(self, n_particles: int) -> None:
        """Nothing: as many as the spread needs are taken."""

    def conclude(self) -> None:
        """The run is over: the path is that of the particles which are left, as far back as they began."""
        smoothed = self.localizer.path()
        for vertex, bump in enumerate(self.bumps):
            if bump >= 0 and np.isfinite(smoothed[bump, 0]):
                self.path[vertex] = smoothed[bump]


class MappedCart:
    """A cart in an area that it maps; poses lie in the frame of the first one."""

    def __init__(self, cart: CartParams, params: BumpMapperParams, seed: int = 0):
        self.mapper = BumpMapper(cart, params, seed)
        self.known: BumpMap | None = None

    @property
    def n_particles(self) -> int:
        """How many particles there are."""
        return self.mapper.params.n_particles

    def extend(self, pose: np.ndarray, stages: Sequence[Stage], travelled: float) -> None:
        """Add a bump, as with a `LocalizedCart`."""
        for stage in stages:
            self.mapper.add(stage)
        self.known = None

    def map(self) -> BumpMap:
        """Path and walls as they are known now."""
        self.known = self.known or self.mapper.estimate()
        return self.known

    def estimate(self, max_particles: int = 500) -> PathEstimate:
        """The path of the particle that explained the run best. RuntimeError before the first bump."""
        if not self.mapper.n_drives:
            raise RuntimeError("no bump was told yet")
        found, poses = self.map(), self.mapper.swarm.poses
        path = found.path[found.is_bump]
        shown = np.linspace(0, len(poses) - 1, min(max_particles, len(poses))).astype(int)
        return PathEstimate(
            path, np.ones(len(path)), poses[shown], len(path) - 1, self.n_particles, self.mapper.effective_particles, 0,
            -found.cost, 0.0, walls=found.walls,
        )  # fmt: skip

    def uncertainty(self, n_leaves: int) -> Uncertainty:
        """Not known of a map from bumps."""
        return NOT_KNOWN

    def resize(self, n_particles: int) -> None:
        """Nothing: the map needs what it has."""

    def conclude(self) -> None:
        """The run is over: refine the best paths and their walls together."""
        self.known = self.mapper.refine()
