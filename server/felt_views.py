"""What viewers get of a robot that runs by itself and feels its way: topics of the map panel, and words of the status.

Uses its siblings `layers` and `views`.
"""

from __future__ import annotations

import zlib

import numpy as np

from server.layers import View, fine_unit, layer, pack_curves, pack_points
from server.messages import Snapshot
from server.views import Place, RunStatus, Whereabouts, finite, rounded
from slam.pose import transform
from slam.pose_clusters import Belief

SHADES = 15  # of the bump space: few, so that it is small on the wire
TOLD = 4  # places that are told in words


@layer("map_so_far")
def map_view(snapshot: Snapshot) -> View | None:
    """The walls that its bumps amount to so far; of a map that was given, that map's."""
    if snapshot.felt is None:
        return None
    unit = fine_unit(np.concatenate([np.zeros((0, 2)), *snapshot.walls]))
    is_given = snapshot.felt.bump_space is not None
    return View({"is_given": is_given, "scale": unit}, pack_curves(snapshot.walls, unit))


@layer("bump_space", every=10)
def bump_space_view(snapshot: Snapshot) -> View | None:
    """The bump space from above, as shares of the headings, of 0 to `shades` at the most; rows of `shape`, y upwards.

    `cells` is deflated (zlib's format); the first cell's middle is at `origin`.
    """
    band = snapshot.felt.bump_space if snapshot.felt else None
    if band is None:
        return None
    cells = np.ceil(SHADES * band.shares / max(band.shares.max(initial=0.0), 1e-9)).astype(np.uint8)
    fields = {"shape": cells.shape, "shades": SHADES, "spacing": band.spacing, "origin": rounded((band.x, band.y))}
    return View(fields, {"cells": np.frombuffer(zlib.compress(cells.tobytes(), 6), np.uint8)})


@layer("raw_path", every=10)
def raw_path_view(snapshot: Snapshot) -> View | None:
    """All movements added end to end, and three `bumpers` points at each bump: left, middle and right."""
    felt = snapshot.felt
    if felt is None:
        return None
    track, bumpers = transform(felt.laid, felt.track), transform(felt.laid, felt.bumpers.reshape(-1, 2))
    unit = fine_unit(np.concatenate([track, bumpers]))
    return View({"scale": unit}, {"points": pack_points(track, unit), "bumpers": pack_points(bumpers, unit)})


@layer("clusters")
def clusters_view(snapshot: Snapshot) -> View | None:
    """Where on a given map it may be: `poses` (n, 3), `shares` (n,), the places' `covariances` (n, 3) xx, xy, yy."""
    belief = snapshot.belief
    if belief is None:
        return None
    n = len(belief.clusters)
    covariances = np.array([cluster.covariance for cluster in belief.clusters]).reshape(n, 3, 3)
    return View(
        {"is_localized": belief.is_localized},
        {
            "poses": np.array([cluster.pose for cluster in belief.clusters], np.float32).reshape(n, 3),
            "shares": np.array([cluster.share for cluster in belief.clusters], np.float32),
            "covariances": covariances[:, [0, 0, 1], [0, 1, 1]].astype(np.float32),
        },
    )


def run_status(snapshot: Snapshot) -> RunStatus | None:
    """How its run goes."""
    cart, felt = snapshot.cart, snapshot.felt
    if cart is None or felt is None:
        return None
    return RunStatus(number=cart.run, doing=cart.doing, bumps=cart.bumps, stages=cart.logged, lost_stages=felt.lost)


def whereabouts(snapshot: Snapshot) -> Whereabouts | None:
    """Where it may be."""
    belief = snapshot.belief
    if belief is None:
        return None
    places = [
        Place(x=x, y=y, heading=heading, share=finite(cluster.share) or 0.0)
        for cluster in belief.clusters
        for x, y, heading in [rounded(cluster.pose)]
    ]
    words = in_words(belief, has_bumped=bool(snapshot.vertex_curves))
    return Whereabouts(localized=belief.is_localized, places=places, words=words)


def in_words(belief: Belief, has_bumped: bool) -> str:
    """The belief as people read it."""
    shares = [f"{100.0 * cluster.share:.0f} %" for cluster in belief.clusters]
    if not shares:
        return (
            "No place on the map explains its bumps." if has_bumped else "It may be anywhere on the map: no bump yet."
        )
    if belief.is_localized:
        return f"Localized: {shares[0]} of the belief is in one place."
    if len(shares) == 1:
        return f"Not localized: {shares[0]} of the belief is in one place, the rest is spread."
    told, more = shares[:TOLD], len(shares) - TOLD
    listed = ", ".join(told) + " and less" if more > 0 else f"{', '.join(told[:-1])} and {told[-1]}"
    return f"Not localized: it may be in {len(shares)} places, {listed}."
