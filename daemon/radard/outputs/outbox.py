"""Outbox: events that wait for their delivery, on disk, in order.

A row is deleted only when the far end has confirmed it, so a kill between delivery and
confirmation repeats an event and never loses one. The key of a row is (id, phase, t_s), by
which a receiver can tell repetitions. While the disk takes nothing, events wait in memory
instead; the alarm must not fail with its disk.

How long an event has waited is counted in seconds of running daemons, by monotonic clocks: the
file keeps where that count stands. A wall clock that is set must not make an alarm too old.
"""

import contextlib
import json
import logging
import sqlite3
import threading
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path

from radard.outputs.base import Record
from radard.outputs.database import ForeignDatabase, open_database

log = logging.getLogger("radard")
_APPLICATION_ID = int.from_bytes(b"rdob", "big")
_VERSION = 2  # of the schema
_TEND_S = 10.0  # chosen: how soon a disk is tried again, and what a kill takes off the count
_TRANSIENT = 100  # records in memory, chosen: of states and decisions only the newest matter
_SCHEMA = """
CREATE TABLE IF NOT EXISTS outbox (
    n INTEGER PRIMARY KEY AUTOINCREMENT,
    key TEXT NOT NULL UNIQUE,
    put_s REAL NOT NULL,
    record TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS clock (n INTEGER PRIMARY KEY CHECK (n = 0), run_s REAL NOT NULL);
"""
_NEWER = {2: ("UPDATE outbox SET put_s = 0",)}
"""Statements that bring a file of the previous version to each version."""
_STAND = "SELECT coalesce((SELECT run_s FROM clock), 0.0), (SELECT count(*) FROM outbox)"
_FIRST = """
SELECT n, CAST(key AS BLOB), CAST(put_s AS REAL), CAST(record AS BLOB) FROM outbox
WHERE n > ? ORDER BY n LIMIT 1
"""


@dataclass(frozen=True, slots=True)
class Item:
    """A record that waits; `key` is the same in every attempt, and in no other item."""

    n: int
    """Row; 0 for what is only in memory."""
    key: str
    put_s: float
    """Since when it has waited, by this process's monotonic clock."""
    record: Record


def _key_of(record: Record) -> str:
    if record.get("type") == "event":
        return f"{record['id']}-{record['phase']}-{record['t_s']!r}"
    return f"{record.get('type')}-{record.get('seq', '')}-{time.time_ns()}"


class Outbox:
    """Keep events until they are delivered; any thread may call.

    Parameters
    ----------
    path : Path or None
        SQLite file, see `open_database`; None is memory. `open` makes it.
    most : int
        Beyond so many the oldest is dropped.
    """

    def __init__(self, path: Path | None, most: int) -> None:
        self._path = path
        self._most = most
        self._lock = threading.Lock()
        self._unsaved: deque[Item] = deque(maxlen=most)
        self._transient: deque[Item] = deque(maxlen=_TRANSIENT)
        self._db: sqlite3.Connection | None = None
        self._offset_s = 0.0
        """From this process's monotonic clock to the file's."""
        self._n_saved = self._done = self._n_unreadable = 0
        self._fault = ""
        self._tended_s = time.monotonic()

    def __len__(self) -> int:
        with self._lock:
            return self._n_saved + len(self._unsaved) + len(self._transient)

    @property
    def fault(self) -> str:
        """Why events are kept in memory only; empty when they are on disk."""
        return self._fault

    def open(self) -> None:
        """Open the file; where that fails, events are kept in memory until it is possible."""
        with self._lock:
            self._open()

    def put(self, record: Record) -> int:
        """Keep an event; return how many others were dropped for it."""
        item = Item(0, _key_of(record), time.monotonic(), record)
        with self._lock:
            n_full = int(len(self._unsaved) >= self._most)
            self._unsaved.append(item)
            return n_full + self._save()

    def put_transient(self, record: Record) -> int:
        """Keep a record in memory only; return how many others were dropped for it."""
        with self._lock:
            n_full = int(len(self._transient) == _TRANSIENT)
            self._transient.append(Item(0, _key_of(record), time.monotonic(), record))
            return n_full

    def first(self) -> Item | None:
        """Return what is delivered next: events in order, before anything else.

        A row that cannot be read is deleted, logged and counted (`take_unreadable`).
        """
        with self._lock:
            while (row := self._first_row()) is not None:
                try:
                    record = json.loads(row[3])
                    if not isinstance(record, dict):
                        raise TypeError(type(record).__name__)  # noqa: TRY301 - logged below
                    return Item(row[0], row[1].decode(), row[2] - self._offset_s, record)
                except (ValueError, TypeError, AttributeError, RecursionError) as err:
                    log.warning("%s: row %d is unreadable, skipped: %r", self._path, row[0], err)
                    self._n_unreadable += 1
                    self._delete_to(row[0])
            waiting = self._unsaved or self._transient
            return waiting[0] if waiting else None

    def take_unreadable(self) -> int:
        """Return how many rows `first` has skipped since the last call."""
        with self._lock:
            n, self._n_unreadable = self._n_unreadable, 0
            return n

    def remove(self, item: Item) -> None:
        """Delete an item: it is delivered, or given up."""
        with self._lock:
            if item.n:
                self._delete_to(item.n)
                return
            for row in (self._unsaved, self._transient):
                with contextlib.suppress(ValueError):
                    row.remove(item)
                    return
            # Written to the file while it was being delivered.
            self._n_saved -= self._execute("DELETE FROM outbox WHERE key = ?", (item.key,)) or 0

    def defer(self, item: Item) -> None:
        """Put an event behind all others; it has waited as long as before."""
        with self._lock:
            if item in self._unsaved:
                self._unsaved.remove(item)
                self._unsaved.append(item)
            else:
                # One statement: a kill must not lose it. It takes a new number, as every event
                # does: AUTOINCREMENT would give one that it has not counted to the next, too.
                last = """INSERT OR REPLACE INTO outbox (key, put_s, record)
                          SELECT key, put_s, record FROM outbox WHERE key = ?"""
                self._execute(last, (item.key,))

    def tend(self) -> int:
        """Now and then: try a disk again that failed, and note how long events have waited.

        Returns how many events were dropped because there is no room for them.
        """
        now_s = time.monotonic()
        with self._lock:
            if now_s - self._tended_s < _TEND_S:
                return 0
            self._tended_s = now_s
            n_dropped = self._save()
            if self._n_saved or self._fault:
                self._note_clock()
            return n_dropped

    def unsaved(self) -> list[Record]:
        """Return the events that are in memory only, in order."""
        with self._lock:
            return [item.record for item in self._unsaved]

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            if self._n_saved:
                self._note_clock()
            if self._db is not None:
                with contextlib.suppress(sqlite3.Error):
                    self._db.close()
            self._db = None

    def _open(self) -> None:
        try:
            db = open_database(
                self._path,
                _SCHEMA,
                application_id=_APPLICATION_ID,
                version=_VERSION,
                newer=_NEWER,
            )
            run_s, n = db.execute(_STAND).fetchone()
            # A kill may have come before the count was noted.
            db.execute("UPDATE outbox SET put_s = ?1 WHERE NOT put_s <= ?1", (run_s,))
        except (OSError, sqlite3.Error, ForeignDatabase) as err:
            self._failed(err)
            return
        self._db, self._n_saved, self._fault = db, n, ""
        self._offset_s = run_s - time.monotonic()

    def _first_row(self) -> tuple[int, bytes, float, bytes] | None:
        if not self._n_saved or self._db is None:
            return None
        row: tuple[int, bytes, float, bytes] | None = None
        try:
            row = self._db.execute(_FIRST, (self._done,)).fetchone()
        except sqlite3.Error as err:
            self._failed(err)
        return row

    def _delete_to(self, n: int) -> None:
        # Noted here too: a disk that takes no deletion must not repeat the event.
        self._done = max(self._done, n)
        self._n_saved -= self._execute("DELETE FROM outbox WHERE n <= ?", (self._done,)) or 0

    def _note_clock(self) -> None:
        run_s = time.monotonic() + self._offset_s
        self._execute("INSERT OR REPLACE INTO clock VALUES (0, ?)", (run_s,))

    def _save(self) -> int:
        """Write to the file what is only in memory; return how many rows were dropped."""
        n_dropped = 0
        if self._db is None:
            self._open()
        while self._unsaved:
            item = self._unsaved[0]
            row = (item.key, item.put_s + self._offset_s, json.dumps(dict(item.record)))
            n = self._execute(
                "INSERT OR IGNORE INTO outbox (key, put_s, record) VALUES (?, ?, ?)", row
            )
            if n is None:
                return n_dropped
            self._n_saved += n
            self._unsaved.popleft()
            if self._n_saved > self._most:
                oldest = "DELETE FROM outbox WHERE n = (SELECT min(n) FROM outbox)"
                n = self._execute(oldest, ()) or 0
                self._n_saved -= n
                n_dropped += n
        return n_dropped

    def _execute(self, statement: str, values: tuple[object, ...]) -> int | None:
        """Return how many rows a statement has changed; None if the disk does not take it."""
        if self._db is None:
            return None
        try:
            n = self._db.execute(statement, values).rowcount
        except sqlite3.Error as err:
            self._failed(err)
            return None
        self._fault = ""
        return n

    def _failed(self, err: Exception) -> None:
        why = (isinstance(err, OSError) and err.strerror) or err
        if not self._fault:
            log.warning("%s: undelivered events are kept in memory only: %s", self._path, why)
        self._fault = f"events are kept in memory only: {why}"
