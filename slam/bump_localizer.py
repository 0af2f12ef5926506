"""Where a cart with two rotation counters and a bumper is on a known map, from its bumps alone.

Monte Carlo localization as in Dye's paper, with weights in place of removal: each particle is driven until its wall and
weighs what the logged way is worth there. That some of the bumps come to a cart which was carried elsewhere is part of
the model: as many particles begin anew as that is then likely, so that a belief which no longer explains its bumps is
given up by the same rule that keeps a good one. Before a cart is called localized others that know nothing yet judge
the same stages, so that a place is not sure only because the true one was lost. Uses its siblings `area`,
`bump_ancestry`, `bump_particles`, `cart_odometry`, `counter_random`, `motion`, `pose_clusters` and `resampling`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from slam.area import Area, symmetries
from slam.bump_ancestry import NOBODY, Ancestry
from slam.bump_particles import Leg, Touch, drive_free, drive_to_wall, move, start_anywhere
from slam.cart_odometry import DRIVE, CartParams, Stage, turn_variance, way_variance
from slam.counter_random import bits, uniform, vertex_key
from slam.motion import draw_biases
from slam.params import Params
from slam.pose import compose
from slam.pose_clusters import Cluster, bins_of, clusters, enough_particles, within
from slam.resampling import effective_particles, normalize, systematic

KINDS = 5
MOVES, STARTS, PROBES, CHILDREN, OTHERS = range(KINDS)  # what is drawn at a stage, each with a vertex of its own
SCALES = 1 << 20  # a stream of random numbers beyond those of `bump_particles`
N_PROBES = 200  # poses that tell how likely a drive is of a cart that may be anywhere
LONGEST = 240  # stages that others judge, at most
ANOTHER = 0.2  # probability of having been carried elsewhere from which a belief counts as another one
MEMORY = 0.95  # of a particle's wheelbase from bump to bump: what wheels roll on changes with floor and load


class BumpLocalizerParams(Params):
    """Parameters of the filter; the cart's own are `CartParams`."""

    particles: int = Field(default=2000, ge=1)  # at most
    children: int = Field(default=8, ge=1)  # of each of them, from which a bump chooses
    opinions: int = Field(default=3, ge=0)  # of others that begin anew, before a cart is first called localized
    least_particles: int = Field(default=100, ge=1)
    error: float = Field(default=0.05, gt=0.0)  # of the belief, as a Kullback-Leibler distance
    quantile: float = Field(default=2.33, ge=0.0)  # of the normal distribution: 99 % keep the error
    bin_size: float = Field(default=0.03, gt=0.0)  # m
    bin_turn: float = Field(default=math.radians(6.0), gt=0.0)  # rad
    tolerance: float = Field(default=0.005, ge=0.0)  # m that walls may be off, one sigma
    blur: float = Field(default=0.01, ge=0.0)  # m by which a map that is symmetric may be off that
    kidnapping: float = Field(default=0.01, ge=0.0, lt=1.0)  # probability before each bump
    threshold: float = Field(default=0.5, ge=0.0, le=1.0)  # share of effective particles below which to resample
    size: float = Field(default=0.15, gt=0.0)  # m within which poses are one, a cart's own size
    turn: float = Field(default=math.radians(45.0), gt=0.0)  # rad, likewise
    sure: float = Field(default=0.95, gt=0.5, le=1.0)  # share of the heaviest cluster from which the cart is localized


class Estimate(NamedTuple):
    """What is known after a bump: the heaviest cluster's mean (3,) and covariance (3, 3), and all clusters.

    `restarted` is the probability that the cart was carried elsewhere before this bump, `effective` counts particles.
    """

    pose: np.ndarray
    covariance: np.ndarray
    clusters: list[Cluster]
    is_localized: bool
    particles: int
    effective: float
    restarted: float


class BumpLocalizer:
    """Particles (n, 3) at the cart's place after the last stage, each with a wheelbase of its own."""

    def __init__(self, area: Area, cart: CartParams, params: BumpLocalizerParams, seed: int):
        self.area = area
        self.cart = cart
        self.params = params
        self.seed = seed
        self.touch = Touch(
            cart.bumper_ahead, 0.5 * cart.bumper_width, cart.slip_share, cart.slip_distance, cart.slip_turn,
            cart.flatten_distance,
        )  # fmt: skip
        self.stages = 0
        self.hits = 0
        self.poses = np.zeros((0, 3))
        self.scales = np.zeros(0)
        self.log_weights = np.zeros(0)
        self.parents = np.zeros(0, np.int64)  # rows of the last bump's particles
        self.ancestry = Ancestry()
        self.symmetries = symmetries(area, params.blur)
        self.restarted = 1.0
        self.evidence = 0.0  # log density of all ways to bumps, by which parameters are compared,
        self.earlier = 0.0  # and of those before the stages that are kept for others to judge
        self.heard: list[Stage] = []
        self.is_tested = params.opinions == 0
        self.is_branched = False
        self.known: Estimate | None = None  # of now, once somebody asked

    def step(self, stage: Stage) -> None:
        """One stage more. What comes before the first bump says nothing of a cart that may be anywhere."""
        self.stages += 1
        self.known = None
        if len(self.heard) <= LONGEST:
            self.heard.append(stage)
        leg = self.leg_of(stage)
        if len(self.poses) and not self.is_branched:
            self.branch()
        if stage.kind == DRIVE and stage.bumper:
            self.bump(leg)
        elif len(self.poses):
            key = self.key(MOVES)
            if stage.kind == DRIVE:
                drive_free(self.area, self.poses, self.scales, self.log_weights, leg, self.touch, key)
            else:
                move(self.area, self.poses, self.scales, leg, self.touch, key)

    def branch(self) -> None:
        """Each particle has several children, of whom the next bump chooses as many as there were particles.

        Headings are hardly known after a turn, and ways are known so well that few of the headings drawn fit (prior
        boosting: Gordon, Salmond and Smith, IEE Proceedings F 140, 1993).
        """
        n = self.params.children
        self.is_branched = True
        self.poses = np.repeat(self.poses, n, axis=0)
        self.scales = np.repeat(self.scales, n)
        self.parents = np.repeat(np.arange(len(self.log_weights)), n)
        self.log_weights = np.repeat(self.log_weights, n) - math.log(n)

    def leg_of(self, stage: Stage) -> Leg:
        """The stage with its errors' standard deviations: noise, ticks cut off, and a wall's own place."""
        cart = self.cart
        way = 0.5 * cart.tick * (stage.left + stage.right)
        turn = cart.tick * (stage.right - stage.left) / cart.wheelbase + cart.veer * way
        ticks = cart.tick / math.sqrt(12.0)  # of the mean of two counters; their difference has twice it
        wall = self.params.tolerance if stage.bumper else 0.0
        way_sigma = math.hypot(math.sqrt(way_variance(way, cart)), ticks, wall)
        turn_sigma = math.hypot(math.sqrt(turn_variance(way, turn, cart)), 2.0 * ticks / cart.wheelbase)
        return Leg(way, turn, way_sigma, turn_sigma, stage.bumper if cart.switches == 3 else 0)

    def bump(self, leg: Leg) -> None:
        """Drive the particles to their walls, let some begin anew, choose who goes on, and test a claim."""
        self.hits += 1
        before = self.evidence
        if len(self.poses):
            doubt = self.cart.wheelbase_doubt * math.sqrt(1.0 - MEMORY**2)
            fresh = draw_biases(doubt, self.seed, self.vertex(MOVES), SCALES, len(self.scales))
            self.scales = 1.0 + MEMORY * (self.scales - 1.0) + fresh
            drive_to_wall(self.area, self.poses, self.scales, self.log_weights, leg, self.touch, self.key(MOVES))
        self.begin_anew(leg)
        if self.restarted > ANOTHER:  # what was before tells nothing of where it is now
            self.heard, self.earlier = self.heard[-1:], before
            self.is_tested = self.params.opinions == 0
        if len(self.poses):
            rows = self.resample(self.vertex(CHILDREN))
            self.parents = self.parents[rows]
        self.is_branched = False
        self.ancestry.add(self.poses, self.parents)
        if not self.is_tested and len(self.heard) <= LONGEST:
            found = self.estimate()
            if found is not None and found.is_localized:
                self.hear_others()

    def hear_others(self) -> None:
        """Test a claim: filters that begin anew with other random numbers judge the same stages, and all are joined.

        Each weighs what it finds all bumps to be worth, as filters on islands do: one that has lost the true place
        early on is overruled by any that has not.
        """
        self.is_tested, self.known = True, None
        params = self.params.model_copy(update={"opinions": 0})
        log_weights = np.log(normalize(self.log_weights) + 1e-300) + self.evidence - self.earlier
        for row in range(self.params.opinions):
            seed = int(bits(self.seed, self.vertex(OTHERS), row, 0) >> np.uint64(2))
            other = BumpLocalizer(self.area, self.cart, params, seed)
            for stage in self.heard:
                other.step(stage)
            if not len(other.poses):
                continue
            theirs = np.log(normalize(other.log_weights) + 1e-300) + other.evidence
            log_weights = np.concatenate([log_weights, theirs])
            self.poses = np.concatenate([self.poses, other.poses])
            self.scales = np.concatenate([self.scales, other.scales])
            self.ancestry.join(other.ancestry)
        self.log_weights = log_weights
        self.ancestry.choose(self.resample(self.vertex(OTHERS)))

    def begin_anew(self, leg: Leg) -> None:
        """Add particles that may be anywhere, as many and as heavy as Bayes's rule has them after this bump."""
        probes, scales = self.starts(N_PROBES, PROBES)
        density = start_anywhere(self.area, probes, scales, leg, self.touch, self.key(PROBES))
        level = np.logaddexp.reduce(self.log_weights) if len(self.poses) else -math.inf
        explained = math.exp(level) if len(self.poses) else 0.0
        anew = self.params.kidnapping * density if len(self.poses) else 1.0
        total = anew + (1.0 - self.params.kidnapping) * explained
        self.restarted = anew / total if total > 0.0 else 0.0
        self.evidence += math.log(max(total if len(self.poses) else density, 1e-300))
        n = round(self.restarted * self.params.particles * (self.params.children if len(self.poses) else 1))
        poses, scales = self.starts(n, STARTS)
        if n:
            start_anywhere(self.area, poses, scales, leg, self.touch, self.key(STARTS))
        found = np.isfinite(poses[:, 0])
        if not np.any(found):
            self.log_weights = self.log_weights - level if len(self.poses) else self.log_weights
            return
        old = self.log_weights - level + math.log(max(1.0 - self.restarted, 1e-300))
        new = np.full(int(found.sum()), math.log(self.restarted / found.sum()))
        self.poses = np.concatenate([self.poses, poses[found]])
        self.scales = np.concatenate([self.scales, scales[found]])
        self.parents = np.concatenate([self.parents, np.full(len(new), NOBODY)])
        self.log_weights = np.concatenate([old, new])

    def starts(self, n: int, what: int) -> tuple[np.ndarray, np.ndarray]:
        """Room for n poses (n, 3), and turn scales (n,) drawn from what is known of the wheelbase."""
        return np.empty((n, 3)), 1.0 + draw_biases(self.cart.wheelbase_doubt, self.seed, self.vertex(what), SCALES, n)

    def resample(self, vertex: int) -> np.ndarray:
        """Children of the particles, as many as their spread needs, where few of them carry the weight; their rows."""
        weights = normalize(self.log_weights)
        offset = uniform(self.seed, vertex, 0, 0)
        drawn = np.unique(systematic(weights, offset, self.params.particles))
        n_bins = len(np.unique(bins_of(self.poses[drawn], self.params.bin_size, self.params.bin_turn)))
        enough = enough_particles(n_bins, self.params.error, self.params.quantile)
        n = min(self.params.particles, max(self.params.least_particles, enough))
        if n >= len(weights) and effective_particles(weights) >= self.params.threshold * len(weights):
            self.log_weights = np.log(np.maximum(weights, 1e-300))
            return np.arange(len(weights))
        rows = systematic(weights, offset, n)
        self.scales = self.scales[rows]
        self.poses = self.poses[rows]
        self.log_weights = np.full(n, -math.log(n))
        return rows

    def estimate(self) -> Estimate | None:
        """What is known; None before the first bump that a place on the map explains.

        On a map that is symmetric so is what can be known: a particle stands for all its images alike, which no number
        of particles would keep alive by themselves.
        """
        if self.known is not None or not len(self.poses):
            return self.known
        weights = normalize(self.log_weights)
        images = np.concatenate([compose(motion, self.poses) for motion in self.symmetries])
        shares = np.tile(weights, len(self.symmetries)) / len(self.symmetries)
        found = clusters(images, shares, self.params.size, self.params.turn)
        best = found[0] if found else Cluster(self.poses[np.argmax(weights)], np.zeros((3, 3)), 0.0)
        is_localized = best.share >= self.params.sure
        self.known = Estimate(
            best.pose, best.covariance, found, is_localized, len(weights), effective_particles(weights), self.restarted
        )
        return self.known

    def path(self) -> np.ndarray:
        """Poses (hits, 3) after each bump of those who are now in the heaviest cluster; nan before they began."""
        found = self.estimate()
        if found is None:
            return np.full((self.hits, 3), np.nan)
        weights = normalize(self.log_weights)
        near = [
            np.where(within(compose(motion, self.poses), found.pose, self.params.size, self.params.turn), weights, 0.0)
            for motion in self.symmetries
        ]
        best = int(np.argmax([shares.sum() for shares in near]))
        path = self.ancestry.path(near[best], self.params.size, self.params.turn)
        return compose(self.symmetries[best], path)

    def vertex(self, what: int) -> int:
        """The word of random numbers' keys for something that is drawn at this stage."""
        return KINDS * self.stages + what

    def key(self, what: int) -> np.uint64:
        """The key of random numbers for the same."""
        return np.uint64(vertex_key(self.seed, self.vertex(what)))
