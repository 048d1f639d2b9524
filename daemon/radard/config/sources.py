"""Where configuration comes from: files and environment, every value with its place."""

import difflib
import logging
import reprlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import yaml
from pydantic import BaseModel

from radard.config.redact import redact_value
from radard.errors import ConfigError
from x2radar.bounded_yaml import YamlError, compose_yaml, construct

log = logging.getLogger("radard")
ENV_PREFIX = "RADARD_"
_SHORT = reprlib.Repr()
_SHORT.maxlevel = 2  # aliases of YAML nest a few words into thousands
_TEXT, _NULL = "tag:yaml.org,2002:str", "tag:yaml.org,2002:null"
Where = tuple[str, ...]
_GONE: dict[Where, str] = {("outbox",): "is the section 'log' now"}
Places = dict[Where, str]


def put(tree: dict[str, Any], section: str, key: str | None, value: Any) -> None:
    """Set one value of a tree of sections; a section that is no mapping is replaced."""
    if key is None:
        tree[section] = value
        return
    old = tree.get(section)
    tree[section] = {**(old if isinstance(old, dict) else {}), key: value}


def read_yaml(path: Path, root: type[BaseModel]) -> tuple[dict[str, Any], Places]:
    """Return a file's sections and the place of every key; raises ConfigError if it cannot.

    Where `root` takes text, what is written is the value: a sensor may be called `on` or `007`.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as err:
        msg = f"{path}: cannot read the configuration ({err})"
        raise ConfigError(msg) from err
    try:
        node = compose_yaml(text)
        _keep_text(node, root)
        raw = construct(node)
    except YamlError as err:
        where = f"{path}:{err.line}" if err.line else str(path)
        msg = f"{where}: not YAML: {err.problem}"
        raise ConfigError(msg) from err
    if raw is None:
        return {}, {}
    if not isinstance(raw, dict):
        msg = f"{path}: must be a mapping of sections"
        raise ConfigError(msg)
    return raw, dict(_places(node, path))


def read_environment(
    environ: Mapping[str, str], root: type[BaseModel]
) -> Iterator[tuple[tuple[str, str | None], Any, str]]:
    """Yield ((section, key), value, name) of every variable RADARD_SECTION__KEY.

    A variable without `__` that names no section is another program's, as the RADARD_PORT that a
    container platform sets for a service called radard: it is left out, with a warning.
    """
    for name in sorted(environ):
        if not name.startswith(ENV_PREFIX):
            continue
        section, double, key = name[len(ENV_PREFIX) :].lower().partition("__")
        field = root.model_fields.get(section)
        if field is None and not double:
            log.warning("%s: left out: the configuration has no section '%s'", name, section)
            continue
        annotation = field.annotation if field else None
        if double:
            fields = getattr(annotation, "model_fields", {})
            annotation = fields[key].annotation if key in fields else None
        yield (section, key if double else None), _value(environ[name], annotation), name


def explain(fault: Any, places: Mapping[Where, str], root: type[BaseModel]) -> str:
    """Return one of pydantic's faults as text: place, key, what is wrong, what would be right."""
    where = tuple(str(part) for part in fault["loc"])
    # Of the value itself or the nearest thing around it; none if that is built in.
    around = (where[:n] for n in range(len(where), 0, -1))
    place = next((places[each] for each in around if each in places), "")
    head = f"{place}: " if place else ""
    if fault["type"] != "extra_forbidden":
        message = str(fault["msg"]).removeprefix("Value error, ")
        message = message[:1].lower() + message[1:]
        if not where:
            return message
        got = redact_value(where[-1], fault["input"])
        return f"{head}{'.'.join(where)}: {message} (got {_SHORT.repr(got)})"
    if where in _GONE:
        return f"{head}{'.'.join(where)}: {_GONE[where]}"
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


def _value(text: str, annotation: Any) -> Any:
    """Return what a variable says: YAML, or as it stands where text is taken."""
    kinds = _kinds(annotation)
    try:
        node = compose_yaml(text)
        if any(map(_is_text, kinds)):
            return None if type(None) in kinds and _is_null(node) else text
        _keep_text(node, annotation)
        return construct(node)
    except YamlError:
        return text


def _keep_text(node: yaml.Node | None, annotation: Any) -> None:
    """Let the scalars of a YAML tree be text where its type, a section's or a value's, says so."""
    kinds = _kinds(annotation)
    for kind in kinds:
        of = get_args(kind)
        if isinstance(node, yaml.ScalarNode):
            if _is_text(kind) and not (type(None) in kinds and _is_null(node)):
                node.tag = _TEXT
        elif isinstance(node, yaml.SequenceNode) and of:
            for item in node.value:
                _keep_text(item, of[0])
        elif isinstance(node, yaml.MappingNode):
            fields = getattr(kind, "model_fields", {})
            for key, value in node.value:
                if get_origin(kind) is dict:
                    _keep_text(key, of[0])
                    _keep_text(value, of[1])
                elif key.value in fields:
                    _keep_text(value, fields[key.value].annotation)


def _kinds(annotation: Any) -> tuple[Any, ...]:
    origin, of = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _kinds(of[0])
    if origin in {Union, UnionType}:
        return tuple(kind for each in of for kind in _kinds(each))
    return (annotation,)


def _is_text(kind: Any) -> bool:
    return kind in {str, Path} or get_origin(kind) is Literal


def _is_null(node: yaml.Node | None) -> bool:
    return node is None or node.tag == _NULL


def _places(node: Any, path: Path, above: Where = ()) -> Iterator[tuple[Where, str]]:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            where = (*above, str(key.value))
            yield where, f"{path}:{key.start_mark.line + 1}"
            yield from _places(value, path, where)
