"""Neither threads, nor the process, nor the hash seed, nor other filters change what a seed gives."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from slam.path_filter import PathFilter, PathFilterParams
from tests.slam.drives import REACH, laps

ROOT = Path(__file__).parents[2]
PARTICLES = 5301  # several blocks, which no number of threads divides


def digest(seed, threads, kind="points"):
    """Of everything that a run of the filter gives."""
    params = PathFilterParams.model_validate(
        {"particles": PARTICLES, "reach": REACH, "threshold": 0.5, "comparison": {"affinity": {"kind": kind}}}
    )
    drive = laps(2.2, width=3.0, height=2.5, turn_bias=0.01, seed=1)
    found = PathFilter(params, seed, threads)
    for pose, walls, travelled in zip(drive.odometry, drive.walls, drive.travelled, strict=True):
        found.extend(pose, walls, travelled)
    assert found.resamplings > 0
    estimate = found.estimate()
    parts = (
        estimate.path,
        estimate.profile,
        estimate.particles,
        found.particles.log_weights,
        found.particles.affinities,
    )
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


@pytest.mark.parametrize("kind", ["points", "segments"])
def test_any_number_of_threads_gives_the_same_bytes(kind):
    assert len({digest(3, threads, kind) for threads in (1, 2, 3, 7)}) == 1


def test_more_threads_than_particles_are_no_harm():
    found = [PathFilter(PathFilterParams(particles=2), 1, threads) for threads in (1, 5)]
    drive = laps(1.5, width=3.0, height=2.5)
    for pose, walls in zip(drive.odometry, drive.walls, strict=True):
        for path_filter in found:
            path_filter.extend(pose, walls)
    assert found[0].estimate().path.tobytes() == found[1].estimate().path.tobytes()


def test_another_seed_gives_other_bytes():
    assert len({digest(seed, 2) for seed in (3, 4, 5)}) == 3


def test_another_process_with_another_hash_seed_gives_the_same_bytes():
    code = "from tests.slam.test_threads import digest; print(digest(3, 2))"
    environment = os.environ | {"PYTHONHASHSEED": "12345"}
    found = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    assert found.stdout.strip() == digest(3, 1)
