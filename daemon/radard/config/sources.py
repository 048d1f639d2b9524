"""Where configuration comes from: files and environment, every value with its place."""

import difflib
import reprlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, get_args, get_origin

import yaml
from pydantic import BaseModel

from radard.config.redact import redact_value
from radard.errors import ConfigError
from x2radar.bounded_yaml import compose_yaml, construct, load_yaml

ENV_PREFIX = "RADARD_"
_SHORT = reprlib.Repr()
_SHORT.maxlevel = 2  # chosen: aliases of YAML nest a few words into thousands
Where = tuple[str, ...]
Places = dict[Where, str]
_ADAPTIVE = "is gone with the adaptive threshold; 'radard calibrate' sets what suits the room"
_GONE: dict[Where, str] = {
    ("gate", "adaptive"): _ADAPTIVE,
    ("gate", "least_db"): _ADAPTIVE,
    ("gate", "most_db"): _ADAPTIVE,
    ("gate", "threshold_rate_db_per_s"): _ADAPTIVE,
    ("gate", "threshold_db"): "is gone: the gate's threshold follows from "
    "gate.false_alarms_per_day now; remove this line, or set that",
}
"""Keys of earlier versions, by section and key, and what to do instead."""


def put(tree: dict[str, Any], section: str, key: str | None, value: Any) -> None:
    """Set one value of a tree of sections; a section that is no mapping is replaced."""
    if key is None:
        tree[section] = value
        return
    old = tree.get(section)
    tree[section] = {**(old if isinstance(old, dict) else {}), key: value}


def read_yaml(path: Path) -> tuple[dict[str, Any], Places]:
    """Return a file's sections and the place of every key; raises ConfigError if it cannot."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as err:
        msg = f"{path}: cannot read the configuration ({err})"
        raise ConfigError(msg) from err
    try:
        node = compose_yaml(text)
        raw = construct(node)
    except (yaml.YAMLError, ValueError, RecursionError) as err:
        # Only the place: the text around it may hold a password.
        mark = getattr(err, "problem_mark", None)
        where = f"{path}:{mark.line + 1}" if mark else str(path)
        msg = f"{where}: not YAML: {getattr(err, 'problem', None) or type(err).__name__}"
        raise ConfigError(msg) from err
    if raw is None:
        return {}, {}
    if not isinstance(raw, dict):
        msg = f"{path}: must be a mapping of sections"
        raise ConfigError(msg)
    return raw, dict(_places(node, path))


def read_environment(
    environ: Mapping[str, str],
) -> Iterator[tuple[tuple[str, str | None], Any, str]]:
    """Yield ((section, key), value, name) of every variable RADARD_SECTION__KEY."""
    for name in sorted(environ):
        if name.startswith(ENV_PREFIX):
            section, double, key = name[len(ENV_PREFIX) :].lower().partition("__")
            try:
                value = load_yaml(environ[name])
            except (yaml.YAMLError, ValueError, RecursionError):
                value = environ[name]
            yield (section, key if double else None), value, name


def place_of(where: Where, places: Mapping[Where, str]) -> str:
    """Return the place of a value or of the nearest thing around it; empty if built in."""
    return next((places[where[:n]] for n in range(len(where), 0, -1) if where[:n] in places), "")


def explain(fault: Any, places: Mapping[Where, str], root: type[BaseModel]) -> str:
    """Return one of pydantic's faults as text: place, key, what is wrong, what would be right."""
    where = tuple(str(part) for part in fault["loc"])
    place = place_of(where, places)
    head = f"{place}: " if place else ""
    if fault["type"] != "extra_forbidden":
        message = str(fault["msg"]).removeprefix("Value error, ")
        message = message[:1].lower() + message[1:]
        if not where:
            return message
        got = redact_value(where[-1] if where else "", fault["input"])
        return f"{head}{'.'.join(where)}: {message} (got {_SHORT.repr(got)})"
    if where[-2:] in _GONE:
        return f"{head}{'.'.join(where)}: {_GONE[where[-2:]]}"
    model = _section_of(where, root)
    close = difflib.get_close_matches(where[-1], model.model_fields, 1, 0.4)
    hint = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(model.model_fields)}"
    return f"{head}unknown key '{'.'.join(where)}'; {hint}"


def _section_of(where: Where, root: type[BaseModel]) -> type[BaseModel]:
    """Return the section that the last key of `where` was meant for."""
    model, parts = root, iter(where[:-1])
    for part in parts:
        annotation = model.model_fields[part].annotation
        if get_origin(annotation) is dict:
            next(parts, None)
        kinds = (annotation, *get_args(annotation))
        inner = [k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)]
        if not inner:
            break
        model = inner[0]
    return model


def _places(node: Any, path: Path, above: Where = ()) -> Iterator[tuple[Where, str]]:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            where = (*above, str(key.value))
            yield where, f"{path}:{key.start_mark.line + 1}"
            yield from _places(value, path, where)
