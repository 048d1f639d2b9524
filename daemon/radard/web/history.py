"""History: the last records of a run, for pages that open later; any thread may use it."""

import threading
from collections import deque
from collections.abc import Mapping
from typing import Any

from radard.sinks.base import Record

DECISIONS, EVENTS = 3600, 500  # chosen: an hour of decisions, and as many events as a page shows


class History:
    """The last decisions, the last events in their last phase, and the hello."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._hello: Record = {}
        self._decisions: deque[Record] = deque(maxlen=DECISIONS)
        self._events: dict[str, Record] = {}

    def take(self, record: Record) -> None:
        """Keep a record."""
        kind = record["type"]
        with self._lock:
            if kind == "decision":
                self._decisions.append(record)
            elif kind == "event":
                first = self._events.pop(record["id"], record)
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

    def around(self, seq: int, n_before: int) -> list[Record]:
        """Return a decision and those before it, oldest first; empty when it is not known."""
        with self._lock:
            known = list(self._decisions)
        at = next((i for i, d in enumerate(known) if d["seq"] == seq), None)
        return [] if at is None else known[max(0, at - n_before) : at + 1]

    def events(self) -> list[Mapping[str, Any]]:
        """Return events of this run, oldest first, each in its last phase."""
        with self._lock:
            return list(self._events.values())
