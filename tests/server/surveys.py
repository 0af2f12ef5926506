"""Surveys to be saved, moved and compared: rectangular rooms seen from a few places."""

from __future__ import annotations

import numpy as np

from server.survey import Survey
from slam.pose import compose
from slam.walls import Walls

N_RAYS = 120


def seen_in_room(pose: np.ndarray, half: tuple[float, float]) -> Walls:
    """What is seen from a pose within a room around the origin, `half` m to each side."""
    angles = pose[2] + 2.0 * np.pi * np.arange(N_RAYS) / N_RAYS
    ways = np.array([np.cos(angles), np.sin(angles)])
    steep = np.where(np.abs(ways) < 1e-9, np.copysign(1e-9, ways), ways)
    bounds = np.copysign(np.array(half)[:, None], ways) - pose[:2, None]
    distances = np.min(bounds / steep, axis=0)
    return Walls(distances, distances - 0.05)


def room_survey(half: tuple[float, float] = (2.0, 1.0), world: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Survey:
    """A survey of a room whose middle stands at `world` in the robot's world."""
    poses = np.array([[-0.5, 0.0, 0.0], [0.0, 0.1, 0.5], [0.6, -0.2, 2.0], [0.2, 0.1, 3.0]])
    path = compose(np.array(world), poses)
    return Survey(
        robot="crunch",
        path=path,
        walls=[seen_in_room(pose, half) for pose in poses],
        times=np.array([0.5, 2.0, 3.5, 5.0]),
        odometry=path + [0.01, 0.02, 0.0],
        profile=np.array([0.01, 0.01, 0.5, 1.0]),
        fixed_depth=1,
        n_particles=100,
    )
