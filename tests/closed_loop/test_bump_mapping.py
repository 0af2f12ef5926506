"""The virtual bumper cart, whose board and body know nothing of the mapper, maps rooms that nobody told it of."""

from __future__ import annotations

import numpy as np

from firmware.virtual.bumper_cart import run_cart
from firmware.virtual.polygons import polygon
from slam.bump_mapper import BumpMapper, segments_of
from slam.bump_walls import distances, map_error, points_on
from slam.cart_odometry import CartParams, Stage, bumper_points, bumps_of
from slam.evaluate import alignment
from slam.pose import transform


def test_rooms_are_mapped_to_centimetres_from_bumps_alone():
    """Three rooms, 80 bumps: the median map errs by less than 5 cm, and by less than half of dead reckoning's."""
    found = []
    for seed in (0, 2, 6):
        world = polygon(seed)
        logged, truth = run_cart(world, seed, 80)
        stages = [Stage(*stage) for stage in logged]
        mapper = BumpMapper(CartParams(), seed=seed)
        mapper.extend(stages)
        area, rows = mapper.refine(), bumps_of(stages) + 1
        lay = alignment(area.path[area.is_bump][:, :2], truth[rows, :2])
        walls = [transform(lay, wall) for wall in area.walls]
        error, covered = map_error(segments_of(walls), points_on(walls), world.segments)
        raw = mapper.raw()[rows]
        contacts = transform(alignment(raw[:, :2], truth[rows, :2]), bumper_points(raw, CartParams())[:, 1])
        found.append((error, covered, error / float(np.mean(distances(contacts, world.segments)))))
    error, covered, share = np.median(found, axis=0)
    assert error < 0.05, found
    assert covered > 0.7, found
    assert share < 0.5, found
