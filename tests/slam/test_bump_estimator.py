"""A cart on a known map: its path is told as it is known then, and once the run is over as all of it tells."""

from __future__ import annotations

import numpy as np
import pytest

from firmware.virtual.bumper_cart import CartBuild, run_cart
from firmware.virtual.polygons import closed_outlines
from firmware.virtual.worlds import load_world
from slam.area import area_of
from slam.bump_estimator import LocalizedCart
from slam.bump_localizer import BumpLocalizerParams
from slam.cart_odometry import DRIVE, CartParams, Stage

FIRST = 4  # bumps after which hardly a cart is localized


def localized(seed, bumps=20):
    """A cart that drove around, and true poses (bumps, 3) at its bumps."""
    world = load_world("cut-rectangle")
    stages, truth = run_cart(world, seed, bumps, build=CartBuild(drift="low"))
    area = area_of(closed_outlines(world.segments, world.name))
    cart, true, fresh = LocalizedCart(area, CartParams(), BumpLocalizerParams(particles=700), seed), [], []
    for stage, pose in zip(stages, truth[1:], strict=True):
        fresh.append(Stage(*stage))
        if stage.kind == DRIVE:
            cart.extend(np.zeros(3), fresh, 0.0)
            fresh = []
            true.append(pose)
    return cart, np.array(true)


def off(cart, true):
    """How far (m) the path is off the truth at each bump."""
    return np.hypot(*(cart.estimate().path - true)[:, :2].T)


def test_early_bumps_are_right_once_the_run_is_over():
    then, now = [], []
    for seed in range(300, 305):
        cart, true = localized(seed)
        then.append(off(cart, true)[:FIRST])
        cart.conclude()
        now.append(off(cart, true)[:FIRST])
    assert np.median(then) > 0.1
    assert np.median(now) < 0.03
    assert np.mean(np.array(now) < 0.2) > 0.9


def test_what_nothing_explains_stays_where_it_was_reckoned():
    cart, _ = localized(300, 2)
    fresh = LocalizedCart(cart.localizer.area, CartParams(), BumpLocalizerParams(particles=100))
    with pytest.raises(RuntimeError, match="no bump"):
        fresh.estimate()
    reckoned = np.array([7.0, 8.0, 0.5])
    fresh.extend(reckoned, [Stage(DRIVE, 9000, 9000, 2)], 15.0)  # no room is so long
    fresh.conclude()
    np.testing.assert_allclose(fresh.estimate().path, [reckoned])
