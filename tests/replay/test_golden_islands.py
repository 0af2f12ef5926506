"""Islands still weigh and believe what they did: `lap.rlog` again, with particles enough for four of them.

With the track as it is every island finds the way. With one so much too wide that only an odometry of large bias
explains the drive, the first island alone does, and `lap.islands.tum` is the path that it tells. Write it again with
`python -m tests.replay.test_golden_islands` when the estimator has become better, and say so in the commit.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from server import config
from server.formats.tum import read_tum, write_tum
from server.recorded import open_log
from server.replay import Result, fold, run_log, with_sensors
from server.robots.crunch import Crunch, CrunchParams, make_estimator
from slam.islands import Islands
from slam.refined_filter import RefinedFilter

HERE = Path(__file__).parent
SEED = 3
TOO_WIDE = 0.27  # m between the wheels, where there are 0.19


def params_of(track: float = TOO_WIDE, **changes: float) -> CrunchParams:
    """The default, on four islands and no more."""
    return config.load({"crunch": {"track": track, "restarts": 0, "filter": {"particles": 5000} | changes}}).crunch


def replayed(threads: int = 1) -> Result:
    """The recording, mapped with a track too wide."""
    return run_log(open_log(HERE / "lap.rlog"), params_of(), SEED, threads)


def driven(params: CrunchParams, threads: int = 1) -> tuple[RefinedFilter, Islands]:
    """The recording's vertices, filtered but not refined."""
    log = open_log(HERE / "lap.rlog")
    params = with_sensors(params, log)
    path_filter = make_estimator(params, SEED, threads)
    fold(log, Crunch(params), lambda keyframe: path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled))
    assert isinstance(path_filter.path_filter, Islands)
    return path_filter, path_filter.path_filter


def test_each_island_weighs_its_paths_as_it_did():
    """Nothing is resampled, so that the last bits, in which processors differ, stay last bits."""
    _, islands = driven(params_of(0.19, threshold=0.0))
    affinities = [float(np.mean(island.particles.affinities)) for island in islands.filters]
    plausibilities = [float(np.mean(island.particles.plausibilities)) for island in islands.filters]
    np.testing.assert_allclose(affinities, [9.267, -9.704, 19.763, -9.764], atol=0.02)
    np.testing.assert_allclose(plausibilities, [-62.131, -56.708, -56.658, -56.808], atol=0.02)


def test_the_island_that_alone_found_the_way_is_told():
    path_filter, islands = driven(params_of())
    islands.believe(3)
    path_filter.refine()
    refinement = path_filter.refinement()
    scores = [path_filter.score(refinement, refinement.refine(path).path) for path in islands.candidates()]
    assert islands.believed == 0
    assert scores[0] > 10.0 + max(scores[1:])


def test_the_path_that_is_told_is_the_one_it_was():
    golden = read_tum(HERE / "lap.islands.tum")[1]
    np.testing.assert_allclose(replayed().path[:, :2], golden[:, :2], atol=0.01)


def test_threads_change_no_island():
    (_, one), (_, two) = driven(params_of()), driven(params_of(), threads=2)
    assert [path.tobytes() for path in one.candidates()] == [path.tobytes() for path in two.candidates()]
    assert replayed().trajectory.tobytes() == replayed(threads=2).trajectory.tobytes()


if __name__ == "__main__":
    found = replayed()
    write_tum(HERE / "lap.islands.tum", found.drive.times[found.drive.rows], found.path)
