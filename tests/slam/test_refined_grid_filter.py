"""The filter of grids with its loops closed: the same face as Crunch's estimator, and the better path."""

import numpy as np
import pytest

from slam.evaluate import absolute_error
from slam.grid_filter import GridFilter, GridFilterParams
from slam.refined_grid_filter import RefinedGridFilter
from slam.scan_graph import DoubtParams, ScanGraph, ScanGraphParams
from tests.slam.laser_world import around, odometry_of, ring, seen_at


def drive(seed=0, laps=1.6):
    poses = around(laps, step=0.4)
    odometry = odometry_of(poses, np.random.default_rng(seed), 0.01, 0.02, 0.01)
    return poses, odometry, [seen_at(pose, ring(), 50 * seed + k) for k, pose in enumerate(poses)]


def run(odometry, walls, particles=6, seed=0, **changes):
    found = RefinedGridFilter(GridFilter(GridFilterParams(particles=particles), seed), ScanGraphParams(**changes))
    for pose, seen in zip(odometry, walls, strict=True):
        found.extend(pose, seen)
    return found


def test_refining_betters_the_path_and_new_vertices_hang_on_its_end():
    poses, odometry, walls = drive()
    known = len(poses) - 10
    found = run(odometry[:known], walls[:known])
    assert found.is_rough
    before = found.estimate().path.astype(float)
    found.refine()
    assert not found.is_rough
    after = found.estimate().path
    assert absolute_error(after, poses[:known]).translation.rmse < 0.08
    assert found.correction is not None
    assert np.array_equal(found.correction.before, before)
    for pose, seen in zip(odometry[known:], walls[known:], strict=True):
        found.extend(pose, seen)
    assert found.is_rough
    assert absolute_error(found.estimate().path, poses).translation.rmse < 0.1


def test_a_quick_refinement_is_followed_by_a_whole_one_that_knows_nothing_of_it():
    _, odometry, walls = drive()
    found, fresh = run(odometry[:-20], walls[:-20]), run(odometry, walls)
    found.refine()
    for pose, seen in zip(odometry[-20:], walls[-20:], strict=True):
        found.extend(pose, seen)
    assert found.is_due
    found.refine(is_quick=True)
    assert found.is_rough
    assert not found.is_due
    found.refine()
    fresh.refine()
    assert not found.is_rough
    assert found.estimate().path.tobytes() == fresh.estimate().path.tobytes()


def test_uncertainty_is_of_every_vertex_old_and_new():
    _, odometry, walls = drive(laps=0.6)
    found = run(odometry[:-3], walls[:-3])
    assert found.uncertainty(1).source == "particles"
    found.refine()
    for pose, seen in zip(odometry[-3:], walls[-3:], strict=True):
        found.extend(pose, seen)
    told = found.uncertainty(4)
    assert told.source == "refinement"
    assert told.deviations.shape == (len(odometry), 3)
    assert np.all(np.isfinite(told.deviations))
    assert told.branches is not None


def test_switched_off_it_is_the_filter():
    _, odometry, walls = drive(laps=0.4)
    found = run(odometry, walls, rounds=0)
    assert not found.is_rough
    found.refine()
    assert np.array_equal(found.estimate().path, found.path_filter.estimate().path)


def test_particles_come_and_go_and_every_kernel_is_prepared():
    _, odometry, walls = drive(laps=0.4)
    found = run(odometry[:5], walls[:5])
    found.prepare()
    found.resize(3)
    assert found.n_particles == 3
    found.extend(odometry[5], walls[5])
    found.resize(9)
    found.extend(odometry[6], walls[6])
    assert found.estimate().n_particles == 9
    with pytest.raises(ValueError, match="at least"):
        found.resize(0)


def test_loops_that_fold_the_map_are_dropped_and_told():
    poses, odometry, walls = drive(laps=1.3)
    found = run(odometry, walls)
    found.refine()
    assert found.dropped == 0
    graph = ScanGraph(np.array(found.odometry), found.path_filter.scans, found.params)
    graph.associate(poses, 1.0)
    n_loops = len(graph.loops.pairs)
    assert n_loops > 5
    folded = poses.copy()
    folded[len(poses) // 2 :, :2] += [-1.5, 0.5]  # the second half slid over the first
    chosen = found.chosen(graph, folded, poses, lambda: None)
    assert chosen is poses
    assert found.dropped == n_loops
    assert not len(graph.loops.pairs)
    graph.associate(poses, 1.0)
    assert found.chosen(graph, poses, folded, lambda: None) is poses
    assert (found.dropped, len(graph.loops.pairs)) == (0, n_loops)


@pytest.mark.parametrize("seed", range(3))
def test_loops_beyond_the_drift_that_is_usual_are_found_where_revisits_disagree(seed):
    poses, odometry, walls = drive(seed)
    steady = {"turn": 1e-4, "distance": 1e-3}  # the odometry here errs by far more
    blind, wary = (run(odometry, walls, 2, seed, **steady, doubt=DoubtParams(share=share)) for share in (0.0, 0.9))
    paths = []
    for found in (blind, wary):
        graph = found.graph()
        after, path = found.doubted(graph, graph.refine(odometry), odometry, lambda: None)
        assert (after is graph) == (found is blind)
        paths.append(path)
    missed, closed = (absolute_error(path, poses).translation.rmse for path in paths)
    assert closed < 0.06 < 0.3 < missed
