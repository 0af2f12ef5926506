"""A wall before the virtual robot's nose, where its infra-red folds back, is mapped where it stands."""

from __future__ import annotations

import numpy as np
import pytest

from firmware.virtual import VirtualCrunch, World
from server import config
from server.robots.crunch import Crunch
from server.session import Session
from slam.walls import extract

DECKS = 0.076  # m, their radius
ROLL = 0.02  # m farther off: let go, it rolls 2 to 4 cm, and must not come nearer than sonars hear


@pytest.mark.parametrize("gap", [0.02, 0.03, 0.04, 0.06, 0.08, 0.12])
def test_a_near_wall_is_where_it_stands_and_nothing_is_free_beyond(gap):
    place = DECKS + gap
    start = np.array([-ROLL, 0.0, 0.0])
    robot = VirtualCrunch(World(np.array([[place, -2.0, place, 2.0]]), start), seed=3, drift="none")
    params = config.load({}).crunch
    fold = Crunch(params)
    session = Session(fold, params.calibration)
    looks = []
    for step in range(400):
        session.receive("radio", robot.advance(0.02), robot.time)
        if step >= 150 and step % 25 == 0:
            walls = extract(fold.local_map, fold.odometry, params.walls)
            looks.append(np.array([walls.distances[0], walls.free[0]]) - (place - robot.pose[0]))
    distance, free = np.transpose(looks)
    assert np.median(np.abs(distance)) < 0.04
    assert np.max(np.abs(distance)) < 0.05  # two cells
    assert np.max(free) < 0.5 * fold.local_map.resolution
