"""Quiet periods: hours of the week without alarms, as for a cleaning robot.

A period is written ``HH:MM-HH:MM`` or ``DAYS HH:MM-HH:MM`` with DAYS as ``Mon``, ``Mon-Fri`` or
``Sat,Sun``. One that ends before it begins goes on over midnight; the end is exclusive.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, tzinfo
from itertools import chain
from zoneinfo import ZoneInfo

from x2radar import wall_clock as clock

Now = Callable[[float], datetime | None]
_DAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
_FORM = re.compile(r"(?:([a-z,\- ]+) )?(\d\d?):([0-5]\d) ?- ?(\d\d?):([0-5]\d)")
_DAY = 24 * 60
QuietPeriod = tuple[range, ...]  # minutes since Monday, 00:00; those of a Sunday's night go on


@dataclass(frozen=True, slots=True)
class QuietHours:
    """Say whether a quiet period holds at a stream time, in `zone` (None: the machine's)."""

    periods: Sequence[QuietPeriod]
    zone: tzinfo | None
    now: Now

    def holds(self, t_s: float) -> bool:
        """Return whether it is quiet at a stream time, in seconds."""
        if not self.periods or (now := self.now(t_s)) is None:
            return False
        local = now.astimezone(self.zone)
        minute = (local.weekday() * 24 + local.hour) * 60 + local.minute
        return any(m in each for m in (minute, minute + 7 * _DAY) for each in chain(*self.periods))


def wall_clock(t_s: float) -> datetime | None:  # noqa: ARG001 - a live stream's time is now
    """Return the wall clock of a live stream."""
    return clock.now()


def recorded_clock(started_utc: str) -> Now:
    """Return the wall clock of a recording: its start plus stream time; None if it has none."""
    started = clock.parse_utc(started_utc)
    return lambda t_s: started + timedelta(seconds=t_s) if started is not None else None


def parse_quiet(text: str) -> QuietPeriod:
    """Read a period; raise ValueError with one line when it is none."""
    match = _FORM.fullmatch(text.strip().lower())
    if match is not None:
        days, from_h, from_m, to_h, to_m = match.groups()
        found = range(7) if days is None else _days_of(days)
        start, end = int(from_h) * 60 + int(from_m), int(to_h) * 60 + int(to_m)
        if found and start < _DAY and end <= _DAY and start != end:
            end += _DAY if end < start else 0
            return tuple(range(day * _DAY + start, day * _DAY + end) for day in found)
    msg = f"quiet period '{text}': write 22:00-06:30, Mon-Fri 08:00-17:00 or Sun 00:00-24:00"
    raise ValueError(msg)


def time_zone(name: str | None) -> tzinfo | None:
    """Return a time zone by name, None for the machine's own; raise ValueError if unknown."""
    if name is None:
        return None
    try:
        return ZoneInfo(name)
    except (OSError, ValueError, KeyError) as err:
        raise ValueError(f"time zone '{name}': unknown; write one as Europe/Oslo or UTC") from err


def _days_of(text: str) -> set[int]:
    """Return the days of a list of them and of spans of them; none if one is unknown."""
    days: set[int] = set()
    for part in text.replace(" ", "").split(","):
        first, _, last = part.partition("-")
        if first not in _DAYS or (last or first) not in _DAYS:
            return set()
        start, stop = _DAYS.index(first), _DAYS.index(last or first)
        days.update((start + k) % 7 for k in range((stop - start) % 7 + 1))
    return days
