"""Logs of several bumper carts to one map: each run makes a map of its own, and `slam.bump_merging` makes one of all.

What `crunch merge` does. Uses its siblings `recorded`, for our own recordings, `mapping`, for what a log
tells of its cart, and `maps`, `map_files` and `map_picture`, for what is written.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from server import config, map_files, map_picture
from server.errors import UserError
from server.formats.atomic import make_directory, write_atomically
from server.formats.ros_map import write_ros_map
from server.formats.tum import format_tum
from server.mapping import with_sensors
from server.maps import FloorMap, swept_map
from server.recorded import open_log
from server.report import describe_machine
from server.robots.bumper_cart import BumperCartParams, Run, runs_of
from slam.bump_finding import Recording
from slam.bump_frames import BumpFrameParams
from slam.bump_mapper import BumpMapper
from slam.bump_merging import BumpMergingParams, MergedMap, merge
from slam.cart_odometry import DRIVE

NAME = "bumper_cart"
Told = Callable[[int], None]  # of the runs that are done


class MergeOptions(NamedTuple):
    """What `crunch merge` was asked for besides its logs."""

    seed: int = 0
    file: Path | None = None
    assignments: Sequence[str] = ()


class CartRun(NamedTuple):
    """A run, what it is called, and how its cart is set up."""

    name: str
    run: Run
    params: BumperCartParams


def runs_in(paths: Sequence[Path], options: MergeOptions) -> list[CartRun]:
    """All runs of all logs, each of which counts as a cart; UserError where there are none."""
    found: list[CartRun] = []
    for path in paths:
        log = open_log(path, None, None, NAME)
        settings = config.load({}, options.file, log.configuration, options.assignments)
        params = with_sensors(settings.bumper_cart, log)
        runs = runs_of(log.messages(None), params)
        for number, run in enumerate(runs, 1):
            found.append(CartRun(path.stem if len(runs) == 1 else f"{path.stem}-{number}", run, params))
    if not found:
        raise UserError(f"{', '.join(map(str, paths))}: no stage of a cart's run; merge logs of Bumper Cart")
    names = [each.name for each in found]
    return [
        each._replace(name=each.name if names.count(each.name) == 1 else f"{row + 1}-{each.name}")
        for row, each in enumerate(found)
    ]


def merge_logs(
    paths: Sequence[Path], out: Path, options: MergeOptions, told: Told | None = None
) -> tuple[str, list[str]]:
    """Merge logs into the folder `out`; a line on the map, and warnings. UserError where a person can mend it."""
    make_directory(out)
    carts = runs_in(paths, options)
    recordings = []
    for done, (_, run, params) in enumerate(carts, 1):
        mapper = BumpMapper(params.build.params, params.mapper, options.seed)
        mapper.extend(run.stages)
        recordings.append(Recording(run.stages, mapper.cart, mapper.refine()))
        if told:
            told(done)
    try:
        whole = merge(recordings, carts[0].params.mapper)
    except ValueError as error:
        raise UserError(f"{', '.join(map(str, paths))}: {error}; merge longer runs") from None
    warnings = doubts(whole, [each.name for each in carts])
    write_outputs(out, carts, recordings, whole, warnings)
    used = len(carts) - len(whole.left_out)
    return f"{used} of {len(carts)} runs, {len(whole.lines)} walls", warnings


def doubts(whole: MergedMap, names: Sequence[str]) -> list[str]:
    """What a person should know: who is left out and why, and what the map rests on."""
    merging, found = BumpMergingParams(), []
    for cart in whole.left_out:
        if not np.isfinite(whole.excess[cart]):
            why = "it felt no wall twice"
        elif whole.shares[cart] < merging.finding.least_told:
            why = f"{100 * whole.shares[cart]:.0f} % of its bumps are on walls of the map"
        else:
            why = f"the map explains its bumps {whole.excess[cart]:.1f} nats each worse than the others'"
        found.append(f"{names[cart]} is left out: {why}; was it in the same area?")
    if len(whole.core) == 1 < len(names):
        found.append(f"no two maps agree, so that all rests on that of {names[whole.reference]}, which may be wrong")
    if whole.second > BumpFrameParams().doubtful:
        found.append("the map fits itself another way round; carts may lie in it turned by that")
    return found


def write_outputs(
    out: Path, carts: Sequence[CartRun], recordings: Sequence[Recording], whole: MergedMap, warnings: Sequence[str]
) -> None:
    """Map, picture, each cart's path in the common frame, and what is told of each."""
    used = [cart for cart in range(len(carts)) if cart not in whole.left_out]
    cart = recordings[whole.reference].cart
    grids = np.concatenate([whole.nodes[each] for each in used])
    trail = whole.nodes[whole.reference]
    floor = FloorMap(
        whole.nodes[whole.reference][1::2], whole.walls, len(trail) // 2,
        swept_map(grids, whole.walls, cart.bumper_width, cart.bumper_ahead), (trail, trail[-1:]),
    )  # fmt: skip
    assert floor.grid is not None
    table: list[Mapping[str, Any]] = []
    for number, (each, nodes) in enumerate(zip(carts, whole.nodes, strict=True)):
        if len(nodes):
            ends = [row for row, stage in enumerate(each.run.stages) if stage.kind == DRIVE]
            times = np.array(each.run.times)[ends]
            write_atomically(out / f"{each.name}.tum", format_tum(times, nodes[1::2]))
        row = {"run": each.name, "bumps": int(np.sum(recordings[number].area.is_bump)), "is_merged": number in used}
        row["share_on_walls"] = round(float(whole.shares[number]), 3)
        excess = float(whole.excess[number])
        row["excess_cost_per_bump"] = round(excess, 3) if np.isfinite(excess) else None
        table.append(row)
    write_ros_map(out / "map", floor.grid)
    write_atomically(out / "map.json", map_files.map_json(floor, NAME))
    title = f"{len(used)} carts, {len(whole.lines)} walls"
    write_atomically(out / "map.png", map_picture.draw_png(floor, title, f"path of {carts[whole.reference].name}"))
    report = {
        "reference": carts[whole.reference].name, "core": [carts[each].name for each in whole.core], "runs": table,
        "second": round(whole.second, 3), "warnings": list(warnings), "versions": describe_machine(),
    }  # fmt: skip
    write_atomically(out / "merge.json", json.dumps(report, indent=2) + "\n")  # last: the folder is complete
