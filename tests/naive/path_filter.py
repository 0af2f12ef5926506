"""The particle filter with whole paths in lists, every newest vertex compared with all earlier ones."""

from __future__ import annotations

import cmath
import math

import numpy as np

from tests.naive import comparison, counter_random, motion, wall_direction
from tests.naive import pose as se2

TURN_BIAS, SCALE_BIAS, TURN_JITTER, SCALE_JITTER, OFFSET = range(2, 7)  # streams


class Particle:
    """One whole path and what it is worth."""

    def __init__(self, pose, turn_bias, scale_bias):
        self.path = [pose]
        self.turn_bias, self.scale_bias = turn_bias, scale_bias
        self.log_weight = self.affinity = self.plausibility = 0.0
        self.directions = []  # four times a wall's angle, and how strongly that is remembered

    def copy(self, kept, turn_jitter, scale_jitter):
        """A child, which weighs what all weigh."""
        child = Particle(self.path[0], kept * self.turn_bias + turn_jitter, kept * self.scale_bias + scale_jitter)
        child.path = list(self.path)
        child.affinity, child.plausibility, child.directions = self.affinity, self.plausibility, self.directions
        return child

    def gain(self, log_likelihood):
        """Take evidence up."""
        self.log_weight += log_likelihood
        self.affinity += log_likelihood


class PathFilter:
    """`score(newer, pose, older, pose)` is a pair's log weight, `direction_of(walls)` a complex number."""

    def __init__(self, params, seed, rule, score, direction_of):
        self.params, self.seed, self.rule = params, seed, rule
        self.score, self.direction_of = score, direction_of
        self.particles: list[Particle] = []
        self.odometry = np.zeros(3)
        self.vertices = 0
        self.resampled_at: list[int] = []

    def bias(self, spread, vertex, stream, particle):
        return spread * counter_random.gaussian(self.seed, vertex, particle, stream)

    def extend(self, pose, walls, travelled):
        """One vertex for everyone."""
        model = self.params.motion
        if not self.particles:
            self.particles = [
                Particle(
                    stored(pose),
                    self.bias(model.turn_bias, 0, TURN_BIAS, p),
                    self.bias(model.scale_bias, 0, SCALE_BIAS, p),
                )
                for p in range(self.params.particles)
            ]
        else:
            step = se2.between(self.odometry, pose)
            for p, particle in enumerate(self.particles):
                self.move(p, particle, step, travelled)
                self.compare(particle)
        for particle in self.particles:
            self.align(particle, self.direction_of(walls))
        self.odometry = np.array(pose)
        self.vertices += 1
        self.resample_if_needed()

    def move(self, p, particle, step, travelled):
        model = self.params.motion
        noise = (model.turn_noise, model.distance_noise, model.rotation_noise)
        errors = motion.errors(self.seed, self.vertices, p)
        biases = particle.turn_bias, particle.scale_bias
        moved = motion.moved_pose(particle.path[-1], step, travelled, noise, *errors, *biases)
        particle.path.append(stored(moved))
        particle.plausibility += motion.plausibility(step, travelled, noise, errors, biases)

    def compare(self, particle):
        newest = len(particle.path) - 1
        for other in comparison.nearest_earlier(particle.path, newest, self.rule):
            particle.gain(self.score(newest, particle.path[newest], other, particle.path[other]))

    def align(self, particle, seen):
        """How likely the walls stand as they do, given all that the particle saw stand."""
        model = self.params.direction
        if model.gain == 0.0 or abs(seen) == 0.0:
            return
        angle = cmath.phase(seen * cmath.exp(4j * particle.path[-1][2]))
        likely = wall_direction.density(angle, particle.directions, model.prior)
        particle.gain(model.gain * abs(seen) * math.log((1.0 - model.outliers) * max(0.0, likely) + model.outliers))
        older = [(before, model.memory * strength) for before, strength in particle.directions]
        particle.directions = [*older, (angle, abs(seen))]

    def weights(self):
        likelihoods = np.exp([particle.log_weight for particle in self.particles])
        return likelihoods / likelihoods.sum()

    def resample_if_needed(self):
        weights = self.weights()
        entropy = -sum(w * math.log2(w) for w in weights if w > 0.0)
        if 2.0**entropy >= self.params.threshold * len(weights):
            return
        n, model = len(weights), self.params.motion
        offset = counter_random.uniform(self.seed, len(self.resampled_at), 0, OFFSET)
        parents = np.searchsorted(np.cumsum(weights), (np.arange(n) + offset) / n, side="right")
        self.particles = [
            self.particles[parent].copy(
                math.sqrt(1.0 - model.jitter**2),
                self.bias(model.jitter * model.turn_bias, len(self.resampled_at), TURN_JITTER, child),
                self.bias(model.jitter * model.scale_bias, len(self.resampled_at), SCALE_JITTER, child),
            )
            for child, parent in enumerate(parents)
        ]
        self.resampled_at.append(self.vertices)


def stored(pose):
    """Poses are kept in single precision."""
    return np.asarray(pose, np.float32)
