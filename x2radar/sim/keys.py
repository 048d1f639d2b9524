"""Named numbers with limits: one table says what a setting may be, in code and in scenes.

A settings class writes its fields with `limited` and `one_of`; `check_fields` then judges an
object made in code (`SettingsError`), `settings_from` a mapping from a scene file
(`SceneError`, with the key's path). Things, whose numbers are drawn where a scene leaves
them out, use `Key` and `checked` directly.
"""

import difflib
import math
from collections.abc import Collection, Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any, TypeVar

import numpy as np

from x2radar.errors import SceneError, SettingsError, renamed

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Key:
    """What one setting may be."""

    low: float  # least number that makes sense
    high: float
    meaning: str  # a few words with the unit, for help and docs
    is_whole: bool = False
    is_optional: bool = False  # None is allowed
    choices: tuple[str, ...] = ()  # words it may be, instead of a number

    def fault(self, value: Any) -> str:
        """Return what is wrong with `value` in a few words, or an empty string."""
        if value is None and self.is_optional:
            return ""
        if self.choices:
            known = ", ".join(self.choices)
            return "" if value in self.choices else f"must be one of {known}, not {value!r}"
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
            return f"must be a number, not {value!r}"
        if not self.low <= value <= self.high:
            # Not :g for the value: a whole number beyond 1e308 has no such form.
            return f"{value} is not in {self.low:g} to {self.high:g}"
        if self.is_whole and float(value) % 1 != 0:
            return f"must be a whole number, not {value}"
        return ""


def limited(
    default: float | None, low: float, high: float, meaning: str, *, is_whole: bool = False
) -> Any:
    """Return a dataclass field for a number from `low` to `high`; default None is optional."""
    key = Key(low, high, meaning, is_whole, is_optional=default is None)
    return field(default=default, metadata={"key": key})


def one_of(default: str, choices: tuple[str, ...], meaning: str) -> Any:
    """Return a dataclass field for one of a few words."""
    return field(
        default=default, metadata={"key": Key(-math.inf, math.inf, meaning, choices=choices)}
    )


def keys_of(cls: type) -> dict[str, Key]:
    """Return the keys of a settings class, in order."""
    return {f.name: _key(f) for f in fields(cls)}


def check_fields(settings: Any) -> None:
    """Judge every field of a settings object; raise SettingsError that names all faults."""
    faults = [
        f"{name} = {value!r}: {fault}"
        for name, key in keys_of(type(settings)).items()
        if (fault := key.fault(value := getattr(settings, name)))
    ]
    if faults:
        raise SettingsError("; ".join(faults))


def settings_from(cls: type[_T], raw: Any, where: str) -> _T:
    """Return a settings object from a mapping as a scene file holds it.

    Fields that are not named keep their defaults; None is empty. Raises SceneError, one line
    with `where` and the key, if `raw` is no mapping, or a key is unknown or impossible.
    """
    return cls(**checked(raw, keys_of(cls), where))


def checked(raw: Any, keys: Mapping[str, Key], where: str) -> dict[str, Any]:
    """Return a copy of the mapping `raw` once every key and value in it has been judged.

    Raises SceneError as `settings_from`.
    """
    if raw is None:
        return {}
    if not isinstance(raw, Mapping):
        msg = f"{where}: must be a mapping with keys of {', '.join(keys)}"
        raise SceneError(msg)
    for name, value in raw.items():
        if name not in keys:
            raise SceneError(unknown(name, keys, where))
        if fault := keys[name].fault(value):
            msg = f"{where}.{name}: {fault}"
            raise SceneError(msg)
    return dict(raw)


def unknown(name: Any, known: Collection[str], where: str, what: str = "unknown key") -> str:
    """Return the message for a name that does not exist, with the nearest that does."""
    near = difflib.get_close_matches(str(name), list(known), n=1)
    hint = renamed(str(name)) or (f"did you mean {near[0]}? " if near else "")
    return f"{where}.{name}: {what}; {hint}known are {', '.join(known)}"


def _key(f: "Field[Any]") -> Key:
    key = f.metadata["key"]
    assert isinstance(key, Key)  # noqa: S101 - every field is made by limited or one_of
    return key
