"""Decisions to events: an alarm or fault has a beginning and an end, and an id.

The id is a ULID whose time part is stream time and whose random part is a digest of the
frames that the event began with. So a replay gives the same ids, and two nights of live
frames never do.
"""

import hashlib
from dataclasses import dataclass, replace
from typing import Literal

from radard.decision import Decision
from radard.ring import Dwell, Notice

_CROCKFORD = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """One phase of an alarm or a fault.

    Attributes
    ----------
    id : str
        ULID; the same in every phase of one event.
    phase : {'new', 'end'}
        Whether it begins or ends.
    kind : {'alarm', 'fault'}
        What it is.
    t_s, start_t_s : float
        Stream time of this phase and of the beginning, in seconds.
    end_t_s : float or None
        Stream time of the end.
    peak : float
        Highest probability of a human so far; 0 for a fault.
    reason : str
        For people.
    """

    id: str
    phase: Literal["new", "end"]
    kind: Literal["alarm", "fault"]
    t_s: float
    start_t_s: float
    end_t_s: float | None
    peak: float
    reason: str


class EventTracker:
    """Follow decisions and notices; return the events that they begin or end."""

    def __init__(self) -> None:
        self._open: dict[str, Event] = {}

    def on_decision(self, decision: Decision, dwell: Dwell) -> list[Event]:
        """Take a decision and the dwell it was made on."""
        invalid = decision.gate == "invalid"
        p_human = decision.fused.human if decision.fused else 0.0
        t_s = decision.t_s
        fault = decision.fault if invalid else None
        events = self._follow("fault", fault, t_s=t_s, dwell=dwell)
        if invalid:
            # Nobody was seen to leave: an alarm outlives the windows that cannot be judged.
            return events
        found = decision.reading.range_m if decision.reading else 0.0
        reason = f"{decision.label} at {found:.1f} m" if decision.alarm else None
        return events + self._follow("alarm", reason, t_s=t_s, peak=p_human, dwell=dwell)

    def on_notice(self, notice: Notice) -> list[Event]:
        """Take a notice: a restart or a lost device is a fault until the next whole dwell."""
        if notice.kind == "found":
            return []
        return self._follow("fault", notice.reason, t_s=notice.t_s)

    def _follow(
        self,
        kind: Literal["alarm", "fault"],
        reason: str | None,
        *,
        t_s: float,
        peak: float = 0.0,
        dwell: Dwell | None = None,
    ) -> list[Event]:
        """Begin, keep or end one kind of event; no reason means that it is over."""
        old = self._open.get(kind)
        if old is None:
            if reason is None:
                return []
            new = Event(
                id=_ulid(kind, t_s, dwell),
                phase="new",
                kind=kind,
                t_s=t_s,
                start_t_s=t_s,
                end_t_s=None,
                peak=peak,
                reason=reason,
            )
            self._open[kind] = new
            return [new]
        peak = max(old.peak, peak)
        if reason is not None:
            self._open[kind] = replace(old, peak=peak)
            return []
        del self._open[kind]
        return [replace(old, phase="end", t_s=t_s, end_t_s=t_s, peak=peak)]


def _ulid(kind: str, t_s: float, dwell: Dwell | None) -> str:
    digest = hashlib.blake2b(f"{kind} {t_s:.6f}".encode(), digest_size=10)
    if dwell is not None:
        digest.update(dwell.frames[-1].tobytes())
    number = (int(t_s * 1000) & (1 << 48) - 1) << 80 | int.from_bytes(digest.digest(), "big")
    return "".join(_CROCKFORD[number >> 5 * k & 31] for k in range(25, -1, -1))
