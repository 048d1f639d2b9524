"""SinkWatch: which outputs are in trouble, for health to say so and to take it back."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from radard.outputs.base import Sink, SinkState

GRACE_S = 5.0  # a retry that helps within that is no trouble; a connection takes a moment, too
STUCK_S = 20.0  # records wait and nothing moves: the sink's thread hangs, or its far end does
DROPPED_S = 60.0  # how long it is said that records were dropped: long enough to be read

Key = tuple[str | None, str]


@dataclass(slots=True)
class _Seen:
    """What was seen of a sink, and when it was last well in one respect or the other."""

    ok_s: float
    moved_s: float
    dropped_s: float = float("-inf")
    counts: tuple[int, int, int] = (0, 0, 0)
    n_dropped: int = 0


class SinkWatch:
    """Look at sinks again and again, by the host's monotonic clock."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._seen: dict[Key, _Seen] = {}

    def look(self, sinks: Iterable[tuple[str | None, Sink]]) -> dict[Key, str]:
        """Return what is wrong with sinks, by their only sensor, if any, and name."""
        found: dict[Key, str] = {}
        now_s = self._clock()
        known, self._seen = self._seen, {}
        for sensor, sink in sinks:
            key = (sensor, sink.name)
            seen = self._seen[key] = known.get(key) or _Seen(now_s, now_s)
            reason = _reason(sink.state, seen, now_s)
            if reason:
                found[key] = reason
        return found


def _reason(state: SinkState, seen: _Seen, now_s: float) -> str:
    counts = (state.n_sent, state.n_dropped, state.n_failures)
    if counts != seen.counts or not state.n_waiting:
        seen.counts, seen.moved_s = counts, now_s
    if state.is_ok:
        seen.ok_s = now_s
    if state.n_dropped > seen.n_dropped:
        seen.dropped_s = now_s
    seen.n_dropped = state.n_dropped
    reasons = []
    if now_s - seen.ok_s >= GRACE_S:
        reasons.append(state.reason or "does not work")
    elif max(now_s - seen.moved_s, state.busy_s) >= STUCK_S:
        reasons.append(f"stands still, {state.n_waiting} records wait")
    if state.remark:
        reasons.append(state.remark)
    if now_s - seen.dropped_s < DROPPED_S:
        reasons.append("drops records")
    return ", ".join(reasons)
