"""Maps as files of other programs: JSON, a pose graph, the tree's profile. Uses its sibling `maps`."""

from __future__ import annotations

import json

import numpy as np

from server.formats.g2o import Graph
from server.maps import FloorMap
from slam.pose import between

MAP_FORMAT = "crunch-map-1"


def map_json(floor: FloorMap, robot: str) -> str:
    """The map for programs, as docs/outputs.md has it: metres to a millimetre, radians to a tenth of a milliradian."""
    path = [[round(float(x), 3), round(float(y), 3), round(float(theta), 4)] for x, y, theta in floor.path]
    walls = [np.round(curve, 3).tolist() for curve in floor.walls]
    labels = [{"text": label.text, "x": round(label.x, 3), "y": round(label.y, 3)} for label in floor.labels]
    content = {"format": MAP_FORMAT, "robot": robot, "frame": "world", "settled": min(floor.settled, len(path))}
    content |= {"path": path, "spread": [] if floor.spread is None else np.round(floor.spread, 3).tolist()}
    return json.dumps({**content, "walls": walls, "labels": labels}, separators=(",", ":")) + "\n"


def profile_csv(times: np.ndarray, path: np.ndarray, profile: np.ndarray, fixed_depth: int) -> str:
    """One row per vertex: time, the path's length so far, nodes of the tree at its depth per particle, settled."""
    steps = np.hypot(*np.diff(path[:, :2], axis=0, prepend=path[:1, :2]).T) if len(path) else np.zeros(0)
    rows = ["vertex,time,distance,nodes_per_particle,settled\n"]
    for vertex, (t, distance, nodes) in enumerate(zip(times, np.cumsum(steps), profile, strict=True)):
        rows.append(f"{vertex},{t:.6f},{distance:.3f},{nodes:.6f},{int(vertex <= fixed_depth)}\n")
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
