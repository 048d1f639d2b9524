"""Plug-ins: what other distributions offer under entry points, found when a name is unknown.

The search reads the metadata of every installed distribution, so a run that needs no plug-in does
not search. What cannot be loaded, or does not do what it should, is one line with name and
distribution.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import metadata
from typing import Any

from x2radar.errors import PluginError, X2RadarError

BODIES = "x2radar.bodies"


@dataclass(frozen=True, slots=True)
class Plugin:
    """A plug-in that was found and loaded."""

    about: str  # group, name and distribution, for messages
    made: Any  # what the entry point names

    def guard(self, work: Callable[[], Any]) -> Any:
        """Return what `work` does; PluginError for what goes wrong, but not on purpose, in it."""
        try:
            return work()
        except Exception as err:
            if isinstance(err, X2RadarError) or hasattr(err, "exit_code"):
                raise
            msg = f"{self.about}: {type(err).__name__}: {' '.join(str(err).split())}"
            raise PluginError(msg) from err

    def check(self, made: Any, names: Iterable[str]) -> None:
        """Raise PluginError if an object lacks any of these attributes."""
        missing = [name for name in names if not hasattr(made, name)]
        if missing:
            raise PluginError(f"{self.about}: {type(made).__name__} has no {', '.join(missing)}")


def find_plugin(group: str, name: str) -> Plugin | None:
    """Return the plug-in of a group with a name; None if there is none, or PluginError."""
    # The same distribution may be found twice: once installed, once by its folder.
    found = {point.value: point for point in metadata.entry_points(group=group, name=name)}
    if not found:
        return None
    if len(found) > 1:
        offers = ", ".join(sorted(_distribution(point) for point in found.values()))
        raise PluginError(f"plug-in '{name}' of {group}: several offer it: {offers}")
    (point,) = found.values()
    about = f"plug-in '{name}' of {group} ({_distribution(point)})"
    try:
        made = point.load()
    except Exception as err:
        msg = f"{about}: cannot be loaded: {type(err).__name__}: {' '.join(str(err).split())}"
        raise PluginError(msg) from err
    return Plugin(about, made)


def plugin_names(group: str) -> tuple[str, ...]:
    """Return the names of all plug-ins of a group, for messages; loads none of them."""
    return tuple(sorted({point.name for point in metadata.entry_points(group=group)}))


def _distribution(point: Any) -> str:
    return str(point.dist.name if point.dist is not None else point.value)
