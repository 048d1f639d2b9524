"""Configuration: one validated object from built-in values, files, environment, options.

Later ones win: built-in < /etc/radard/config.yaml < ./config.yaml < --config FILE <
RADARD_SECTION__KEY < command line. Files do not add up: the first one found in the order
--config, ./config.yaml, /etc/radard/config.yaml is the file. An unknown key is an error
that names file, line and the nearest right key.
"""

import difflib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from radard.errors import ConfigError

ENV_PREFIX = "RADARD_"
DEFAULT_FILES = (Path("config.yaml"), Path("/etc/radard/config.yaml"))


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class SensorSection(_Section):
    """Which radar."""

    name: str = Field("radar", pattern=r"^[A-Za-z0-9_-]+$", description="name of this sensor")
    port: str | None = Field(None, description="what --port says")
    speed: str = Field("auto", description="realtime, max, a factor, or auto")
    wait: bool = Field(False, description="wait for a port that is absent at start")
    on_device_loss: Literal["wait", "quit"] = Field("wait", description="when the port goes")


class ModelSection(_Section):
    """Which classifier."""

    name: str = Field("seed", description="installed bundle, file, or none for the gate alone")


class GateSection(_Section):
    """When something counts as moving."""

    threshold_db: float = Field(6.0, ge=0, le=60, description="over the noise floor")
    adapt_db: float = Field(40.0, ge=0, le=60, description="most that a bin may learn")
    memory_s: float = Field(60.0, ge=1, le=3600, description="how long a dwell is remembered")
    learn_s: float = Field(20.0, ge=1, le=3600, description="motion in place before learning")
    in_place_m: float = Field(0.2, gt=0, le=2, description="what counts as in place")


class DecisionSection(_Section):
    """When a motion is an alarm."""

    policy: Literal["window"] | None = Field(None, description="null: the bundle's own")
    pet_limit: float | None = Field(None, ge=0.5, le=1, description="null: the bundle's own (0.8)")


class Config(_Section):
    """The whole configuration."""

    sensor: SensorSection = SensorSection()
    model: ModelSection = ModelSection()
    gate: GateSection = GateSection()
    decision: DecisionSection = DecisionSection()
    output: tuple[str, ...] = Field((), description="what -o/--output says, a list")


def load_config(
    file: Path | None = None,
    *,
    environ: Mapping[str, str] | None = None,
    options: Mapping[str, Mapping[str, Any]] | None = None,
) -> Config:
    """Return the configuration that holds.

    Parameters
    ----------
    file : Path, optional
        What --config names; must exist.
    environ : mapping, optional
        Instead of the process environment.
    options : mapping of section to mapping of key to value, optional
        From the command line.

    Returns
    -------
    Config
        Checked.

    Raises
    ------
    ConfigError
        With every fault, each with its place.
    """
    tree: dict[str, Any] = {}
    places: dict[tuple[str, ...], str] = {}
    path = file or next((p for p in DEFAULT_FILES if p.is_file()), None)
    if path is not None:
        tree, places = _read_yaml(path)
    for (section, key), value, place in _from_environment(
        os.environ if environ is None else environ
    ):
        _put(tree, section, key, value)
        places[(section, key) if key else (section,)] = place
    for name, values in (options or {}).items():
        if name == "output":
            tree[name] = values
            continue
        for key, value in values.items():
            _put(tree, name, key, value)
            places[name, key] = "command line"
    try:
        return Config.model_validate(tree)
    except ValidationError as err:
        lines = [_explain(fault, places) for fault in err.errors()]
        raise ConfigError("; ".join(lines)) from err


def _put(tree: dict[str, Any], section: str, key: str | None, value: Any) -> None:
    if key is None:
        tree[section] = value
        return
    old = tree.get(section)
    tree[section] = {**(old if isinstance(old, dict) else {}), key: value}


def _read_yaml(path: Path) -> tuple[dict[str, Any], dict[tuple[str, ...], str]]:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as err:
        msg = f"{path}: cannot read the configuration ({err})"
        raise ConfigError(msg) from err
    try:
        node = yaml.compose(text, yaml.SafeLoader)
        raw = yaml.safe_load(text)
    except yaml.YAMLError as err:
        msg = f"{path}: not YAML: {' '.join(str(err).split())}"
        raise ConfigError(msg) from err
    if raw is None:
        return {}, {}
    if not isinstance(raw, dict):
        msg = f"{path}: must be a mapping of sections"
        raise ConfigError(msg)
    return raw, dict(_places(node, path))


def _places(
    node: Any, path: Path, above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], str]]:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            where = (*above, str(key.value))
            yield where, f"{path}:{key.start_mark.line + 1}"
            yield from _places(value, path, where)


def _from_environment(
    environ: Mapping[str, str],
) -> Iterator[tuple[tuple[str, str | None], Any, str]]:
    for name in sorted(environ):
        if name.startswith(ENV_PREFIX):
            section, double, key = name[len(ENV_PREFIX) :].lower().partition("__")
            try:
                value = yaml.safe_load(environ[name])
            except yaml.YAMLError:
                value = environ[name]
            yield (section, key if double else None), value, name


def _explain(fault: Any, places: Mapping[tuple[str, ...], str]) -> str:
    where = tuple(str(part) for part in fault["loc"])
    place = next((places[where[:n]] for n in range(len(where), 0, -1) if where[:n] in places), "")
    head = f"{place}: " if place else ""
    if fault["type"] != "extra_forbidden":
        return f"{head}{'.'.join(where)}: {fault['msg'].lower()} (got {fault['input']!r})"
    model: type[BaseModel] = Config
    for part in where[:-1]:
        annotation = model.model_fields[part].annotation
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            break
        model = annotation
    close = difflib.get_close_matches(where[-1], model.model_fields, 1, 0.4)
    hint = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(model.model_fields)}"
    return f"{head}unknown key '{'.'.join(where)}'; {hint}"
