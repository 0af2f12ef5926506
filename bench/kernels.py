"""Each kernel of the path filter against what the machine can do at best, measured in the same process.

The filter has driven one and a half laps of a 50 m cycle, so that its paths come back near themselves; then every
kernel runs alone, many times, on one thread, and the best processor time counts. What a kernel must at least do per
item is counted by hand (`Work`): bytes that come from or go to memory, look-ups in tables and in the tree, operations
(floating-point or integer, all as cheap as the cheapest), and calls of log, exp, sin and cos.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numba import njit

from bench.benchmark import Bench, Column, Crew, Record, Row, middle, plain
from bench.recordings import cycle, read
from bench.roofline import Work, best_time, ceilings
from bench.scores import params_of
from server.replay import fold
from server.robots.crunch import Crunch
from slam.comparison import room_for_cells
from slam.counter_random import vertex_key
from slam.motion import Step, propagate, step_of
from slam.particles import (
    BLOCK,
    Particles,
    box_of,
    equal_particles,
    extend,
    find_near,
    inherit,
    is_near,
    next_goal,
    weigh_by_points,
)
from slam.path_filter import PathFilter
from slam.path_tree import STRIDE, PathTree, climb
from slam.pose import between
from slam.resampling import exponentials, normalize, systematic
from slam.wall_direction import align
from slam.walls import Walls

PARTICLES = 100_000
VERTICES = 150  # of about 220: one and a half laps
GAUSSIAN = 55  # operations of one Gaussian number: two mixed keys, a ratio of polynomials
POINT = 32  # operations of a test point: its cells in two rasters, and what its labels add to three sums


class State(NamedTuple):
    """The filter before its next vertex, whose nodes have room but no poses yet."""

    path_filter: PathFilter
    tree: PathTree
    walls: Walls
    step: Step
    key: np.uint64
    poses: np.ndarray  # of the newest level, a view

    @property
    def particles(self) -> Particles:
        """What they carry."""
        return self.path_filter.particles

    @property
    def vertex(self) -> int:
        """The newest level."""
        return self.path_filter.vertices


class Measured(NamedTuple):
    """Seconds of one kernel over `n` items, what an item is, and its least work."""

    seconds: float
    n: int
    item: str
    work: Work
    threads: int = 1

    def record(self) -> Record:
        """Time per item beside its bound."""
        bound, binds = self.work.seconds(ceilings(self.threads))
        each = self.seconds / self.n
        return {
            "item": self.item, "n": self.n, "ns": 1e9 * each, "bound_ns": 1e9 * bound, "binds": binds,
            "ratio": each / bound, "threads": self.threads, **self.work._asdict(),
        }  # fmt: skip


def state_of(seed: int) -> State:
    """A filter that has driven one and a half laps."""
    params = params_of(filter={"particles": PARTICLES})
    drive = fold(read(cycle(seed, "medium", 1.8))[0], Crunch(params), lambda keyframe: None)
    path_filter = PathFilter(params.filter_params(), seed, threads=2)
    for keyframe in drive.keyframes[:VERTICES]:
        path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
    new, tree = drive.keyframes[VERTICES], path_filter.tree
    assert tree is not None
    path_filter.observations.add(new.walls)
    motion = between(path_filter.odometry, new.pose)
    step = step_of(motion, float(np.hypot(*motion[:2])), path_filter.noise)
    start = tree.grow()
    key = np.uint64(vertex_key(seed, path_filter.vertices))
    return State(path_filter, tree, new.walls, step, key, tree.nodes.poses[start : tree.n_nodes])


@njit(cache=True, nogil=True)
def look_back(nodes, leaves, vertex, poses, particles, seen, rule, weighs):
    """Find the nearest earlier nodes of all particles, block by block, and compare them if told to; number of pairs."""
    rows, squares = np.empty(BLOCK, np.int32), np.empty(BLOCK)
    near, where = np.empty((rule.neighbours, BLOCK)), np.empty((rule.neighbours, BLOCK), np.int64)
    cells = room_for_cells(rule)
    n_pairs = 0
    for first in range(0, leaves.size, BLOCK):
        end = min(first + BLOCK, leaves.size)
        for p in range(first, end):
            rows[p - first] = leaves[p]
        if find_near(nodes, rows, vertex, poses, rule, first, end, squares, near, where):
            for p in range(end - first):
                for place in range(rule.neighbours):
                    n_pairs += where[place, p] >= 0
            if weighs:
                weigh_by_points(nodes, vertex, poses, particles, seen, rule, first, end, where, cells)
    return n_pairs


def walked(state: State) -> tuple[float, float]:
    """Levels that a particle is compared with, and levels that it climbs or jumps to reach them; means."""
    tree, nodes, rule = state.tree, state.tree.nodes, state.path_filter.observations.rule
    visited = climbed = 0
    blocks = range(0, PARTICLES, BLOCK)
    for first in blocks:
        end = min(first + BLOCK, PARTICLES)
        box, rows = box_of(state.poses, first, end), tree.leaves[first:end].copy()
        level, goal = state.vertex - 1, state.vertex - rule.gap
        while goal >= 0:
            if not is_near(box, nodes.boxes[goal], rule.range):
                goal -= 1
                continue
            visited += 1
            climb(nodes, rows, end - first, level, goal)
            while level > goal:
                level -= STRIDE if level % STRIDE == 0 and level - STRIDE >= goal else 1
                climbed += 1
            apart = nodes.poses[nodes.starts[goal] + rows, :2] - state.poses[first:end, :2]
            goal = next_goal(nodes.ways, goal, float(np.min(np.hypot(*apart.T))) - rule.range)
    return visited / len(blocks), climbed / len(blocks)


def extension(state: State) -> Iterator[tuple[str, Measured]]:
    """What happens at every vertex: by parts, then in the one pass in which the filter does it."""
    n, particles, tree = PARTICLES, state.particles, state.tree
    observations = state.path_filter.observations
    seen, rule = observations.seen, observations.rule
    above = tree.nodes.poses[tree.nodes.starts[state.vertex - 1] : tree.nodes.starts[state.vertex]]
    moving = Work(bytes=72, flops=2 * GAUSSIAN + 32, calls=2.3)
    seconds = best_time(propagate, [(
        above, tree.leaves, state.step, state.key, particles.turn_biases, particles.scale_biases, 0, n, state.poses,
        particles.plausibilities,
    )])  # fmt: skip
    yield "move", Measured(seconds, n, "particle", moving)
    looking = tree.nodes, tree.leaves, state.vertex, state.poses, particles, seen, rule
    n_pairs = look_back(*looking, False)
    visited, climbed = walked(state)
    walking = Work(bytes=20, lookups=2 * visited + climbed, flops=(8 + 6 * rule.neighbours) * visited)
    found = best_time(look_back, [(*looking, False)])
    yield "find near nodes", Measured(found, n, "particle", walking)
    n_points = rule.pattern.x.size
    comparing = Work(lookups=2 * n_points, flops=POINT * n_points + 60, calls=4)
    compared = best_time(look_back, [(*looking, True)]) - found
    yield "compare a pair", Measured(compared, n_pairs, "pair", comparing)
    point = Work(*(part / n_points for part in comparing))
    yield "compare a pair, by point", Measured(compared, n_pairs * n_points, "point", point)
    direction = state.path_filter.params.direction
    aligning = Work(bytes=116, flops=90, calls=3)
    seconds = best_time(align, [(
        state.poses, particles, (0.8, 0.1), 10.0,
        direction.gain, direction.memory, direction.prior, direction.outliers, 0,
        n,
    )])  # fmt: skip
    yield "align with the walls' directions", Measured(seconds, n, "particle", aligning)
    whole = sum_of((moving, walking, comparing), (1.0, 1.0, n_pairs / n))
    arguments = tree.nodes, tree.leaves, state.vertex, particles, state.step, state.key, seen, rule
    for threads in (1, 2):
        parts = [(*arguments, n * part // threads, n * (part + 1) // threads) for part in range(threads)]
        name = "move, find, compare in one pass" + (", two threads" if threads == 2 else "")
        yield name, Measured(best_time(extend, parts), n, "particle", whole, threads)


def sum_of(works: tuple[Work, ...], times: tuple[float, ...]) -> Work:
    """So many times each work."""
    return Work(
        *(sum(part * often for part, often in zip(parts, times, strict=True)) for parts in zip(*works, strict=True))
    )


def resampling(state: State) -> Iterator[tuple[str, Measured]]:
    """What happens when the weights have become uneven."""
    n, particles, tree = PARTICLES, state.particles, state.tree
    log_weights, weights, sums = particles.log_weights.copy(), np.empty(n), np.empty((n // 4096 + 1, 2))
    n_blocks = -(-n // 4096)
    seconds = best_time(exponentials, [(log_weights, float(log_weights.max()), weights, sums, 0, n_blocks)])
    yield "weights out of their logarithms", Measured(seconds, n, "particle", Work(bytes=24, flops=5, calls=1))
    uneven = normalize(np.random.default_rng(0).normal(0.0, 1.0, n))
    seconds = best_time(systematic, [(uneven, 0.5, n)])
    yield "draw ancestors", Measured(seconds, n, "particle", Work(bytes=16, flops=6))
    ancestors, children = systematic(uneven, 0.5, n), equal_particles(np.empty(n), np.empty(n))
    seconds = best_time(inherit, [(particles, ancestors, 0.995, 1e-3, 1e-3, state.key, children, 0, n)])
    yield "inherit", Measured(seconds, n, "particle", Work(bytes=164, flops=2 * GAUSSIAN + 4))
    tree.settle()
    times = []
    for _ in range(5):  # it changes the tree
        fresh = copy.deepcopy(tree)
        before = time.thread_time()
        fresh.resample(ancestors)
        times.append(time.thread_time() - before)
    per_node = Work(bytes=64, flops=10)  # read and written once when packed, once when gaps are closed
    yield "prune the tree", Measured(min(times), tree.n_nodes, "node", per_node)


def run(seed: int) -> dict[str, Record]:
    """Every kernel on one drive's state."""
    state = state_of(seed)
    found = {name: measured.record() for name, measured in (*extension(state), *resampling(state))}
    return {name: {"seed": seed, **record, "ceilings": ceilings(1)._asdict()} for name, record in found.items()}


def rows(crew: Crew) -> Iterator[Row]:
    """One for each kernel."""
    found = [crew.alone(run, seed) for seed in range(crew.seeds)]
    for name in found[0]:
        if crew.wants(name):
            yield Row(name, [records[name] for records in found])


def notes(rows: list[Row]) -> Iterator[str]:
    """What the machine can do."""
    most = rows[0].records[0]["ceilings"]
    yield (
        f"At best on one thread: {most['bytes'] / 1e9:.1f} GB/s copied, {most['lookups'] / 1e9:.2f} look-ups, "
        f"{most['flops'] / 1e9:.1f} operations and {most['calls'] / 1e9:.3f} calls of log, exp, sin or cos per ns."
    )


BENCH = Bench(
    name="kernels",
    about="time per particle, pair, point and node of each kernel against the machine's roofline; 100,000 particles",
    rows=rows,
    columns=(
        Column("item", plain("item")),
        Column("items", middle("n", 0)),
        Column("ns each", middle("ns")),
        Column("at least (ns)", middle("bound_ns")),
        Column("bound by", plain("binds")),
        Column("ratio", middle("ratio", 1)),
    ),
    seeds=1,
    minutes=2,
    is_timed=True,
    heading="kernel",
    notes=notes,
)
