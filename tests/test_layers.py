"""Who may import whom: a file imports from lower layers, or from a sibling of its own that its docstring names.

The tables are the architecture. A new file gets a place in them; an import that points upwards is a mistake in the
design, not in the table.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

LAYERS: tuple[tuple[str, ...], ...] = (
    ("slam", "slam.grid", "slam.params", "slam.pose"),
    (
        "slam.affinity", "slam.area", "slam.bump_ancestry", "slam.bump_frames", "slam.bump_particles",
        "slam.bump_swarm", "slam.bump_walls", "slam.bumps", "slam.cart_hypothesis",
        "slam.cart_likelihood",
        "slam.cart_odometry", "slam.comparison", "slam.correlative_search", "slam.cost_grid", "slam.counter_random",
        "slam.distance_field", "slam.echo_matching", "slam.echoes", "slam.evaluate", "slam.families", "slam.frontiers",
        "slam.hypotheses", "slam.laser_maps", "slam.laser_odometry", "slam.laser_scan", "slam.local_map",
        "slam.loop_measurements",
        "slam.map_alignment", "slam.map_matching", "slam.motion", "slam.motion_noise", "slam.motor_curve",
        "slam.mouse_odometry", "slam.odometry_chain", "slam.odometry_noise", "slam.particles", "slam.path_tree",
        "slam.planning", "slam.pose_clusters", "slam.pose_covariance", "slam.pose_graph", "slam.posterior",
        "slam.rangefinder", "slam.resampling",
        "slam.scan_agreement", "slam.scan_matching", "slam.scan_motion", "slam.sonar_noise", "slam.suggestions",
        "slam.sweep_filling", "slam.thinning", "slam.timeline", "slam.trajectory", "slam.tree_map", "slam.uncertainty",
        "slam.variance_components", "slam.vfh", "slam.wall_direction", "slam.wall_following",
        "slam.wall_matching", "slam.walls",
    ),
    (
        "server", "server.channels", "server.clock", "server.commands", "server.errors",
        "server.formats", "server.formats.atomic",
        "server.formats.bags", "server.formats.carmen", "server.formats.cart_log", "server.formats.crazyflie",
        "server.formats.errors", "server.formats.ev3", "server.formats.g2o", "server.formats.laser",
        "server.formats.lego", "server.formats.logs", "server.formats.mines", "server.formats.neato",
        "server.formats.rcx", "server.formats.relations", "server.formats.roomba",
        "server.formats.ros_map",
        "server.formats.sonar8", "server.formats.sparse", "server.formats.tum", "server.formats.wean",
        "server.link", "server.messages", "server.presets", "server.recording", "server.scip", "server.transport",
        "server.virtual_link", "server.words", "slam.bump_arcs", "slam.bump_bundle", "slam.bump_doubt",
        "slam.bump_estimator", "slam.bump_finding", "slam.bump_fleet", "slam.bump_localizer",
        "slam.bump_mapper", "slam.bump_merging", "slam.bump_refinement", "slam.bump_survivors", "slam.bundle",
        "slam.bundled_islands", "slam.cart_calibration", "slam.fastslam", "slam.grid_filter", "slam.islands",
        "slam.local_search", "slam.path_filter", "slam.refined_filter", "slam.refined_grid_filter", "slam.refinement",
        "slam.scan_graph", "slam.scan_pairs",
    ),
    (
        "server.robots", "server.robots.bumper_cart", "server.robots.crunch", "server.robots.foldback",
        "server.robots.kinds", "server.robots.maze_runner", "server.robots.mice",
        "server.robots.odometry", "server.robots.pilot", "server.robots.track",
    ),
    (
        "server.adviser", "server.boards", "server.config", "server.control", "server.estimator", "server.explorer",
        "server.filter_worker", "server.health", "server.laser_line", "server.mouse_line", "server.navigator",
        "server.pulse",
        "server.restarts", "server.session", "server.stops",
    ),
    (
        "server.api", "server.cockpit", "server.comparison", "server.conversation", "server.dashboard",
        "server.felt_views", "server.guard", "server.guidance", "server.labels", "server.layers", "server.map_exports",
        "server.map_files", "server.map_picture", "server.map_store", "server.maps", "server.player",
        "server.replay_cache", "server.report", "server.rest", "server.rest.answers", "server.rest.commands",
        "server.rest.files", "server.rest.health", "server.rest.maps", "server.rest.metrics",
        "server.rest.present", "server.rest.recordings", "server.rest.sessions", "server.rest.state",
        "server.rest.viser", "server.scene", "server.score", "server.shelf", "server.status", "server.stream",
        "server.survey", "server.views",
    ),
    (
        "server.bridge", "server.cart_calibration", "server.cart_merging", "server.demo", "server.headless",
        "server.laser_calibration",
        "server.live", "server.mapping", "server.motor_calibration", "server.odometry_calibration", "server.recorded",
        "server.render",
        "server.render_queue", "server.replay", "server.sessions", "server.simulate",
        "server.sonar_calibration", "server.workbench",
    ),
    ("server.__main__", "server.board", "server.calibrate", "server.flash", "server.swarm", "server.terminal"),
)  # fmt: skip
LAYER_OF = {module: layer for layer, modules in enumerate(LAYERS) for module in modules}
PACKAGES = ("slam", "server", "firmware", "bench", "tests", "docs")
VIRTUAL_USERS = (
    "server.demo",
    "server.robots.bumper_cart",
    "server.simulate",
    "server.transport",
    "server.virtual_link",
)  # who may start the virtual robot


def files_of(package: str) -> list[Path]:
    """The package's Python files."""
    return [path for path in sorted((ROOT / package).rglob("*.py")) if "__pycache__" not in path.parts]


def name_of(path: Path) -> str:
    """The module's dotted name."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def is_module(name: str) -> bool:
    """Whether one of our files has this dotted name."""
    path = ROOT / Path(*name.split("."))
    return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()


def imports_of(path: Path) -> Iterator[tuple[int, str]]:
    """Line and module of everything of ours that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: imports are written in full"
            base = node.module or ""
            for alias in node.names:
                yield node.lineno, f"{base}.{alias.name}" if is_module(f"{base}.{alias.name}") else base


def ours(path: Path) -> list[tuple[int, str]]:
    """Imports from this project."""
    return [(line, module) for line, module in imports_of(path) if module.split(".")[0] in PACKAGES]


LAYERED = [path for package in ("slam", "server") for path in files_of(package)]


def test_every_file_has_its_layer_and_every_layer_its_files():
    assert {name_of(path) for path in LAYERED} == set(LAYER_OF)


@pytest.mark.parametrize("path", LAYERED, ids=name_of)
def test_imports_point_downwards(path):
    own = name_of(path)
    docstring = ast.get_docstring(ast.parse(path.read_text())) or ""
    for line, module in ours(path):
        place = f"{path.relative_to(ROOT)}:{line}: imports {module}"
        if module.startswith("firmware"):
            assert own in VIRTUAL_USERS, f"{place}, which only those who start the virtual robot may"
            continue
        assert module in LAYER_OF, f"{place}, which has no layer"
        is_sibling = LAYER_OF[module] == LAYER_OF[own]
        assert LAYER_OF[module] <= LAYER_OF[own], f"{place} from a higher layer"
        in_lowest = LAYER_OF[own] <= 2  # libraries: a layer of theirs is many rooms that see each other
        if is_sibling and not in_lowest and module not in ("server.robots",):
            assert f"`{module.rpartition('.')[2]}`" in docstring, f"{place}, a sibling that its docstring does not name"


def test_slam_stands_alone():
    for path in files_of("slam"):
        for line, module in ours(path):
            assert module.split(".")[0] == "slam", f"{path.relative_to(ROOT)}:{line}: imports {module}"


def test_the_virtual_robot_knows_only_its_own():
    for path in files_of("firmware"):
        for line, module in ours(path):
            assert module.split(".")[0] == "firmware", f"{path.relative_to(ROOT)}:{line}: imports {module}"


def test_asyncio_stays_at_the_edge():
    edge = {"server.conversation", "server.bridge", "server.dashboard", "server.estimator", "server.live",
            "server.player", "server.render_queue", "server.sessions", "server.stream", "server.transport",
            "server.virtual_link", "server.workbench"}  # fmt: skip
    users = {name_of(path) for path in LAYERED for _, module in imports_of(path) if module.split(".")[0] == "asyncio"}
    assert {user for user in users if not user.startswith("server.rest.")} <= edge


def test_imports_run_in_no_circle():
    graph = {name_of(path): {module for _, module in ours(path)} - {name_of(path)} for path in LAYERED}
    done: set[str] = set()

    def visit(module: str, above: tuple[str, ...]) -> None:
        assert module not in above, f"a circle: {' -> '.join((*above, module))}"
        if module not in done:
            for below in sorted(graph.get(module, set())):
                visit(below, (*above, module))
            done.add(module)

    sys.setrecursionlimit(max(sys.getrecursionlimit(), 10_000))
    for module in graph:
        visit(module, ())


def test_what_is_pure_asks_no_clock_and_no_global_chance():
    pure = [*files_of("slam"), *files_of("server/robots"), ROOT / "server" / "session.py"]
    for path in pure:
        for line, module in imports_of(path):
            assert module.split(".")[0] not in ("time", "datetime", "random"), f"{path.relative_to(ROOT)}:{line}"
