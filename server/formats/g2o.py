"""Pose graphs as g2o reads them: `VERTEX_SE2 id x y theta`, and `EDGE_SE2 a b x y theta` and its information."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from server.formats.atomic import write_atomically
from server.formats.errors import FormatError, read_lines

VERTEX_FIELDS = 5
EDGE_FIELDS = 12


class Graph(NamedTuple):
    """`vertices` (n, 3) poses; `pairs` (m, 2) rows; `motions` (m, 3) in the first's frame; `information` (m, 6)."""

    vertices: np.ndarray
    pairs: np.ndarray
    motions: np.ndarray
    information: np.ndarray


def format_g2o(graph: Graph) -> str:
    """The graph's text; `information` is the upper triangle (xx, xy, xt, yy, yt, tt) of the inverse covariance."""
    lines = [f"VERTEX_SE2 {i} {x:.6f} {y:.6f} {theta:.9f}\n" for i, (x, y, theta) in enumerate(graph.vertices)]
    for (a, b), (x, y, theta), information in zip(graph.pairs, graph.motions, graph.information, strict=True):
        weights = " ".join(f"{weight:.6g}" for weight in information)
        lines.append(f"EDGE_SE2 {a} {b} {x:.6f} {y:.6f} {theta:.9f} {weights}\n")
    if len(graph.vertices):
        lines.append("FIX 0\n")
    return "".join(lines)


def write_g2o(path: Path | str, graph: Graph) -> None:
    """Write a graph."""
    write_atomically(path, format_g2o(graph))


def read_g2o(path: Path | str) -> Graph:
    """The SE(2) part of a graph; other rows are ignored. Vertices come in the order of their numbers in the file."""
    vertices: dict[int, list[float]] = {}
    edges: list[tuple[int, int, list[float], int]] = []
    for number, line in enumerate(read_lines(path), 1):
        fields = line.split()
        if fields[:1] == ["VERTEX_SE2"]:
            numbers = parse_numbers(path, number, fields, VERTEX_FIELDS)
            vertices[int(numbers[0])] = numbers[1:]
        elif fields[:1] == ["EDGE_SE2"]:
            numbers = parse_numbers(path, number, fields, EDGE_FIELDS)
            edges.append((int(numbers[0]), int(numbers[1]), numbers[2:], number))
    if not vertices:
        raise FormatError(path, None, "holds no VERTEX_SE2 row", "only planar graphs are read")
    rows = {name: row for row, name in enumerate(sorted(vertices))}
    for a, b, _, number in edges:
        if a not in rows or b not in rows:
            raise FormatError(
                path, number, f"the edge {a} {b} names a vertex that is not there", "add its VERTEX_SE2 row"
            )
    values = np.array([edge[2] for edge in edges]).reshape(-1, 9)
    pairs = np.array([(rows[a], rows[b]) for a, b, _, _ in edges], int).reshape(-1, 2)
    return Graph(np.array([vertices[name] for name in sorted(vertices)]), pairs, values[:, :3], values[:, 3:])


def parse_numbers(path: Path | str, number: int, fields: list[str], count: int) -> list[float]:
    """The numbers behind a row's name."""
    try:
        numbers = [float(field) for field in fields[1:]]
    except ValueError:
        raise FormatError(path, number, "a field is not a number", f"{fields[0]} has {count - 1} numbers") from None
    if len(fields) != count:
        raise FormatError(path, number, f"{len(fields) - 1} numbers", f"{fields[0]} has {count - 1} numbers")
    return numbers
