"""Relative poses verified by hand: `t1 t2 x y z roll pitch yaw` (Kuemmerle et al., Autonomous Robots 27, 2009)."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from server.formats.errors import FormatError, read_lines

REMEDY = "each row of a relations file is `time1 time2 x y z roll pitch yaw`"


class Relations(NamedTuple):
    """Where the robot of time `ends` stood as seen from where it stood at `starts`: motions (n, 3), times (n,)."""

    starts: np.ndarray
    ends: np.ndarray
    motions: np.ndarray


def read_relations(path: Path | str) -> Relations:
    """The planar part of every relation, in file order; FormatError names the row."""
    rows = []
    for number, line in enumerate(read_lines(path, REMEDY), 1):
        fields = line.split("#")[0].split()
        if not fields:
            continue
        try:
            row = [float(field) for field in fields]
        except ValueError:
            raise FormatError(path, number, "a field is not a number", REMEDY) from None
        if len(row) != 8 or not np.all(np.isfinite(row)):
            raise FormatError(path, number, f"{len(row)} fields where 8 finite numbers belong", REMEDY)
        rows.append(row)
    if not rows:
        raise FormatError(path, None, "holds no relations", REMEDY)
    table = np.array(rows)
    return Relations(table[:, 0], table[:, 1], table[:, [2, 3, 7]])
