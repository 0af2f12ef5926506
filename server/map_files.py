"""Maps as files of other programs: JSON, a pose graph, how certain each vertex is. Uses its sibling `maps`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from server.formats.g2o import Graph
from server.maps import FloorMap
from slam.pose import between
from slam.pose_clusters import Belief

MAP_FORMAT = "crunch-map-1"


def map_json(floor: FloorMap, robot: str) -> str:
    """The map for programs, as docs/outputs.md has it: metres to a millimetre, radians to a tenth of a milliradian."""
    path = [[round(float(x), 3), round(float(y), 3), round(float(theta), 4)] for x, y, theta in floor.path]
    walls = [np.round(curve, 3).tolist() for curve in floor.walls]
    labels = [{"text": label.text, "x": round(label.x, 3), "y": round(label.y, 3)} for label in floor.labels]
    content = {"format": MAP_FORMAT, "robot": robot, "frame": "world", "settled": min(floor.settled, len(path))}
    content |= {"path": path, "spread": [] if floor.spread is None else np.round(floor.spread, 3).tolist()}
    return json.dumps({**content, "walls": walls, "labels": labels}, separators=(",", ":")) + "\n"


class Profile(NamedTuple):
    """Of n vertices: nodes (n,) of the path tree per particle, how many first ones are settled, `deviations` (n, 3).

    These are standard deviations of x, y (m) and heading (rad); there is no row where they are not known.
    """

    nodes: np.ndarray
    settled: int
    deviations: np.ndarray = np.zeros((0, 3))


def profile_csv(times: np.ndarray, path: np.ndarray, profile: Profile) -> str:
    """One row per vertex: time, the path's length so far, nodes, settled, deviations or nothing in their place."""
    steps = np.hypot(*np.diff(path[:, :2], axis=0, prepend=path[:1, :2]).T) if len(path) else np.zeros(0)
    known = [f"{x:.4f},{y:.4f},{heading:.5f}" for x, y, heading in profile.deviations] or [",,"] * len(path)
    rows = ["vertex,time,distance,nodes_per_particle,settled,x_std,y_std,heading_std\n"]
    columns = zip(times, np.cumsum(steps), profile.nodes, known, strict=True)
    for vertex, (t, distance, nodes, deviations) in enumerate(columns):
        settled = int(vertex < profile.settled)
        rows.append(f"{vertex},{t:.6f},{distance:.3f},{nodes:.6f},{settled},{deviations}\n")
    return "".join(rows)


def clusters_csv(times: np.ndarray, beliefs: Sequence[Belief]) -> str:
    """One row per vertex and place where the robot may have been then, the likeliest first; its standard deviations."""
    rows = ["vertex,time,localized,place,share,x,y,heading,x_std,y_std,heading_std\n"]
    for vertex, (t, belief) in enumerate(zip(times, beliefs, strict=True)):
        for place, (pose, covariance, share) in enumerate(belief.clusters):
            x, y, heading = pose
            deviations = ",".join(f"{deviation:.4f}" for deviation in np.sqrt(np.maximum(np.diag(covariance), 0.0)))
            told = f"{vertex},{t:.6f},{int(belief.is_localized)},{place},{share:.4f}"
            rows.append(f"{told},{x:.4f},{y:.4f},{heading:.4f},{deviations}\n")
    return "".join(rows)


def pose_graph(path: np.ndarray, odometry: np.ndarray, turn_noise: float, distance_noise: float) -> Graph:
    """The path's vertices, joined by the motions that odometry (n, 3) measured; its noise is per root metre."""
    motions = between(odometry[:-1], odometry[1:])
    lengths = np.maximum(np.hypot(motions[:, 0], motions[:, 1]), 0.1)
    information = np.zeros((len(motions), 6))
    information[:, 0] = information[:, 3] = 1.0 / (max(distance_noise, 1e-3) ** 2 * lengths)
    information[:, 5] = 1.0 / (max(turn_noise, 1e-3) ** 2 * lengths)
    rows = np.arange(len(motions))
    return Graph(path, np.column_stack([rows, rows + 1]), motions, information)
