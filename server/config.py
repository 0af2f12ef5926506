"""Settings: where each value comes from, and one line that names the place of a wrong one.

From strongest to weakest: flags, the environment (`CRUNCH_CRUNCH__FILTER__PARTICLES=500`), the `--config` file, the
recording's header, defaults. A preset stands where it is named, below the keys of that same place. Defaults live in the
parameter classes only. Uses its siblings `estimator`, `control`, `explorer` and `navigator`.
"""

from __future__ import annotations

import difflib
import functools
import os
import re
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, NamedTuple, get_args, get_origin

from pydantic import BaseModel, Field, ValidationError
from pydantic_settings import (
    BaseSettings,
    EnvSettingsSource,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

from server.control import ControlParams
from server.errors import UserError
from server.estimator import EstimatorParams
from server.explorer import ExplorerParams
from server.navigator import NavigatorParams
from server.presets import NAMED
from server.robots.bumper_cart import BumperCartParams
from server.robots.crunch import CrunchParams
from server.robots.kinds import ROBOTS
from server.robots.maze_runner import MazeRunnerParams
from slam.params import Params

PREFIX = "CRUNCH_"
FILE_NAME = "config.toml"
REVISABLE = (*ROBOTS, "estimator")  # tables of which a new session may have its own


class ConfigError(UserError):
    """A setting that cannot be used: where it stands and what to write instead."""


class WebParams(Params):
    """Where the page is served."""

    host: str = "127.0.0.1"
    port: int = Field(default=8000, ge=0, le=65535)  # 0 takes a free one


class Config(BaseSettings):
    """All settings. Made by `load`, which merges the places; building it directly gives the defaults."""

    model_config = SettingsConfigDict(extra="forbid", frozen=True, env_prefix=PREFIX, env_nested_delimiter="__")

    preset: Literal["default", "thesis", "paper", "beams", "crazyflie"] = "default"
    crunch: CrunchParams = CrunchParams()
    maze_runner: MazeRunnerParams = MazeRunnerParams()
    bumper_cart: BumperCartParams = BumperCartParams()
    estimator: EstimatorParams = EstimatorParams()
    control: ControlParams = ControlParams()
    navigator: NavigatorParams = NavigatorParams()
    explorer: ExplorerParams = ExplorerParams()
    web: WebParams = WebParams()

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Only what is handed in: `load` reads the other places itself, to know where each value stands."""
        return (init_settings,)


def at_same_keys(values: Mapping[str, Any], keys: Mapping[str, Any]) -> dict[str, Any]:
    """What `values` hold at the nested keys of another."""
    return {
        key: at_same_keys(values[key], below) if isinstance(below, Mapping) else values[key]
        for key, below in keys.items()
    }


def merge(weak: Mapping[str, Any], strong: Mapping[str, Any]) -> dict[str, Any]:
    """Nested values, the strong ones winning key by key."""
    merged = dict(weak)
    for key, value in strong.items():
        below = merged.get(key)
        merged[key] = merge(below, value) if isinstance(below, Mapping) and isinstance(value, Mapping) else value
    return merged


PRESETS: dict[str, dict[str, Any]] = {
    "default": at_same_keys(Config().model_dump(), functools.reduce(merge, NAMED.values())),  # takes back all others
    **NAMED,
}


class Layer(NamedTuple):
    """One place with settings; `path` is its file, if it is one."""

    place: str
    values: Mapping[str, Any]
    path: Path | None = None


def load(
    flags: Mapping[str, Any] | None = None,
    file: Path | str | None = None,
    header: Mapping[str, Any] | None = None,
    assignments: Sequence[str] = (),
) -> Config:
    """The settings in force; ConfigError names the place of a wrong one.

    `flags` are nested values from the command line, `assignments` its `--set key=value` texts, `header` the settings
    that a recording carries.
    """
    layers = [Layer("--set", parse_assignments(assignments)), Layer("command line", flags or {})]
    layers.append(Layer("environment", environment()))
    if file is not None:
        layers.append(Layer(str(file), read_toml(Path(file)), Path(file)))
    if header:
        layers.append(Layer("recording's header", known_part(header, Config)))
    for layer in layers:
        check_names(layer)
    merged = defaults()
    for layer in reversed(layers):
        merged = merge(merge(merged, preset_of(layer)), layer.values)
    try:
        return Config(**merged)
    except ValidationError as error:
        raise explain(error, layers) from None


def revised(settings: Config, changes: Mapping[str, Any]) -> Config:
    """Settings with some keys, written as `crunch.filter.particles`, changed; ConfigError where they cannot be."""
    values: dict[str, Any] = {}
    for key, value in changes.items():
        table = key.split(".")[0]
        if table not in REVISABLE:
            raise ConfigError(f"settings: `{key}` stays while the server runs; what can change: {', '.join(REVISABLE)}")
        values = merge(values, nested(key, value))
    layer = Layer("settings", values)
    check_names(layer)
    try:
        return Config(**merge(settings.model_dump(), values))
    except ValidationError as error:
        raise explain(error, [layer]) from None


def navigation_of(settings: Config, robot: str) -> NavigatorParams:
    """How ways are planned for a robot: by the table for all, and what of it is the robot's own."""
    params = getattr(settings, robot)
    if not isinstance(params, MazeRunnerParams):
        return settings.navigator
    return settings.navigator.model_copy(update={"cost": params.floor, "tight_clearance": params.tight_clearance})


def nested(key: str, value: Any) -> dict[str, Any]:
    """A value under a key with dots in it, as nested tables."""
    for name in reversed(key.strip().split(".")):
        value = {name: value}
    return value


def check_robot(name: str, known: Collection[str] = tuple(ROBOTS), what: str = "known") -> None:
    """ConfigError for a robot that nobody knows, or of which something that the `known` ones have is not there."""
    if name not in known:
        problem = "has no such thing" if name in ROBOTS else "is unknown"
        raise ConfigError(f"robot `{name}` {problem}; {what}: {', '.join(known)}")


def defaults() -> dict[str, Any]:
    """Every default, nested."""
    return Config().model_dump()


def working_file() -> Path | None:
    """The working directory's config.toml, if there is one; it counts for live sessions only."""
    path = Path(FILE_NAME)
    return path if path.is_file() else None


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file; ConfigError with the line of a mistake."""
    if not path.exists():
        raise ConfigError(f"{path}: no such file; check the name behind --config")
    if path.is_dir():
        raise ConfigError(f"{path}: is a directory; name a TOML file")
    try:
        return TomlConfigSettingsSource(Config, toml_file=path).toml_data
    except tomllib.TOMLDecodeError as error:
        line = re.search(r"line (\d+)", str(error))
        raise ConfigError(f"{path}:{line[1] if line else ''}: is no TOML ({error}); see https://toml.io") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is no text; name a TOML file") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); check its permissions") from None


def environment() -> dict[str, Any]:
    """The settings in the environment: names with `__` in them after the prefix, or that of a single key."""
    for name in os.environ:
        table, nested, _ = name.upper().removeprefix(PREFIX).partition("__")
        if name.upper().startswith(PREFIX) and nested and table.lower() not in Config.model_fields:
            raise unknown_key("environment", name, table.lower(), list(Config.model_fields))
    try:
        return EnvSettingsSource(Config)()
    except ValueError as error:
        raise ConfigError(f"environment: {error}; tables are set key by key, as in {PREFIX}WEB__PORT") from None


def parse_assignments(assignments: Sequence[str]) -> dict[str, Any]:
    """`crunch.filter.particles=500` as nested values; the right side is TOML, or plain text where it is none."""
    values: dict[str, Any] = {}
    for text in assignments:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise ConfigError(f"--set {text}: has no `=`; write it as crunch.filter.particles=500")
        try:
            parsed: Any = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            parsed = value
        values = merge(values, nested(key, parsed))
    return values


def preset_of(layer: Layer) -> dict[str, Any]:
    """The values of the preset that a place names, if it names one."""
    if "preset" not in layer.values:
        return {}
    name = layer.values["preset"]
    if name not in PRESETS:
        raise ConfigError(f"{place_of(layer, ('preset',))}: preset `{name}` is unknown; choose {' or '.join(PRESETS)}")
    return PRESETS[name]


def model_of(annotation: Any) -> type[BaseModel] | None:
    """The parameter class behind a field, if it is one; it may be left out there."""
    if isinstance(annotation, UnionType) and len(get_args(annotation)) == 2 and NoneType in get_args(annotation):
        [annotation] = set(get_args(annotation)) - {NoneType}
    return annotation if isinstance(annotation, type) and issubclass(annotation, BaseModel) else None


def tables_of(
    annotation: Any, key: str, value: Mapping[str, Any]
) -> Iterator[tuple[tuple[str, ...], Any, type[BaseModel]]]:
    """The tables under a field: itself, or each that it holds under free names; keys, values and class of each."""
    if model := model_of(annotation):
        yield (key,), value, model
    elif get_origin(annotation) is dict and (model := model_of(get_args(annotation)[1])):
        yield from (((key, name), table, model) for name, table in value.items())


def check_names(layer: Layer) -> None:
    """ConfigError at the first key of a place that does not exist."""
    for keys, known in unknown_keys(layer.values, Config):
        raise unknown_key(place_of(layer, keys), ".".join(keys), keys[-1], known)


def unknown_keys(
    values: Mapping[str, Any], model: type[BaseModel], above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], list[str]]]:
    """Every key that its parameter class does not have, with the names that would be right there."""
    for key, value in values.items():
        if key not in model.model_fields:
            yield (*above, key), [".".join((*above, name)) for name in model.model_fields]
        elif isinstance(value, Mapping):
            for keys, table, below in tables_of(model.model_fields[key].annotation, key, value):
                if isinstance(table, Mapping):
                    yield from unknown_keys(table, below, (*above, *keys))


def known_part(values: Mapping[str, Any], model: type[BaseModel]) -> dict[str, Any]:
    """The keys that exist and have a value: a recording of another version must still be read."""
    kept = {key: value for key, value in values.items() if key in model.model_fields and value is not None}
    for key, value in kept.items():
        below = model_of(model.model_fields[key].annotation)
        if below is not None and isinstance(value, Mapping):
            kept[key] = known_part(value, below)
    return kept


def unknown_key(place: str, key: str, last: str, known: list[str]) -> ConfigError:
    """The error of a key that does not exist, with the nearest one that does."""
    by_name = {name.rpartition(".")[2]: name for name in known}
    near = difflib.get_close_matches(last, by_name, n=1, cutoff=0.6)
    remedy = f"did you mean `{by_name[near[0]]}`?" if near else f"known here: {', '.join(by_name)}"
    return ConfigError(f"{place}: `{key}` is no setting; {remedy}")


def explain(error: ValidationError, layers: list[Layer]) -> ConfigError:
    """The first mistake that validation found, with the strongest place that holds the value."""
    first = error.errors()[0]
    keys = tuple(str(part) for part in first["loc"])
    stated = keys[:-1] if first["type"] == "missing" else keys
    place = next((place_of(layer, stated) for layer in layers if holds(layer.values, stated)), "defaults")
    wanted = first["msg"][0].lower() + first["msg"][1:]
    return ConfigError(f"{place}: {'.'.join(keys)} = {first['input']!r} cannot be used; {wanted}")


def holds(values: Any, keys: Sequence[str]) -> bool:
    """Whether a place says anything about the value at `keys`, or about a table that contains it."""
    for key in keys:
        if not isinstance(values, Mapping):
            return True
        if key not in values:
            return False
        values = values[key]
    return True


def place_of(layer: Layer, keys: Sequence[str]) -> str:
    """The place's name, with the line number where it is a file."""
    line = line_of(layer.path, keys) if layer.path else None
    return f"{layer.place}:{line}" if line else layer.place


def line_of(path: Path, keys: Sequence[str]) -> int | None:
    """The line of a TOML file on which a key, or the table that holds it, stands."""
    table: list[str] = []
    found = None
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
        header = re.match(r"\s*\[+\s*([^\]]+?)\s*\]+", line)
        if header:
            table = [part.strip().strip("\"'") for part in header[1].split(".")]
            path_here = table
        else:
            name = re.match(r"\s*([\w.\"'-]+)\s*=", line)
            path_here = [*table, *name[1].replace('"', "").split(".")] if name else None
        if path_here and path_here == list(keys)[: len(path_here)]:
            found = number
    return found
