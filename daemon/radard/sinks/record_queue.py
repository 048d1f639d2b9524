"""RecordQueue: bounded, in order, and choosy about what it drops.

When a sink cannot keep up, decisions go first, the oldest of them; there is another one in a
second. States are few and only the newest matters. Events have room of their own that no
flood of decisions can take.
"""

import threading
import time
from collections import deque

from radard.sinks.base import Record

ROOM = 1000
STATE_ROOM = 100
EVENT_ROOM = 10_000


class RecordQueue:
    """Hand records from one thread to another.

    Parameters
    ----------
    room : int
        Decisions, and records of types unknown here, that fit.
    waits : bool
        `put` waits for room instead of dropping.
    """

    def __init__(self, room: int = ROOM, *, waits: bool = False) -> None:
        self._waits = waits
        self._rooms = {"decision": room, "event": EVENT_ROOM, "status": STATE_ROOM}
        self._rows: dict[str, deque[tuple[int, Record]]] = {kind: deque() for kind in self._rooms}
        self._n_put = 0
        self._is_ended = self._is_poked = False
        self._changed = threading.Condition()

    def __len__(self) -> int:
        """Return how many records wait."""
        with self._changed:
            return sum(map(len, self._rows.values()))

    @property
    def is_ended(self) -> bool:
        """Whether `end` was called."""
        return self._is_ended

    def put(self, record: Record) -> int:
        """Take a record; return how many were dropped for it."""
        kind = str(record.get("type"))
        if kind == "hello":
            kind = "status"
        elif kind not in self._rows:
            kind = "decision"
        with self._changed:
            row, room = self._rows[kind], self._rooms[kind]
            while self._waits and len(row) >= room and not self._is_ended:
                self._changed.wait()
            if self._is_ended:
                return 1
            n_dropped = 0
            if len(row) >= room:
                row.popleft()
                n_dropped = 1
            row.append((self._n_put, record))
            self._n_put += 1
            self._changed.notify_all()
            return n_dropped

    def take(self, timeout_s: float | None = None) -> Record | None:
        """Return the oldest record; None after `timeout_s`, after `poke`, or at the end."""
        deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
        with self._changed:
            while True:
                waiting = [row for row in self._rows.values() if row]
                if waiting:
                    _, record = min(waiting, key=lambda row: row[0][0]).popleft()
                    self._changed.notify_all()
                    return record
                left_s = None if deadline_s is None else deadline_s - time.monotonic()
                is_late = left_s is not None and left_s <= 0
                if self._is_ended or self._is_poked or is_late:
                    self._is_poked = False
                    return None
                self._changed.wait(left_s)

    def poke(self) -> None:
        """Let the taker look around."""
        with self._changed:
            self._is_poked = True
            self._changed.notify_all()

    def wait_for_end(self, timeout_s: float) -> bool:
        """Wait until `end` is called; return whether it was."""
        with self._changed:
            return self._changed.wait_for(lambda: self._is_ended, timeout_s)

    def end(self) -> None:
        """Refuse further records; what waits can still be taken."""
        with self._changed:
            self._is_ended = True
            self._changed.notify_all()
