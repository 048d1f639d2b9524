"""What a setting may be: one table of keys judges settings made in code and scene files."""

import difflib
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

import numpy as np

from x2radar.errors import SceneError, SettingsError

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Key:
    """Allowed values of one setting: a number within limits, or one of a few words."""

    low: float = math.inf  # least number that makes sense; inf where only words do
    high: float = math.inf
    meaning: str = ""  # a few words with the unit, for help and docs
    is_whole: bool = False
    is_optional: bool = False  # None is allowed
    choices: tuple[Any, ...] = ()  # words, or a few values, that it may be

    def fault(self, value: Any) -> str:
        """Return what is wrong with `value` in a few words, or an empty string."""
        if value is None and self.is_optional:
            return ""
        if any(value == each and type(value) is type(each) for each in self.choices):
            return ""
        if self.low == math.inf:
            return f"must be one of {', '.join(map(str, self.choices))}, not {value!r}"
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
            return f"must be a number, not {value!r}"
        if not self.low <= value <= self.high:
            # Not :g for the value: a whole number beyond 1e308 has no such form.
            return f"{value} is not in {self.low:g} to {self.high:g}"
        if self.is_whole and float(value) % 1 != 0:
            return f"must be a whole number, not {value}"
        return ""

    def judge(self, value: Any, where: str) -> None:
        """Raise SceneError, one line that begins with `where`, if `value` is impossible."""
        if fault := self.fault(value):
            raise SceneError(f"{where}: {fault}")


def limited(
    default: float | None, low: float, high: float, meaning: str, *, is_whole: bool = False
) -> Any:
    """Return a dataclass field for a number from `low` to `high`; default None is optional."""
    key = Key(low, high, meaning, is_whole, is_optional=default is None)
    return field(default=default, metadata={"key": key})


def one_of(default: Any, choices: tuple[Any, ...], meaning: str) -> Any:
    """Return a dataclass field for one of a few words or values of one type."""
    return field(default=default, metadata={"key": Key(meaning=meaning, choices=choices)})


def _keys_of(cls: type) -> dict[str, Key]:
    """Return the keys of a settings class, in order."""
    return {f.name: f.metadata["key"] for f in fields(cls)}


class Checked:
    """Base of settings, with fields by `limited` and `one_of`, that are judged when made."""

    __slots__ = ()

    def __post_init__(self) -> None:
        """Check every field, then what they make together; SettingsError names all faults."""
        values = ((name, key, getattr(self, name)) for name, key in _keys_of(type(self)).items())
        judged = ((name, value, key.fault(value)) for name, key, value in values)
        faults = [f"{name} = {value!r}: {fault}" for name, value, fault in judged if fault]
        if faults := faults or list(self.faults_together()):
            raise SettingsError("; ".join(faults))

    def faults_together(self) -> Iterator[str]:
        """Yield what is wrong with the fields together, each of which is good."""
        yield from ()


def settings_from(cls: type[_T], raw: Any, where: str) -> _T:
    """Return a settings object from a mapping; SceneError names `where` and the key."""
    return cls(**checked(raw, _keys_of(cls), where))


def checked(raw: Any, keys: Mapping[str, Key | None], where: str) -> dict[str, Any]:
    """Return a copy of `raw` once every key and value is judged, None takes any; or SceneError."""
    if raw is None:
        return {}
    if not isinstance(raw, Mapping):
        raise SceneError(f"{where}: must be a mapping with the keys {', '.join(keys)}")
    for name, value in raw.items():
        if name not in keys:
            raise SceneError(unknown(name, keys, where))
        if (key := keys[name]) is not None:
            key.judge(value, f"{where}.{name}")
    return dict(raw)


def unknown(name: Any, known: Collection[str], where: str, what: str = "unknown key") -> str:
    """Return the message for a name that does not exist, with the nearest that does."""
    near = difflib.get_close_matches(str(name), list(known), n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    return f"{where}.{name}: {what}; {hint}known are {', '.join(known)}"


def unrepeated(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the pairs of an object in JSON as a mapping; ValueError if one of them stands twice.

    What `object_pairs_hook` takes: `json` itself drops the first of the two without a word.
    """
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"the key '{key[:60]}' stands twice")
        found[key] = value
    return found


def place_of(value: Any, where: str, names: str = "x and y") -> tuple[float, ...]:
    """Return a place in the room, each number within 100 m; raise SceneError if it is none."""
    n = 2 + names.count(",")
    if not isinstance(value, (list, tuple, np.ndarray)) or len(value) != n:
        raise SceneError(f"{where}: must be {n} numbers, {names} in metres, not {value!r}")
    for k, number in enumerate(value):
        Key(-100, 100).judge(number, f"{where}[{k}]")
    return tuple(map(float, value))
