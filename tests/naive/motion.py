"""The motion model as three motions in a row: half the angle error, the way, the other half."""

from __future__ import annotations

import math

from tests.naive import counter_random
from tests.naive import pose as se2

ANGLE, DISTANCE = 0, 1  # streams


def errors(seed, vertex, particle):
    """Errors of angle and distance in standard deviations."""
    return (
        counter_random.gaussian(seed, vertex, particle, ANGLE),
        counter_random.gaussian(seed, vertex, particle, DISTANCE),
    )


def moved_pose(pose, motion, travelled, noise, angle_error, distance_error, turn_bias, scale_bias):
    """Pose after an erring motion."""
    turn_noise, distance_noise, rotation_noise = noise
    variance = turn_noise**2 * travelled + (rotation_noise * motion[2]) ** 2
    half_turn = (0.0, 0.0, 0.5 * (turn_bias * travelled + math.sqrt(variance) * angle_error))
    straight = math.hypot(motion[0], motion[1])
    direction = math.atan2(motion[1], motion[0])
    length = straight * (1.0 + scale_bias) + distance_noise * math.sqrt(travelled) * distance_error
    way = (length * math.cos(direction), length * math.sin(direction), motion[2])
    return se2.compose(se2.compose(se2.compose(pose, half_turn), way), half_turn)


def plausibility(motion, travelled, noise, errors, biases):
    """Log density of one vertex's correction, turn and way, biases and all, under the odometry's noise."""
    turn_noise, distance_noise, rotation_noise = noise
    turn_sigma = math.sqrt(turn_noise**2 * travelled + (rotation_noise * motion[2]) ** 2)
    distance_sigma = distance_noise * math.sqrt(travelled)
    turn = turn_sigma * errors[0] + biases[0] * travelled
    stretch = distance_sigma * errors[1] + biases[1] * math.hypot(motion[0], motion[1])
    return -0.5 * ((turn / turn_sigma) ** 2 + (stretch / distance_sigma) ** 2)
