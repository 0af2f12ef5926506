"""Relative poses verified by hand: `t1 t2 x y z roll pitch yaw` (Kuemmerle et al., Autonomous Robots 27, 2009)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from server.formats.errors import FormatError, read_lines
from slam.evaluate import Relations

REMEDY = "each row of a relations file is `time1 time2 x y z roll pitch yaw`"


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
