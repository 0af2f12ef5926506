"""Prints config.toml: every default of the code, with the comments that stand beside them there."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from server.config import Config, tables_of

HEAD = """\
# Crunch's settings: every default, as it stands in the code (`make config` writes this file again).
#
# `crunch demo` and `crunch serve` read the config.toml of the directory that they are started in; the other commands
# read a file only where it is named with --config. A setting is taken from the first place that has it: flags, the
# environment (CRUNCH_CRUNCH__FILTER__PARTICLES=500), the file, the recording's header, the defaults.
# A misspelt key stops the start. Lengths are in metres, angles in radians where the key does not say degrees.

# `thesis` is Crunch's thesis taken literally. Keys below this line win over it: delete those that it should decide, or
# say --preset thesis.
"""


def comments_of(model: type[BaseModel]) -> dict[str, str]:
    """What stands behind each field in the source."""
    comments: dict[str, str] = {}
    name = ""
    for line in inspect.getsource(model).splitlines():
        started = re.match(r"    (\w+): ", line)
        name = started[1] if started else name if line.startswith("    ") else ""
        remark = re.search(r"  # (?!fmt:)(.*)$", line)
        if name in model.model_fields and remark:
            comments[name] = remark[1]
    return comments


def rows_of(model: type[BaseModel], values: Mapping[str, Any]) -> Iterator[str]:
    """The keys of one table."""
    comments = comments_of(model)
    for key, value in values.items():
        if not isinstance(value, Mapping):
            row = f"# {key} =" if value is None else f"{key} = {toml_value(value)}"
            yield f"{row}  # {comments[key]}" if key in comments else row


def sections(model: type[BaseModel], values: Mapping[str, Any], above: tuple[str, ...] = ()) -> Iterator[str]:
    """A table and those below it."""
    rows = list(rows_of(model, values))
    if rows and above:
        purpose = (inspect.getdoc(model) or "").splitlines()[0]
        yield "\n".join([f"# {purpose}", f"[{'.'.join(above)}]", *rows]) + "\n"
    elif rows:
        yield "\n".join(rows) + "\n"
    for key, value in values.items():
        if isinstance(value, Mapping):
            for keys, table, below in tables_of(model.model_fields[key].annotation, key, value):
                yield from sections(below, table, (*above, *keys))


def toml_value(value: Any) -> str:
    """One TOML value."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and math.isinf(value):
        return "inf" if value > 0 else "-inf"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value(item) for item in value)}]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


def config_toml() -> str:
    """The whole file."""
    return HEAD + "\n".join(sections(Config, Config().model_dump()))


if __name__ == "__main__":
    print(config_toml(), end="")
