"""History: the last records of a run, for pages that open later; any thread may use it."""

import threading
from collections import deque
from collections.abc import Mapping
from typing import Any

from radard.outputs.base import Record

DECISIONS, EVENTS = 3600, 500  # an hour of decisions, and as many events as a page shows
N_BEFORE = 16  # decisions that confirmation looks at, at most (`alarm.confirm_n`)
_MAX_ALARMS = 100  # whose decisions are kept for longer: days of them


class History:
    """The last decisions, longer before alarms, the last events' last phase, and the hello."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._hello: Record = {}
        self._decisions: deque[Record] = deque(maxlen=DECISIONS)
        self._events: dict[str, Record] = {}
        self._causes: dict[str, list[Record]] = {}

    def take(self, record: Record) -> None:
        """Keep a decision or an event, and what began an alarm."""
        kind = record["type"]
        with self._lock:
            if kind == "decision":
                self._decisions.append(record)
            elif kind == "event":
                first = self._events.pop(record["id"], record)
                if first is record and record["kind"] == "alarm":
                    self._keep_cause(record)
                self._events[record["id"]] = {
                    **record,
                    "began": first.get("began", first["time"]),
                    "cause": first.get("cause", first["reason"]),
                    "clip": record["clip"] or first["clip"],
                    "peak": max(record["peak"], first["peak"]),
                }
                while len(self._events) > EVENTS:
                    del self._events[next(iter(self._events))]
            elif kind == "hello":
                self._hello = record

    @property
    def hello(self) -> Record:
        """The run's first record; empty before it came."""
        with self._lock:
            return self._hello

    def decisions(self, limit: int, *, before_seq: int | None = None) -> list[Record]:
        """Return the newest decisions, oldest first."""
        with self._lock:
            known = list(self._decisions)
        if before_seq is not None:
            known = [d for d in known if d["seq"] < before_seq]
        return known[-limit:] if limit else []

    def around(self, seq: int) -> list[Record]:
        """Return a decision and `N_BEFORE` before it, oldest first; empty when it is not known."""
        with self._lock:
            known = list(self._decisions)
            causes = list(self._causes.values())
        at = next((i for i, d in enumerate(known) if d["seq"] == seq), None)
        if at is not None:
            return known[max(0, at - N_BEFORE) : at + 1]
        return next((found for found in causes if found[-1]["seq"] == seq), [])

    def cause(self, event_id: str) -> int | None:
        """Return the number of the decision that an alarm began with; None if not known."""
        with self._lock:
            found = self._causes.get(event_id)
        return None if found is None else int(found[-1]["seq"])

    def _keep_cause(self, alarm: Record) -> None:
        """Keep the decisions up to the one that an alarm began with, if there was one."""
        last = list(self._decisions)[-N_BEFORE - 1 :]
        if last and last[-1]["t_s"] == alarm["start_t_s"]:
            self._causes[alarm["id"]] = last
        while len(self._causes) > _MAX_ALARMS:
            del self._causes[next(iter(self._causes))]

    def events(self) -> list[Mapping[str, Any]]:
        """Return events of this run, oldest first, each in its last phase."""
        with self._lock:
            return list(self._events.values())
