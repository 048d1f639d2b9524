"""What a scene may ask of a body: numbers within limits, names that exist."""

from collections.abc import Collection

from x2radar.errors import SceneError


def check_number(key: str, value: float, low: float, high: float, whose: str = "") -> None:
    """Raise a SceneError that names `key` unless `low` <= `value` <= `high`."""
    if not low <= value <= high:
        msg = f"{key}: {value} is not in {low:g} to {high:g}{whose and ' for ' + whose}"
        raise SceneError(msg)


def check_name(key: str, name: str, known: Collection[str], what: str) -> None:
    """Raise a SceneError that names `key` and lists what is known, unless `name` is."""
    if name not in known:
        msg = f"{key}: no {what} '{name}'; known are {', '.join(known)}"
        raise SceneError(msg)
