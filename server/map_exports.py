"""A survey in every format: what is downloaded of the present map and of saved ones, with the same names and meanings.

Uses its siblings `map_files`, `map_picture`, `maps` and `survey`.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable, Sequence
from typing import NamedTuple

from server.formats.g2o import format_g2o
from server.formats.ros_map import format_pgm, format_yaml
from server.formats.tum import format_tum
from server.map_files import Profile, map_json, pose_graph, profile_csv
from server.map_picture import draw_png
from server.maps import OccupancyMap, path_length
from server.messages import Label
from server.survey import Survey, floor_of, grid_of

ZIP_DATE = (1980, 1, 1, 0, 0, 0)  # the same map makes the same bytes


class Sheet(NamedTuple):
    """What is exported: a survey and its labels in the map's own frame, a title, and the stem of its files' names."""

    survey: Survey
    labels: Sequence[Label] = ()
    title: str = "Map"
    stem: str = "map"


class Format(NamedTuple):
    """How a format is made, its media type, what it is, and whether it is drawn, which takes a second."""

    make: Callable[[Sheet], bytes]
    media_type: str
    description: str
    is_drawn: bool = False


def png(sheet: Sheet) -> bytes:
    """A picture with a title."""
    survey = sheet.survey
    metres = f"{path_length(survey.path):.1f} m, {len(survey.path)} vertices, {survey.n_particles} particles"
    return draw_png(floor_of(survey, sheet.labels), sheet.title, metres)


def pgm(sheet: Sheet) -> bytes:
    """The occupancy map's cells."""
    return format_pgm(grid(sheet).cells)


def yaml(sheet: Sheet) -> bytes:
    """What `map_server` reads first; it names the PGM beside it."""
    found = grid(sheet)
    return format_yaml(f"{sheet.stem}.pgm", found.resolution, found.origin).encode()


def grid(sheet: Sheet) -> OccupancyMap:
    """The occupancy map."""
    return grid_of(sheet.survey)


def json(sheet: Sheet) -> bytes:
    """Path, walls and labels."""
    return map_json(floor_of(sheet.survey, sheet.labels, has_grid=False), sheet.survey.robot).encode()


def g2o(sheet: Sheet) -> bytes:
    """The pose graph."""
    return format_g2o(pose_graph(sheet.survey.path, sheet.survey.odometry, *sheet.survey.noise)).encode()


def tum(sheet: Sheet) -> bytes:
    """The vertices with their times."""
    return format_tum(sheet.survey.times, sheet.survey.path).encode()


def csv(sheet: Sheet) -> bytes:
    """How settled each vertex is; its spread is told by JSON, not along the axes, which people may have turned."""
    survey = sheet.survey
    return profile_csv(survey.times, survey.path, Profile(survey.profile, survey.settled)).encode()


def archive(sheet: Sheet) -> bytes:
    """All the other formats in one file, under the names that a replay gives them."""
    content = io.BytesIO()
    plain = sheet._replace(stem="map")
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as file:
        for name, made in FORMATS.items():
            if made.make is not archive:
                file.writestr(zipfile.ZipInfo(ARCHIVED.get(name, f"map.{name}"), ZIP_DATE), made.make(plain))
    return content.getvalue()


ARCHIVED = {"g2o": "path.g2o", "tum": "path.tum", "csv": "profile.csv"}
FORMATS: dict[str, Format] = {
    "png": Format(png, "image/png", "a picture", is_drawn=True),
    "pgm": Format(pgm, "image/x-portable-graymap", "the occupancy map's cells, for ROS's map_server"),
    "yaml": Format(yaml, "application/yaml", "its resolution and origin; names the PGM that belongs beside it"),
    "json": Format(json, "application/json", "path, walls and labels for programs"),
    "g2o": Format(g2o, "text/plain; charset=utf-8", "the pose graph"),
    "tum": Format(tum, "text/plain; charset=utf-8", "the path's vertices with their times"),
    "csv": Format(csv, "text/csv; charset=utf-8", "how settled each vertex is"),
    "zip": Format(archive, "application/zip", "all of these in one file", is_drawn=True),
}


def stem_of(name: str) -> str:
    """A map's name as the stem of a file's, which every system takes."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:60] or "map"
