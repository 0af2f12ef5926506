"""The drives that the benchmarks run on, each made once and kept in `build/bench` by world, seed and source.

Simulated drives are ordinary recordings of the virtual robot with the truth beside them; real logs are found through
`CRUNCH_DATA` (see `data_folder`).
"""

from __future__ import annotations

import functools
import hashlib
import os
from pathlib import Path

import numpy as np

from firmware.virtual import ScriptedCrunch, VirtualCrunch, corridor_cycle, corridor_plan, load_world
from firmware.virtual.routes import tour
from server.config import Config
from server.formats.carmen import read_carmen
from server.formats.logs import Log
from server.formats.tum import read_tum
from server.recorded import open_log
from server.simulate import record, scripted

ROOT = Path(__file__).resolve().parent.parent
CACHE = ROOT / "build" / "bench"
SOURCES = {".c", ".h", ".py", ".toml"}  # of the firmware and the virtual robot
WIDTHS = (1.5, 1.8, 2.1, 2.4)  # m, corridor widths of the cycles in turn


def data_folder() -> Path | None:
    """Where the foreign recordings are, or None."""
    folder = Path(os.environ.get("CRUNCH_DATA", ROOT / "data"))
    return folder if folder.is_dir() else None


def truth_of(log: Path) -> Path:
    """The true poses beside a simulated recording."""
    return log.with_name(log.name + ".truth.tum")


@functools.cache
def firmware_hash() -> bytes:
    """Of everything that the virtual robot is made of: its recordings are only good as long as it stays."""
    digest = hashlib.sha256()
    for path in sorted((ROOT / "firmware").rglob("*")):
        if path.suffix in SOURCES and path.is_file():
            digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.digest()


def made(name: str, robot, longest: float, *sources: Path) -> Path:
    """The recording `name` of what `robot()` does, made now if it was not from this firmware and these sources."""
    digest = hashlib.sha256(firmware_hash())
    for source in sources:
        digest.update(hashlib.sha256(source.read_bytes()).digest())
    path = CACHE / f"{name}-{digest.hexdigest()[:8]}.rlog"
    if not truth_of(path).exists():
        record(robot(), "crunch", path, Config(), longest, None)
    return path


def cycle(seed: int, drift: str, width: float | None = None, is_reversed: bool = False, length: float = 50.0) -> Path:
    """Two laps and a bit of a corridor cycle; without a `width` (m) it goes round with the seed."""
    wide = width or WIDTHS[seed % len(WIDTHS)]
    plan = corridor_plan(seed, length, reverse=is_reversed)
    name = f"cycle-{length:g}-{drift}-{seed}" + (f"-{width:g}" if width else "") + ("-reversed" if is_reversed else "")

    def robot() -> VirtualCrunch:
        return VirtualCrunch(corridor_cycle(seed, length, wide), seed=seed, drift=drift, plan=plan)  # pyright: ignore

    return made(name, robot, 3.0 * plan.length / 0.3)


def floor(name: str, seed: int, drift: str, length: float = 250.0) -> Path:
    """A tour of about `length` m through the real floor plan `data/maps/NAME.map`."""
    data = data_folder()
    assert data is not None
    source = data / "maps" / f"{name}.map"
    world = load_world(source)
    plan = tour(world, length, seed)

    def robot() -> VirtualCrunch:
        return VirtualCrunch(world, seed=seed, drift=drift, plan=plan)  # pyright: ignore

    return made(f"floor-{name}-{drift}-{seed}", robot, 3.0 * plan.length / 0.3, source)


def semireal(name: str, seed: int) -> Path:
    """Crunch's senses in the building that the laser of `data/NAME` saw, on its path and with its real odometry."""
    data = data_folder()
    assert data is not None
    sources = data / name / f"{name}.log", data / name / "reference.tum"
    log = read_carmen(sources[0])
    times, reference = read_tum(sources[1])
    longest = float(times.max() - times.min())

    def robot() -> ScriptedCrunch:
        return scripted(log, times, reference, seed, data / name)

    return made(f"semireal-{name}-{seed}", robot, longest, *sources)


def read(path: Path) -> tuple[Log, np.ndarray, np.ndarray]:
    """A simulated recording as a log, with the times (n,) and poses (n, 3) of the truth."""
    times, poses = read_tum(truth_of(path))
    return open_log(path), times, poses
