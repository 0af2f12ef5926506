"""The path filter against a twin without tree, boxes and jumps; it closes loops, and resamples only when it must."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam import islands
from slam.comparison import pair_affinity, room_for_cells
from slam.islands import Islands
from slam.local_search import LocalSearch, LocalSearchParams
from slam.motion import MotionParams
from slam.particles import BLOCK, find_near, insert, is_near
from slam.path_filter import PathFilter, PathFilterParams
from slam.path_tree import PathTree
from slam.pose import compose, wrap
from slam.refined_filter import RefinedFilter
from slam.refinement import RefinementParams
from slam.resampling import systematic
from slam.wall_direction import wall_direction
from slam.walls import Walls
from tests.naive import path_filter as naive
from tests.slam.drives import N_RAYS, REACH, SPACING, laps, revisit_errors

NOISE = {"turn_noise": 0.03, "distance_noise": 0.03, "rotation_noise": 0.03}
MOTION = NOISE | {"turn_bias": 0.03, "scale_bias": 0.03, "jitter": 0.1}
AFFINITY = {"kind": "points", "states": 3, "n_points": 64, "spread": 0.6, "gain": 5.0}
COMPARISON = {"neighbours": 3, "range": 0.8, "gap": 8, "affinity": AFFINITY}
DIRECTION = {"gain": 1.0, "memory": 0.9, "prior": 2.0, "outliers": 0.15}
THESIS = {
    "motion": NOISE | {"turn_bias": 0.0, "scale_bias": 0.0, "jitter": 0.0},
    "direction": {"gain": 0.0},
}  # with either of its two affinities
SEGMENTS = COMPARISON | {"affinity": {"kind": "segments", "segment_scale": 0.1, "segment_gain": 10.0}}
INSIDE_OUTSIDE = COMPARISON | {
    "affinity": AFFINITY | {"states": 2, "both_free": 1.0, "both_wall": 1.0, "differ": -1.0, "gain": 1.0}
}
SMALL_LAPS = {"width": 3.0, "height": 2.5}


def params_of(**changes):
    """Parameters that do not follow the defaults."""
    return PathFilterParams.model_validate(
        {
            "particles": 600,
            "threshold": 0.5,
            "reach": REACH,
            "motion": MOTION,
            "comparison": COMPARISON,
            "direction": {"gain": 0.0},
        }
        | changes
    )


def run(path_filter, drive, first=0, last=None):
    """Feed vertices first..last of a drive."""
    for k in range(first, len(drive.truth) if last is None else last):
        path_filter.extend(drive.odometry[k], drive.walls[k], drive.travelled[k])
    return path_filter


def nothing_seen():
    return Walls(np.full(N_RAYS, math.inf), np.zeros(N_RAYS))


CONFIGURATIONS = {
    "points": {},
    "points and directions": {"direction": DIRECTION},
    "wary points": {"comparison": COMPARISON | {"chance": 0.6}},
    "segments": {"comparison": SEGMENTS},
    "thesis, segments": THESIS | {"comparison": SEGMENTS},
    "thesis, points": THESIS | {"comparison": INSIDE_OUTSIDE},
    "wide and near": {"comparison": COMPARISON | {"range": 2.5, "neighbours": 7, "gap": 1}, "threshold": 0.9},
}


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_filter_agrees_with_whole_paths_compared_with_everything(name):
    """Same random numbers: same resamplings, same paths and the same log weights on two laps."""
    params = params_of(particles=40, **CONFIGURATIONS[name])
    drive = laps(2.2, turn_bias=0.01, scale_bias=0.01, seed=3, **SMALL_LAPS)
    found = PathFilter(params, seed=11)

    def score(a, pose_a, b, pose_b):
        seen = found.observations
        xa, ya, theta_a = pose_a
        xb, yb, theta_b = pose_b
        return pair_affinity(seen.seen, found.rule, a, xa, ya, theta_a, b, xb, yb, theta_b, room_for_cells(found.rule))

    twin = naive.PathFilter(params, 11, found.rule, score, wall_direction)
    for k, pose in enumerate(drive.odometry):
        found.extend(pose, drive.walls[k], drive.travelled[k])
        twin.extend(pose, drive.walls[k], drive.travelled[k])
        assert found.resamplings == len(twin.resampled_at)
        np.testing.assert_allclose(found.particles.log_weights, [p.log_weight for p in twin.particles], atol=1e-4)
    assert twin.resampled_at
    assert found.tree is not None
    for p, particle in enumerate(twin.particles):
        off = found.tree.path(p) - np.array(particle.path)
        np.testing.assert_allclose(off[:, :2], 0.0, atol=1e-4)
        np.testing.assert_allclose(wrap(off[:, 2]), 0.0, atol=1e-4)
    np.testing.assert_allclose(found.particles.affinities, [p.affinity for p in twin.particles], atol=1e-3)
    np.testing.assert_allclose(found.particles.plausibilities, [p.plausibility for p in twin.particles], atol=1e-9)
    np.testing.assert_allclose(found.particles.turn_biases, [p.turn_bias for p in twin.particles], atol=1e-12)
    np.testing.assert_allclose(found.particles.scale_biases, [p.scale_bias for p in twin.particles], atol=1e-12)


@pytest.mark.parametrize("particles", [59, 600])  # 2^H of 59 equal weights rounds to less than 59
@pytest.mark.parametrize("threshold", [0.5, 1.0])
def test_without_comparisons_weights_stay_equal_and_nothing_is_resampled(particles, threshold):
    """Resampling with nothing new only loses particles (thesis, 2.7)."""
    drive = laps(2.2, seed=4, **SMALL_LAPS)
    found = PathFilter(params_of(particles=particles, threshold=threshold), seed=1)
    for k, pose in enumerate(drive.odometry):
        found.extend(pose, nothing_seen(), drive.travelled[k])
        assert found.effective == pytest.approx(particles)
    assert found.resamplings == 0
    assert not found.particles.log_weights.any()
    np.testing.assert_allclose(found.estimate().profile[1:], 1.0)


@pytest.mark.parametrize("threshold", [0.0, 0.2, 0.5, 0.9])
def test_resampling_happens_just_when_too_few_particles_are_effective(threshold):
    drive = laps(2.2, turn_bias=0.01, seed=5, **SMALL_LAPS)
    found = PathFilter(params_of(particles=200, threshold=threshold), seed=2)
    for k, pose in enumerate(drive.odometry):
        before = found.resamplings
        found.extend(pose, drive.walls[k], drive.travelled[k])
        was_resampled = found.resamplings > before
        assert was_resampled == (found.effective < threshold * 200)
        assert was_resampled == (
            found.resamplings > 0 and not found.particles.log_weights.any() and found.effective < 199.99
        )
    assert (found.resamplings > 0) == (threshold > 0.0)


@pytest.mark.parametrize(("turn_bias", "scale_bias"), [(0.02, 0.02), (-0.03, 0.02), (0.03, -0.03)])
@pytest.mark.parametrize("seed", range(3))
def test_a_loop_is_closed_that_odometry_leaves_open(turn_bias, scale_bias, seed):
    drive = laps(2.0, turn_bias=turn_bias, scale_bias=scale_bias, seed=seed)
    path = run(PathFilter(params_of(), seed=seed), drive).estimate().path
    assert np.median(revisit_errors(drive.odometry, drive)) > 0.9
    assert np.median(revisit_errors(path, drive)) < 0.15
    assert np.quantile(revisit_errors(path, drive), 0.9) < 0.35


@pytest.mark.parametrize("comparison", [SEGMENTS, INSIDE_OUTSIDE])
def test_the_literal_thesis_runs_and_helps(comparison):
    errors, raw = [], []
    for seed in range(3):
        drive = laps(2.0, turn_bias=0.01, scale_bias=0.01, seed=seed)
        params = params_of(particles=300, comparison=comparison, **THESIS)
        path = run(PathFilter(params, seed=seed), drive).estimate().path
        assert np.all(np.isfinite(path))
        errors.append(np.median(revisit_errors(path, drive)))
        raw.append(np.median(revisit_errors(drive.odometry, drive)))
    assert np.mean(errors) < 0.6 * np.mean(raw)


def test_wall_directions_keep_the_heading_without_any_loop():
    """Straight ahead for 20 m: no place is seen twice, but the walls say which way is straight."""
    drive = laps(1.0, width=20.0, height=2.0, turn_bias=0.03, seed=6)
    headings = {}
    for gain in (0.0, 1.0):
        params = params_of(direction=DIRECTION | {"gain": gain})
        ends = [run(PathFilter(params, seed), drive, last=39).estimate().path[-1, 2] for seed in range(6)]
        headings[gain] = np.sqrt(np.mean(np.square(ends)))
    assert abs(drive.odometry[38, 2]) > 0.4
    assert headings[1.0] < 0.6 * headings[0.0]


ESTIMATORS = {
    "filter": lambda: PathFilter(params_of(particles=60), seed=1),
    "islands": lambda: Islands(params_of(particles=60, islands=3), seed=1),
    "refined islands": lambda: RefinedFilter(
        Islands(params_of(particles=60, islands=3), seed=1), MotionParams.model_validate(MOTION), RefinementParams()
    ),
    "search": lambda: LocalSearch(
        LocalSearchParams.model_validate(
            {"perturbations": 5, "reach": REACH, "motion": MOTION, "comparison": COMPARISON}
        ),
        seed=1,
    ),
}


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("pose", [[math.nan, 0.0, 0.0], [0.0, math.inf, 0.0], [0.0, 0.0, -math.inf]])
def test_a_pose_that_is_no_number_is_refused_and_nothing_is_added(monkeypatch, name, pose):
    monkeypatch.setattr(islands, "SMALLEST", 20)
    drive = laps(1.3, noise=1.0, seed=2, **SMALL_LAPS)
    found, undisturbed = ESTIMATORS[name](), run(ESTIMATORS[name](), drive)
    for first, vertex in ((0, 0), (0, 1), (1, 9)):
        run(found, drive, first, vertex)
        with pytest.raises(ValueError, match=f"vertex {vertex}"):
            found.extend(np.array(pose), drive.walls[0], 0.5)
        for way in (-0.5, math.inf, math.nan):
            with pytest.raises(ValueError, match=f"{way} m travelled"):
                found.extend(drive.odometry[vertex], drive.walls[0], way)
    run(found, drive, 9)
    if isinstance(found, RefinedFilter):
        found.refine()
        undisturbed.refine()
    assert len(found.estimate().path) == len(drive.truth)
    assert found.estimate().path.tobytes() == undisturbed.estimate().path.tobytes()
    assert found.estimate().affinity == undisturbed.estimate().affinity != 0.0


# Chance


def fingerprint(found):
    estimate = found.estimate()
    return estimate.path.tobytes() + estimate.profile.tobytes() + found.particles.log_weights.tobytes()


def test_the_same_seed_is_the_same_path_and_another_seed_another():
    drive = laps(1.5, turn_bias=0.01, seed=7, **SMALL_LAPS)
    prints = [fingerprint(run(PathFilter(params_of(particles=150), seed=seed), drive)) for seed in (5, 5, 6)]
    assert prints[0] == prints[1] != prints[2]


def test_a_filter_fed_again_is_where_the_old_one_was():
    """What a restarted worker relies on: nothing but the vertices and the seed matters."""
    drive = laps(1.5, turn_bias=0.01, seed=8, **SMALL_LAPS)
    old = run(PathFilter(params_of(particles=150), seed=5), drive, last=20)
    for _ in range(3):
        old.estimate()
    run(old, drive, first=20)
    assert fingerprint(old) == fingerprint(run(PathFilter(params_of(particles=150), seed=5), drive))


# Size


def weighted(found):
    """Mean (2,) and spread (2,) of the newest places under the weights."""
    weights = np.exp(found.particles.log_weights - found.particles.log_weights.max())
    weights /= weights.sum()
    places = found.tree.newest(np.arange(found.n_particles))[:, :2]
    mean = weights @ places
    return mean, np.sqrt(weights @ (places - mean) ** 2)


@pytest.mark.parametrize("size", [500, 1999, 6000])
def test_another_number_of_particles_is_the_same_distribution(size):
    drive = laps(1.25, turn_bias=0.01, seed=9, **SMALL_LAPS)
    found = run(PathFilter(params_of(particles=2000, threshold=0.02), seed=4), drive)
    assert found.particles.log_weights.std() > 0.5
    (mean, spread), effective = weighted(found), found.effective
    found.resize(size)
    assert found.n_particles == size
    assert (found.particles.log_weights == found.particles.log_weights[0]).all()
    resized_mean, resized_spread = weighted(found)
    bound = 5.0 / math.sqrt(min(size, effective))
    np.testing.assert_allclose(resized_mean, mean, atol=bound * spread.max())
    np.testing.assert_allclose(resized_spread, spread, rtol=bound)
    estimate = found.estimate()
    assert estimate.n_particles == estimate.effective_particles == size
    assert estimate.path.shape == drive.truth.shape
    run(found, drive, first=0, last=3)
    assert found.n_particles == size


def test_shedding_and_taking_back_particles_still_closes_the_loop():
    drive = laps(2.0, turn_bias=0.02, scale_bias=0.02, seed=1)
    found = run(PathFilter(params_of(particles=1000), seed=1), drive, last=20)
    found.resize(300)
    run(found, drive, first=20, last=35)
    found.resize(1000)
    path = run(found, drive, first=35).estimate().path
    assert np.median(revisit_errors(path, drive)) < 0.25


def test_a_filter_can_be_resized_before_it_sees_anything():
    found = PathFilter(params_of(particles=50))
    found.resize(80)
    drive = laps(1.0, seed=1, **SMALL_LAPS)
    assert run(found, drive, last=5).estimate().n_particles == 80


# Whatever comes


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_degenerate_input_is_survived(name):
    """No walls, no way, turns on the spot, walls everywhere, thousands of metres: numbers stay numbers."""
    found = PathFilter(params_of(particles=50, **CONFIGURATIONS[name]), seed=1)
    pose = np.zeros(3)
    full = Walls(np.full(N_RAYS, 0.3), np.full(N_RAYS, 0.25))
    one = Walls(np.r_[0.5, np.full(N_RAYS - 1, math.inf)], np.full(N_RAYS, 0.5))
    cases = [(0.0, 0.0, 0.0)] * 12 + [(0.0, 0.0, 3.0)] * 6 + [(2000.0, 0.0, 0.1)] * 4 + [(-0.5, 0.0, -3.1)] * 6
    for k, motion in enumerate(cases):
        pose = compose(pose, np.array(motion))
        found.extend(pose, (nothing_seen(), full, one)[k % 3], None if k % 2 else abs(motion[0]))
        estimate = found.estimate()
        assert np.all(np.isfinite(estimate.path))
        assert np.all(np.isfinite(estimate.particles))
        assert np.isfinite([estimate.affinity, estimate.plausibility, estimate.effective_particles]).all()
        assert np.all(np.isfinite(found.particles.log_weights))


def test_one_particle_is_a_filter_too():
    drive = laps(1.3, seed=2, **SMALL_LAPS)
    found = run(PathFilter(params_of(particles=1), seed=3), drive)
    estimate = found.estimate()
    assert estimate.resamplings == 0
    assert estimate.fixed_depth == len(drive.truth) - 1
    np.testing.assert_array_equal(estimate.profile, 1.0)


def test_before_the_first_vertex_there_is_no_estimate():
    with pytest.raises(RuntimeError, match="no vertex"):
        PathFilter(params_of(particles=10)).estimate()


def test_the_estimate_is_the_best_particles():
    drive = laps(1.6, turn_bias=0.01, seed=3, **SMALL_LAPS)
    found = run(PathFilter(params_of(particles=100), seed=3), drive)
    estimate = found.estimate(max_particles=30)
    best = found.particles.affinities + found.particles.plausibilities
    assert estimate.affinity + estimate.plausibility == pytest.approx(best.max())
    assert estimate.path.shape == (len(drive.truth), 3)
    assert estimate.particles.shape == (30, 3)
    assert estimate.profile[0] == pytest.approx(0.01)
    assert np.all(np.diff(estimate.profile) >= 0.0)
    assert 1.0 <= estimate.effective_particles <= 100.0
    np.testing.assert_allclose(estimate.path[0], drive.odometry[0], atol=1e-6)
    steps = np.hypot(*np.diff(estimate.path[:, :2], axis=0).T)
    assert np.all(np.abs(steps - SPACING) < 0.2)


# Boxes and lists


@pytest.mark.parametrize("seed", range(20))
def test_boxes_are_near_when_some_of_their_points_are(seed):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-5.0, 5.0, (2, 2))
    box, other = (tuple(np.concatenate([corner, corner + rng.uniform(0.0, 3.0, 2)])) for corner in corners)
    nearest = [max(box[axis] - other[axis + 2], other[axis] - box[axis + 2], 0.0) for axis in range(2)]
    distance = math.hypot(*nearest)
    assert is_near(box, other, distance + 1e-9)
    assert distance == 0.0 or not is_near(box, other, distance - 1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_the_nearest_levels_are_those_that_sorting_finds(seed):
    rng = np.random.default_rng(seed)
    n_kept, n, n_levels = int(rng.integers(1, 6)), 7, int(rng.integers(1, 12))
    squares = rng.uniform(0.0, 2.0, (n_levels, n))
    near, where = np.full((n_kept, 9), 1.0), np.full((n_kept, 9), -1)
    for level in range(n_levels):
        insert(near, where, squares[level], level << 32, np.arange(n, dtype=np.int32), n)
    for k in range(n):
        within = [level for level in np.argsort(squares[:, k]) if squares[level, k] < 1.0][:n_kept]
        assert [item for item in where[:, k].tolist() if item >= 0] == [(level << 32) + k for level in within]
        np.testing.assert_array_equal(near[: len(within), k], squares[within, k])
    assert np.all(where[:, n:] == -1), "particles beyond the last are left alone"


def there_and_back(rng, n_particles, n_levels, noise):
    """A tree of paths along a corridor, back and forth, resampled now and then; the newest poses (n, 3)."""
    tree, way = PathTree(n_particles, np.zeros(3)), 0.5
    for _ in range(1, n_levels):
        if rng.random() < 0.05:
            tree.resample(systematic(rng.dirichlet(np.full(n_particles, 0.3)), rng.random(), n_particles))
        way *= -1.0 if rng.random() < 0.04 else 1.0
        poses = tree.newest(np.arange(n_particles)) + np.array([way, 0.0, 0.0])
        poses[:, :2] += rng.normal(0.0, noise, (n_particles, 2))
        start = tree.grow()
        tree.nodes.poses[start : tree.n_nodes] = poses
        tree.nodes.parents[start : tree.n_nodes] = tree.leaves
        tree.settle()
    return tree, tree.newest(np.arange(n_particles))


@pytest.mark.parametrize("noise", [0.003, 0.05, 0.3])  # hardly longer than they must be, or crooked
@pytest.mark.parametrize("seed", range(8))
def test_the_near_nodes_are_those_of_every_path_looked_at_whole(seed, noise):
    rng = np.random.default_rng(seed)
    n_particles, n_levels = BLOCK // 2, 250
    tree, before = there_and_back(rng, n_particles, n_levels, noise)
    rule = PathFilter(params_of()).observations.rule
    poses = before + np.array([*rng.uniform(-1.0, 1.0, 2), 0.0])
    rows, squares = tree.leaves.copy(), np.empty(n_particles)
    near, where = np.empty((rule.neighbours, n_particles)), np.full((rule.neighbours, n_particles), -1)
    find_near(tree.nodes, rows, n_levels, poses, rule, 0, n_particles, squares, near, where)
    for p in range(n_particles):
        path = tree.path(p)[: n_levels - rule.gap + 1, :2]
        apart = np.sum((path - poses[p, :2]) ** 2, axis=1)
        found = [item >> 32 for item in where[:, p].tolist() if item >= 0]
        nearest = np.sort(apart[apart < rule.range**2])[: rule.neighbours]  # levels may tie, distances may not
        np.testing.assert_array_equal(apart[found], nearest)
        assert len(set(found)) == len(found)
