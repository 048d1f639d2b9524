"""Profiles: points of the measured front of speed against accuracy, each a bundle and settings.

`radard/profiles.json` is written by `research/profiles.py`, which measures them; docs/tradeoff.md
tells of them.
"""

from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Literal

from radard.config.json_file import STRICT, parse_json
from x2radar.errors import PortUrlError, SettingsError
from x2radar.ports import parse_port

USUAL_HZ = 60.0  # frames a second where nobody asks for another rate
Three = tuple[float, float, float]
Bodies = Literal["apart", "together", "unfollowed"]  # made of several, from most to least


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """One measured point; a `Three` is a share with the ends of its 95 % interval."""

    __pydantic_config__ = STRICT

    name: str
    model: str  # `model.name`
    hop_s: float  # `decision.hop_s`
    bodies: Bodies  # `decision.bodies`
    rate_hz: float | None  # frames a second that a module is asked for; None: as usual
    # CPU time of a second of the stream, as a share of the dearest profile's with a gate that is
    # always open: so open, with one body in view, and of an empty room
    cpu_open: float
    cpu_one: float
    cpu_closed: float
    passages: int  # people, and as many visits of pets, that it was judged by
    missed: Three  # of people who come in
    pets: Three  # visits of pets with an alarm
    half_s: float  # from coming into view to the alarm, for half of the people
    slow_s: float  # and for nine in ten
    # Of recorded motion: people with an alarm, people, pets with one, pets; None: not judged
    recorded: tuple[int, int, int, int] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Front:
    """All that was measured, the cheapest first, and how."""

    __pydantic_config__ = STRICT

    command: str
    timed_on: str  # the processor, and how busy it was
    bundles: dict[str, str]  # hash of the weights of every bundle that judged, by name
    measured: tuple[Profile, ...]
    untimed: tuple[Profile, ...] = ()  # errors are known, CPU time (here 0) is not yet

    @property
    def profiles(self) -> tuple[Profile, ...]:
        """Those that have a name."""
        return tuple(p for p in self.measured if p.name)

    def named(self, name: str | None) -> Profile | None:
        """Return a profile; None if there is none of the name."""
        return next((p for p in self.profiles if p.name == name), None)


@lru_cache(maxsize=1)
def front() -> Front:
    """Return the front that came with this installation."""
    return parse_json(Front, (resources.files("radard") / "profiles.json").read_bytes())


def check_profile(name: str | None) -> str | None:
    """Raise ValueError unless there is such a profile; for pydantic."""
    if name is not None and front().named(name) is None:
        *names, last = (profile.name for profile in front().profiles)
        raise ValueError(f"no profile '{name}'; there are {', '.join(names)} or {last}")
    return name


def rated(port: str | None, name: str | None) -> str | None:
    """Return a radar's port, asked for the frame rate of a profile."""
    profile = front().named(name)
    rate_hz = profile.rate_hz if profile else None
    return port if port is None or rate_hz is None else with_rate(port, rate_hz)


def with_rate(port: str, rate_hz: float) -> str:
    """Return a port's string with its frame rate, unless it has one or cannot be asked for it."""
    try:
        parsed = parse_port(port)
    except (SettingsError, PortUrlError):
        return port
    is_free = parsed.kind != "replay" and not {"rate", "device"} & set(parsed.options)
    return f"{port}{'&' if '?' in port else '?'}rate={rate_hz:g}" if is_free else port
