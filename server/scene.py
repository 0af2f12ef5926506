"""What the view in three dimensions shows, layer by layer: one function each, from a Snapshot to viser's scene.

A layer draws below a node of its own name, which a switch shows and hides. Lengths are in metres, the floor is z = 0,
heights above it are ours: walls are drawn as high as the robot, and in the path tree height is time. Knows no socket.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from server.messages import Snapshot

if TYPE_CHECKING:
    import viser

WHEEL_RADIUS = 0.0508
PLATE_WHEEL_RADIUS = 0.035  # of Maze Runner
BRICK_WHEEL_RADIUS = 0.02  # of Bumper Cart
WALL_HEIGHT = 0.35
LOW_WALL = 0.08  # around a robot of a few centimetres
DECKS = {"lower": 0.05, "sonar": 0.101, "infrared": 0.152}  # heights above the axle; sensors look out of theirs
TREE_RISE = 0.15  # per vertex, as long as the tree stays below:
TREE_HEIGHT = 4.0
WHOLE_SPREAD = 0.5  # of a vertex's particles, at which it is drawn as wholly uncertain
FURTHEST_CLICK = 200.0  # from the camera
MOST_SEGMENTS = 10_000  # of the walls; more stall a computer without a graphics card

WALL, SETTLED, OPEN, GOAL = (86, 140, 190), (0, 114, 178), (213, 94, 0), (0, 158, 115)
SENSORS = {"sonar": (86, 180, 233), "infrared": (240, 228, 66), "laser": (240, 228, 66)}
DECK, DARK = (240, 200, 66), (60, 60, 66)


class SceneLayer(NamedTuple):
    """A switch in the view: the name of its node, its label with a hint, what draws it, and whether it is on at first.

    `key` tells when to draw again: whenever what it makes of a snapshot has changed.
    """

    name: str
    label: str
    hint: str
    draw: Callable[[viser.SceneApi, Snapshot], None]
    key: Callable[[Snapshot], object]
    is_on: bool = True


def estimate_key(snapshot: Snapshot) -> object:
    """Changes with every estimate."""
    return len(snapshot.path), snapshot.path[-1:].tobytes(), snapshot.affinity, snapshot.resamplings


def way_key(snapshot: Snapshot) -> object:
    """Changes with the objective and with the way to it."""
    return snapshot.goal, snapshot.route.tobytes()


def draw_walls(scene: viser.SceneApi, snapshot: Snapshot) -> None:
    """The best map's walls as upright ribbons."""
    vertices, faces = ribbons(snapshot.walls, WALL_HEIGHT if snapshot.felt is None else LOW_WALL)
    if len(faces):
        scene.add_mesh_simple(
            "/walls/mesh", vertices, faces, color=WALL, side="double", flat_shading=True,
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
    else:
        scene.remove_by_name("/walls/mesh")


def draw_path(scene: viser.SceneApi, snapshot: Snapshot) -> None:
    """The best path on the floor, from settled to open by how far its particles still differ."""
    shares = uncertainty(snapshot)
    points = np.column_stack([snapshot.path[:, :2], np.full(len(snapshot.path), 0.02)])
    put_segments(scene, "/path/line", np.stack([points[:-1], points[1:]], axis=1), shade(shares[1:]), 4.0)


def draw_tree(scene: viser.SceneApi, snapshot: Snapshot) -> None:
    """The particles' paths as a tree that grows upwards with time: hypotheses part, and are seen to merge again."""
    branches = snapshot.branches
    if branches is None:
        scene.remove_by_name("/tree/lines")
        return
    points = raised(branches.poses, branches.depths, len(snapshot.path))
    grown = np.flatnonzero(branches.parents >= 0)
    segments = np.stack([points[branches.parents[grown]], points[grown]], axis=1)
    is_open = (branches.depths[grown] > snapshot.fixed_depth).astype(float)
    put_segments(scene, "/tree/lines", segments, shade(is_open), 1.5)


def draw_particles(scene: viser.SceneApi, snapshot: Snapshot) -> None:
    """Where the particles have the newest vertex, on the floor."""
    points = np.column_stack([snapshot.particles[:, :2], np.full(len(snapshot.particles), 0.03)]).astype(np.float32)
    if len(points):
        scene.add_point_cloud(
            "/particles/points", points, OPEN, point_size=0.03, point_shape="circle", precision="float32"
        )
    else:
        scene.remove_by_name("/particles/points")


def draw_way(scene: viser.SceneApi, snapshot: Snapshot) -> None:
    """The objective as a pole with a ball, and the planned way to it."""
    scene.remove_by_name("/way/pole")
    if snapshot.goal is not None:
        draw_pole(scene, "/way/pole", snapshot.goal, GOAL)
    places = snapshot.route if snapshot.goal is not None else np.zeros((0, 2))
    points = np.column_stack([places, np.full(len(places), 0.03)])
    put_segments(scene, "/way/line", np.stack([points[:-1], points[1:]], axis=1), np.array(GOAL), 3.0)


def draw_beams(scene: viser.SceneApi, snapshot: Snapshot) -> None:
    """What the sensors see now, out of their decks and leaning with the body; no echo, no beam."""
    for sensor, beam in snapshot.beams.items():
        bearings = np.asarray(beam["bearings"], float)
        ranges = np.broadcast_to(np.asarray(beam["ranges"], float), bearings.shape)
        start = np.broadcast_to(np.asarray(beam["offsets"], float), bearings.shape)
        directions = np.column_stack([np.cos(bearings), np.sin(bearings)])[np.isfinite(ranges)]
        ends = np.stack([start[np.isfinite(ranges)], (start + ranges)[np.isfinite(ranges)]], axis=1)
        flat = directions[:, None, :] * ends[:, :, None]
        segments = np.concatenate([flat, np.full((*flat.shape[:2], 1), DECKS.get(sensor, 0.1))], axis=2)
        put_segments(scene, f"/robot/beams/{sensor}", segments, np.array(SENSORS.get(sensor, DECK)), 1.5)


def draw_labels(scene: viser.SceneApi, snapshot: Snapshot) -> None:
    """The names that people gave to places."""
    scene.remove_by_name("/labels/all")
    scene.add_frame("/labels/all", show_axes=False)
    for label in snapshot.labels:
        place = (label.x, label.y, WALL_HEIGHT)
        scene.add_label(f"/labels/all/{label.id}", label.text, position=place, anchor="bottom-center")


LAYERS = (
    SceneLayer("/walls", "Walls", "of the best map", draw_walls, estimate_key),
    SceneLayer("/path", "Path", "blue is settled, orange still open", draw_path, estimate_key),
    SceneLayer("/tree", "Path tree", "hypotheses; time goes upwards", draw_tree, estimate_key),
    SceneLayer("/particles", "Particles", "at the newest vertex", draw_particles, estimate_key, is_on=False),
    SceneLayer("/robot/beams", "Beams", "what its sensors see", draw_beams, lambda snapshot: snapshot.t),
    SceneLayer("/way", "Objective", "and the way planned to it", draw_way, way_key),
    SceneLayer("/labels", "Labels", "names of places", draw_labels, lambda snapshot: snapshot.labels),
)


def draw_body(scene: viser.SceneApi, robot: str) -> viser.FrameHandle:
    """The robot of that name, to scale, under a frame in the axle that turns and tilts."""
    frame = scene.add_frame("/robot", show_axes=False)
    if robot == "maze_runner":
        draw_plate(scene)
    elif robot == "bumper_cart":
        draw_brick(scene)
    else:
        draw_tower(scene)
    return frame


def draw_tower(scene: viser.SceneApi) -> None:
    """Crunch: decks on four rods, two wheels and a nose."""
    for name, height in DECKS.items():
        scene.add_cylinder(f"/robot/{name}", radius=0.076, height=0.008, color=DECK, position=(0.0, 0.0, height))
    for rod in range(4):
        angle = 0.25 * math.pi * (2 * rod + 1)
        place = (0.06 * math.cos(angle), 0.06 * math.sin(angle), 0.1)
        scene.add_cylinder(f"/robot/rod{rod}", radius=0.004, height=0.11, color=DARK, position=place)
    scene.add_box("/robot/nose", color=OPEN, dimensions=(0.03, 0.02, 0.012), position=(0.085, 0.0, 0.152))
    draw_wheels(scene, WHEEL_RADIUS, 0.095, 0.0)


def draw_plate(scene: viser.SceneApi) -> None:
    """Maze Runner: a plate on two wheels and a castor, the laser on a block ahead of the axle."""
    rise = PLATE_WHEEL_RADIUS - WHEEL_RADIUS  # of its axle, for the frame is as high as the tower's
    scene.add_box("/robot/plate", color=DECK, dimensions=(0.22, 0.16, 0.01), position=(-0.01, 0.0, rise + 0.03))
    scene.add_box("/robot/block", color=DARK, dimensions=(0.05, 0.05, 0.04), position=(0.05, 0.0, rise + 0.055))
    scene.add_cylinder("/robot/laser", radius=0.025, height=0.03, color=OPEN, position=(0.05, 0.0, rise + 0.09))
    scene.add_icosphere("/robot/castor", radius=0.015, color=DARK, position=(-0.1, 0.0, 0.015 - WHEEL_RADIUS))
    draw_wheels(scene, PLATE_WHEEL_RADIUS, 0.1, rise)


def draw_brick(scene: viser.SceneApi) -> None:
    """Bumper Cart: a brick on two wheels, the bumper ahead of it as wide as all of it."""
    rise = BRICK_WHEEL_RADIUS - WHEEL_RADIUS  # of its axle, for the frame is as high as the tower's
    scene.add_box("/robot/brick", color=DECK, dimensions=(0.1, 0.044, 0.04), position=(0.025, 0.0, rise + 0.02))
    scene.add_box("/robot/bumper", color=OPEN, dimensions=(0.01, 0.0762, 0.02), position=(0.085, 0.0, rise + 0.005))
    draw_wheels(scene, BRICK_WHEEL_RADIUS, 0.032, rise)


def draw_wheels(scene: viser.SceneApi, radius: float, half_track: float, height: float) -> None:
    """A wheel on either side of the axle."""
    turned = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
    for side, y in (("left", half_track), ("right", -half_track)):
        scene.add_cylinder(
            f"/robot/{side}", radius=radius, height=0.02, color=DARK, position=(0.0, y, height), wxyz=turned
        )


def draw_pole(scene: viser.SceneApi, name: str, place: tuple[float, float], colour: tuple[int, int, int]) -> None:
    """A pole with a ball on it, seen above the walls."""
    x, y = place
    scene.add_frame(name, show_axes=False, position=(x, y, 0.0))
    scene.add_cylinder(f"{name}/rod", radius=0.012, height=0.6, color=colour, position=(0.0, 0.0, 0.3))
    scene.add_icosphere(f"{name}/ball", radius=0.06, color=colour, position=(0.0, 0.0, 0.62))


def put_segments(scene: viser.SceneApi, name: str, segments: np.ndarray, colours: np.ndarray, width: float) -> None:
    """Lines (n, 2, 3), `width` pixels wide, of one colour (3,) or with one each (n, 3); none are none."""
    if not len(segments):
        scene.remove_by_name(name)
        return
    light = np.round(255.0 * (colours / 255.0) ** 2.2).astype(np.uint8)  # colours of each end are taken as linear light
    ends = np.array(np.broadcast_to(light[..., None, :], segments.shape))
    scene.add_line_segments(name, segments.astype(np.float32), ends, thickness=width, thickness_units="screen")


def uncertainty(snapshot: Snapshot) -> np.ndarray:
    """How open each vertex of the path still is, 0 to 1 (n,): by its particles' spread, else by the tree's profile."""
    n = len(snapshot.path)
    if len(snapshot.spread) == n:
        return np.clip(snapshot.spread / WHOLE_SPREAD, 0.0, 1.0)
    return np.sqrt(np.clip(snapshot.profile, 0.0, 1.0)) if len(snapshot.profile) == n else np.zeros(n)


def shade(shares: np.ndarray) -> np.ndarray:
    """Colours (n, 3) between settled (0) and open (1)."""
    settled, unsettled = np.array([SETTLED, OPEN], float)
    return settled + shares[:, None] * (unsettled - settled)


def raised(poses: np.ndarray, depths: np.ndarray, n_vertices: int) -> np.ndarray:
    """Points (n, 3) of a tree's poses: the height is the vertex's place in time."""
    rise = min(TREE_RISE, TREE_HEIGHT / max(1, n_vertices))
    return np.column_stack([poses[:, :2], WALL_HEIGHT + rise * depths])


def heading_and_tilt(theta: float, tilt: float) -> tuple[float, float, float, float]:
    """Quaternion (w, x, y, z) of a turn by theta about z, then a lean forward by tilt about the body's y."""
    a, b = math.cos(theta / 2.0), math.sin(theta / 2.0)
    c, d = math.cos(tilt / 2.0), math.sin(tilt / 2.0)
    return a * c, -b * d, a * d, b * c


def ribbons(curves: list[np.ndarray], height: float) -> tuple[np.ndarray, np.ndarray]:
    """Curves (k, 2) raised to upright ribbons: vertices (n, 3) float32 and triangles (m, 3) uint32.

    Of large maps only some points of each curve are taken, so that the whole map stays in view.
    """
    curves = [curve for curve in curves if len(curve) > 1]
    if not curves:
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint32)
    points, lengths = np.concatenate(curves), np.array([len(curve) for curve in curves])
    ends = np.cumsum(lengths)
    is_end = np.zeros(len(points), bool)
    is_end[ends - 1] = True
    number = np.arange(len(points)) - np.repeat(ends - lengths, lengths)  # of each point in its curve
    is_kept = is_end | (number % math.ceil(len(points) / MOST_SEGMENTS) == 0)
    points, is_end = points[is_kept], is_end[is_kept]
    n = len(points)
    low = np.flatnonzero(~is_end)  # of each segment's first point; its upper one comes n later
    faces = np.concatenate([np.column_stack([low, low + 1, low + n]), np.column_stack([low + 1, low + n + 1, low + n])])
    vertices = np.concatenate([np.column_stack([points, np.full(n, z)]) for z in (0.0, height)])
    return vertices.astype(np.float32), faces.astype(np.uint32)


def place_on_floor(origin: tuple[float, ...], direction: tuple[float, ...]) -> tuple[float, float] | None:
    """Where a ray meets the floor; None for one that never does, or only far beyond every building."""
    x, y, z = origin
    u, v, w = direction
    if z * w >= 0.0:
        return None
    way = -z / w
    place = x + way * u, y + way * v
    return place if math.hypot(place[0] - x, place[1] - y) < FURTHEST_CLICK else None
