"""What is compiled before a run is all that the run needs: nobody waits for a kernel while the robot drives."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

from server import config
from server.filter_worker import estimate_of
from server.recorded import open_log
from server.replay import run_log, warm_up
from server.robots.crunch import CrunchParams, make_estimator
from slam.islands import Islands
from tests.slam.drives import laps

ROOT = Path(__file__).parents[2]
LAP = ROOT / "tests" / "replay" / "lap.rlog"
SEVERAL = {"filter": {"particles": 5000}}  # four islands
CHANGES = {
    "default": SEVERAL,
    "bundled": SEVERAL | {"bundle": {"rounds": 14}},
    "search": {"estimator": "search", "perturbations": 5},
    "unrefined": SEVERAL | {"refinement": {"rounds": 0}},
}


def params_of(name: str) -> CrunchParams:
    """Settings by name, sensors included."""
    return config.load({"crunch": CHANGES[name]}).crunch


def compiled() -> dict[str, int]:
    """How many signatures each kernel that Python has called is there for."""
    found = {
        f"{module}.{name}": len(kernel.signatures)
        for module, inside in list(sys.modules.items())
        if module.startswith(("slam.", "server."))
        for name, kernel in vars(inside).items()
        if isinstance(kernel, Dispatcher)
    }
    return {name: number for name, number in found.items() if number > 0}


def replay(name: str) -> dict[str, list[int]]:
    """Kernels of which a replay needs more than its warm-up made."""
    params = params_of(name)
    warm_up(params, 1)
    before = compiled()
    run_log(open_log(LAP), params)
    return grown(before)


def work(name: str) -> dict[str, list[int]]:
    """Kernels of which the live worker's filter needs more than it prepared."""
    path_filter = make_estimator(params_of(name))
    path_filter.prepare()
    before = compiled()
    drive = laps(1.5, noise=1.0, seed=1)
    for pose, walls, travelled in zip(drive.odometry, drive.walls, drive.travelled, strict=True):
        path_filter.extend(pose, walls, float(travelled))
        if path_filter.is_due:
            path_filter.refine(is_quick=True)
    path_filter.resize(path_filter.n_particles // 2)
    path_filter.refine()
    estimate_of(path_filter, 0.0, 100)
    return grown(before)


def grown(before: dict[str, int]) -> dict[str, list[int]]:
    """How many signatures kernels had and have, of those that got more."""
    return {name: [before.get(name, 0), now] for name, now in compiled().items() if now != before.get(name, 0)}


def in_fresh_process(task: str, name: str) -> dict[str, list[int]]:
    """What a task finds where nothing was compiled or loaded before."""
    code = f"import json; from tests.server.test_warm_up import {task}; print(json.dumps({task}({name!r})))"
    found = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    return json.loads(found.stdout)


@pytest.mark.parametrize("name", CHANGES)
def test_a_replay_needs_no_kernel_that_its_warm_up_did_not_make(name):
    assert in_fresh_process("replay", name) == {}


@pytest.mark.parametrize("name", ["default", "search"])
def test_the_live_worker_needs_no_kernel_that_it_did_not_prepare(name):
    assert in_fresh_process("work", name) == {}


def test_the_default_has_several_islands():
    path_filter = make_estimator(params_of("default")).path_filter
    assert isinstance(path_filter, Islands)
    assert len(path_filter.filters) == 4
