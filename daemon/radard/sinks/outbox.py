"""Outbox: events that wait for their delivery, on disk, in order.

A row is deleted only when the far end has confirmed it, so a kill between delivery and
confirmation repeats an event and never loses one. The key of a row is (id, phase, t_s), by
which a receiver can tell repetitions. While the disk takes nothing, events wait in memory
instead; the alarm must not fail with its disk.
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

from radard.errors import OutputError
from radard.sinks.base import Record
from radard.sinks.database import ForeignDatabase, open_database

log = logging.getLogger("radard")
_APPLICATION_ID = int.from_bytes(b"rdob", "big")
_VERSION = 1  # of the schema
_TRANSIENT = 100  # records in memory, chosen: of states and decisions only the newest matter
_SCHEMA = """
CREATE TABLE IF NOT EXISTS outbox (
    n INTEGER PRIMARY KEY AUTOINCREMENT,
    key TEXT NOT NULL UNIQUE,
    put_s REAL NOT NULL,
    record TEXT NOT NULL
);"""


@dataclass(frozen=True, slots=True)
class Item:
    """A record that waits; `key` is the same in every attempt, and in no other item."""

    n: int
    """Row; 0 for what is only in memory."""
    key: str
    put_s: float
    """Wall-clock time at which it was put in, in seconds since 1970."""
    record: Record


def _key_of(record: Record) -> str:
    if record.get("type") == "event":
        return f"{record['id']}-{record['phase']}-{record['t_s']:g}"
    return f"{record.get('type')}-{record.get('seq', '')}-{time.time_ns()}"


class Outbox:
    """Keep events until they are delivered; any thread may call.

    Parameters
    ----------
    path : Path or None
        SQLite file, see `open_database`; OutputError if it cannot be made.
    most : int
        Beyond so many the oldest is dropped.
    """

    def __init__(self, path: Path | None, most: int) -> None:
        self._most = most
        self._lock = threading.Lock()
        self._unsaved: deque[Item] = deque(maxlen=most)
        self._transient: deque[Item] = deque(maxlen=_TRANSIENT)
        self._has_warned = False
        self._done = 0
        try:
            self._db = open_database(
                path, _SCHEMA, application_id=_APPLICATION_ID, version=_VERSION
            )
        except (OSError, sqlite3.Error, ForeignDatabase) as err:
            msg = f"{path}: undelivered events cannot be kept there: {err}"
            raise OutputError(msg) from err
        self._n_saved = int(self._db.execute("SELECT count(*) FROM outbox").fetchone()[0])

    def __len__(self) -> int:
        with self._lock:
            return self._n_saved + len(self._unsaved) + len(self._transient)

    def put(self, record: Record) -> int:
        """Keep an event; return how many others were dropped for it."""
        item = Item(0, _key_of(record), time.time(), record)
        with self._lock:
            n_full = int(len(self._unsaved) >= self._most)
            self._unsaved.append(item)
            return n_full + self._save()

    def put_transient(self, record: Record) -> int:
        """Keep a record in memory only; return how many others were dropped for it."""
        with self._lock:
            n_full = int(len(self._transient) == _TRANSIENT)
            self._transient.append(Item(0, _key_of(record), time.time(), record))
            return n_full

    def first(self) -> Item | None:
        """Return what is delivered next: events in order, before anything else."""
        with self._lock:
            row = None
            if self._n_saved:
                with contextlib.suppress(sqlite3.Error):
                    row = self._db.execute(
                        "SELECT n, key, put_s, record FROM outbox WHERE n > ? ORDER BY n LIMIT 1",
                        (self._done,),
                    ).fetchone()
            if row is not None:
                return Item(row[0], row[1], row[2], json.loads(row[3]))
            waiting = self._unsaved or self._transient
            return waiting[0] if waiting else None

    def remove(self, item: Item) -> None:
        """Delete an item: it is delivered, or given up."""
        with self._lock:
            if item.n:
                # Noted here too: a disk that takes no deletion must not repeat the event.
                self._done = max(self._done, item.n)
                self._execute("DELETE FROM outbox WHERE n <= ?", (self._done,))
                return
            for row in (self._unsaved, self._transient):
                with contextlib.suppress(ValueError):
                    row.remove(item)

    def close(self) -> None:
        """Close the file."""
        with self._lock, contextlib.suppress(sqlite3.Error):
            self._db.close()

    def _save(self) -> int:
        """Write to the file what is only in memory; return how many rows were dropped."""
        n_dropped = 0
        while self._unsaved:
            item = self._unsaved[0]
            row = (item.key, item.put_s, json.dumps(dict(item.record)))
            if not self._execute(
                "INSERT OR IGNORE INTO outbox (key, put_s, record) VALUES (?, ?, ?)", row
            ):
                return n_dropped
            self._unsaved.popleft()
            if self._n_saved > self._most and self._execute(
                "DELETE FROM outbox WHERE n = (SELECT min(n) FROM outbox)", ()
            ):
                n_dropped += 1
        return n_dropped

    def _execute(self, statement: str, values: tuple[object, ...]) -> bool:
        try:
            cursor = self._db.execute(statement, values)
        except sqlite3.Error as err:
            if not self._has_warned:
                log.warning("undelivered events are kept in memory only: %s", err)
            self._has_warned = True
            return False
        self._has_warned = False
        self._n_saved += cursor.rowcount * (1 if statement.startswith("INSERT") else -1)
        return True
