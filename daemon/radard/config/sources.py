"""Where configuration comes from: files and environment, every value with its place."""

import contextlib
import difflib
import logging
import reprlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin

import yaml
from pydantic import BaseModel

from radard.config.credentials import redact_value
from radard.errors import ConfigError
from x2radar.bounded_yaml import YamlError, compose_yaml, construct, read_document

log = logging.getLogger("radard")
ENV_PREFIX = "RADARD_"
_SHORT = reprlib.Repr()
_SHORT.maxlevel = 2  # aliases of YAML nest a few words into thousands
_TEXT, _MERGE = "tag:yaml.org,2002:str", "tag:yaml.org,2002:merge"
_PLAIN = {
    **dict.fromkeys(("model_type", "dict_type"), "must be a section, with keys below it"),
    "tuple_type": "must be a list, as [a, b]",
}
"""What pydantic says with names of Python's."""
Where = tuple[str, ...]
Places = dict[Where, str]
Given = tuple[tuple[str, str | None], Any, str]  # section and key (None: all of it), value, place


def put(tree: dict[str, Any], section: str, key: str | None, value: Any) -> None:
    """Set one value of a tree of sections; a section that is no mapping is replaced."""
    if key is None:
        tree[section] = value
        return
    old = tree.get(section)
    tree[section] = {**(old if isinstance(old, dict) else {}), key: value}


def read_yaml(path: Path) -> tuple[dict[str, Any], Places]:
    """Return a file's sections, in texts, and the place of every key; ConfigError if it cannot."""
    try:
        node = compose_yaml(read_document(path))
        raw = _texts_in(node)
    except (OSError, UnicodeDecodeError) as err:
        why = (isinstance(err, OSError) and err.strerror) or "it is not UTF-8"
        raise ConfigError(f"{path}: cannot read the configuration: {why}") from err
    except YamlError as err:
        where = f"{path}:{err.line}" if err.line else str(path)
        raise ConfigError(f"{where}: not YAML: {err.problem}") from err
    if node is None or not raw:
        return {}, {}
    if not isinstance(raw, dict):
        raise ConfigError(f"{path}: must be a mapping of sections")
    return raw, dict(_places(node, path))


def read_environment(environ: Mapping[str, str], root: type[BaseModel]) -> Iterator[Given]:
    """Yield ((section, key), value, name) of RADARD_SECTION__KEY; ConfigError if twice.

    One without `__` that names no section is another program's, as the RADARD_PORT of a container
    platform, and left out with a warning.
    """
    names: dict[str, str] = {}
    for name in sorted(name for name in environ if name.startswith(ENV_PREFIX)):
        if (other := names.setdefault(name.lower(), name)) != name:
            raise ConfigError(f"{other} and {name} are the same key; give one")
        section, double, key = name[len(ENV_PREFIX) :].lower().partition("__")
        if section not in root.model_fields and not (double and section):
            log.warning("%s: left out: the configuration has no section '%s'", name, section)
            continue
        value = text = environ[name]
        if not double or (text[:1] in {"[", "{"} and not _is_text((section, key), root)):
            with contextlib.suppress(YamlError):
                value = texts_of(text)
        yield (section, key if double else None), value, name


def explain(fault: Any, places: Mapping[Where, str], root: type[BaseModel]) -> str:
    """Return one of pydantic's faults as text: place, key, what is wrong, what would be right."""
    where = tuple(str(part) for part in fault["loc"])
    # Of the value itself or the nearest thing around it; none if that is built in.
    around = (where[:n] for n in range(len(where), 0, -1))
    place = next((places[each] for each in around if each in places), "")
    head = f"{place}: " if place else ""
    if fault["type"] != "extra_forbidden":
        message = str(fault["msg"]).removeprefix("Value error, ")
        message = _PLAIN.get(fault["type"], message[:1].lower() + message[1:])
        if not where:
            return message
        got = redact_value(where[-1], fault["input"])
        return f"{head}{'.'.join(where)}: {message} (got {_SHORT.repr(got)})"
    if where == ("outbox",):
        return f"{head}outbox: is the section 'log' now"
    known = _section_of(where, root).model_fields
    close = difflib.get_close_matches(where[-1], known, 1, 0.4)
    hint = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(known)}"
    return f"{head}unknown key '{'.'.join(where)}'; {hint}"


def _section_of(where: Where, root: type[BaseModel]) -> type[BaseModel]:
    """Return the section that the last key of `where` was meant for."""
    model, parts = root, iter(where[:-1])
    for part in parts:
        (kind,) = (k for k in _kinds(model.model_fields[part].annotation) if k is not type(None))
        if get_origin(kind) is dict:
            next(parts, None)
            kind = get_args(kind)[1]
        if not isinstance(kind, type) or not issubclass(kind, BaseModel):
            break
        model = kind
    return model


def _is_text(where: Where, root: type[BaseModel]) -> bool:
    field = _section_of(where, root).model_fields.get(where[-1])
    return field is not None and {*_kinds(field.annotation)} <= {str, Path, type(None)}


def texts_of(text: str) -> Any:
    """Return what a text in YAML holds, every value as the text that is written; or YamlError."""
    return _texts_in(compose_yaml(text))


def _texts_in(node: yaml.Node | None) -> Any:
    waiting = [] if node is None else [node]
    while waiting:
        each = waiting.pop()
        if isinstance(each, yaml.ScalarNode) and each.tag != _MERGE:
            each.tag = _TEXT
        elif isinstance(each, yaml.MappingNode):
            waiting += [part for pair in each.value for part in pair]
        elif isinstance(each, yaml.SequenceNode):
            waiting += each.value
    return construct(node)


def _kinds(annotation: Any) -> tuple[Any, ...]:
    is_union = get_origin(annotation) in {Union, UnionType}
    return get_args(annotation) if is_union else (annotation,)


def _places(node: Any, path: Path, above: Where = ()) -> Iterator[tuple[Where, str]]:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            where = (*above, str(key.value))
            yield where, f"{path}:{key.start_mark.line + 1}"
            yield from _places(value, path, where)
