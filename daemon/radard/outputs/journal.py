"""Journal: every event, on disk before any output is told of it, until each has kept it.

Outputs have queues and threads of their own, so a kill may come when one has spoken and another
has not written yet. What this file still holds for an output is told there after the next start:
an event that came out anywhere comes out everywhere, with the same id. Once an output has kept
it, in a file, a database or its outbox, it is not told there again.

A disk must not hold an alarm up: beyond half a second, and without a disk at all, events go out
while their journal is written, or not.
"""

import json
import logging
import sqlite3
import threading
from collections import deque
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from radard.outputs.database import ForeignDatabase, open_database
from radard.outputs.records import Record

log = logging.getLogger("radard")
_APPLICATION_ID = int.from_bytes(b"rdej", "big")
_VERSION = 1  # of the schema
_WAIT_S = 0.5  # chosen: a person does not notice it; disks take a tenth of it
_CLOSE_S = 1.0  # chosen: as above, for what outputs kept last
_MOST = 10_000  # rows, chosen: as many events as an output's queue holds
_SCHEMA = """
CREATE TABLE IF NOT EXISTS journal (
    n INTEGER PRIMARY KEY AUTOINCREMENT, output TEXT NOT NULL, key TEXT NOT NULL,
    record TEXT NOT NULL, UNIQUE (output, key)
);
"""
_LEFT = "SELECT n, CAST(output AS BLOB), CAST(record AS BLOB) FROM journal ORDER BY n"
_PUT = "INSERT OR IGNORE INTO journal (output, key, record) VALUES (?, ?, ?)"
_TAKEN = "DELETE FROM journal WHERE output = ? AND key = ?"
_PRUNE = "DELETE FROM journal WHERE n <= (SELECT max(n) FROM journal) - ?"


class EventJournal:
    """Keep events for outputs, which are texts that mean the same in the next run.

    Any thread may call; without a path nothing is kept.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._db: sqlite3.Connection | None = None
        self._has_failed = False
        # An output, the event's key, and the event, None once the output has kept it.
        self._waiting: deque[tuple[str, str, str | None]] = deque()
        self._n_asked = self._n_done = 0
        self._is_ended = False
        self._changed = threading.Condition()
        self._writer = threading.Thread(target=self._run, name="event journal", daemon=True)

    def left(self) -> dict[str, list[Record]]:
        """Return what an earlier run has left, by output and in order; to be called first."""
        found: dict[str, list[Record]] = {}
        if self._path is None or not self._path.exists():
            return found
        try:
            db = self._opened(self._path)
            for n, output, text in db.execute(_LEFT).fetchall():
                try:
                    record = json.loads(text)
                    _key_of(record)
                    found.setdefault(output.decode(), []).append(record)
                except (ValueError, TypeError, LookupError, RecursionError) as err:
                    log.warning("%s: an event in it is unreadable, skipped: %r", self._path, err)
                    db.execute("DELETE FROM journal WHERE n = ?", (n,))
        except (OSError, sqlite3.Error, ForeignDatabase) as err:
            log.warning("%s: the events in it are not told: %s", self._path, err)
        return found

    def note(self, record: Record, outputs: Iterable[str]) -> None:
        """Keep an event for these outputs; returns once it is on disk, or after half a second."""
        text, key = json.dumps(record), _key_of(record)
        n = self._ask([(output, key, text) for output in outputs])
        with self._changed:
            self._changed.wait_for(lambda: self._n_done >= n or self._is_ended, _WAIT_S)

    def taken(self, output: str, record: Mapping[str, Any]) -> None:
        """Forget an event that an output has kept; returns at once."""
        self._ask([(output, _key_of(record), None)])

    def close(self) -> None:
        """Write what waits, and close the file."""
        with self._changed:
            self._is_ended = True
            self._changed.notify_all()
        if self._writer.ident is not None:
            self._writer.join(_CLOSE_S)
        elif self._db is not None:
            self._db.close()

    def _ask(self, rows: list[tuple[str, str, str | None]]) -> int:
        """Let rows be written; return the number of the last."""
        if self._path is None:
            return 0
        with self._changed:
            if self._writer.ident is None and not self._is_ended:
                self._writer.start()
            self._waiting.extend(rows)
            self._n_asked += len(rows)
            self._changed.notify_all()
            return self._n_asked

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._is_ended)
                rows = list(self._waiting)
                self._waiting.clear()
            if not rows:
                break
            try:
                self._write(rows)
            except (OSError, sqlite3.Error, ForeignDatabase) as err:
                if not self._has_failed:
                    log.warning("%s: a kill may cost events: %s", self._path, err)
                self._has_failed = True
            else:
                self._has_failed = False
            with self._changed:
                self._n_done += len(rows)
                self._changed.notify_all()
        if self._db is not None:
            self._db.close()

    def _write(self, rows: list[tuple[str, str, str | None]]) -> None:
        assert self._path is not None  # noqa: S101 - there are no rows otherwise
        db = self._opened(self._path)
        db.execute("BEGIN IMMEDIATE")
        try:
            for output, key, text in rows:
                if text is None:
                    db.execute(_TAKEN, (output, key))
                else:
                    db.execute(_PUT, (output, key, text))
            db.execute(_PRUNE, (_MOST,))
            db.execute("COMMIT")
        finally:
            if db.in_transaction:
                db.execute("ROLLBACK")

    def _opened(self, path: Path) -> sqlite3.Connection:
        if self._db is None:
            self._db = open_database(
                path, _SCHEMA, application_id=_APPLICATION_ID, version=_VERSION
            )
        return self._db


def _key_of(record: Mapping[str, Any]) -> str:
    return f"{record['id']}-{record['phase']}-{record['t_s']!r}"
