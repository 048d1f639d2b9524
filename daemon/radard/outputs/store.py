"""store: events, states and decisions in a SQLite file of limited size.

An event is one row, whatever phases it has gone through; `radard events` lists them. Events
and states are committed at once, decisions every ten seconds. Rows are deleted when they are
too old, and the oldest when the file is too large: decisions before events.
"""

import contextlib
import sqlite3
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from radard.config.sink_table import SinkOptions, StoreSection
from radard.errors import OutputError
from radard.outputs.base import DeliveryError, Record, SinkContext
from radard.outputs.database import ForeignDatabase, is_passing, open_database
from radard.outputs.thread_sink import DirectSink
from x2radar.backoff import Backoff

MARKS = ("test", "simulated", "replayed")
"""What a record has of an event that is only a test, and of a stream that is not live."""
APPLICATION_ID = int.from_bytes(b"rdst", "big")
VERSION = 3  # of the schema; see `_NEWER`
_COMMIT_S = 10.0  # chosen: what a power cut may cost of decisions
_PRUNE_S = 600.0  # chosen: how often rows are deleted
_SCHEMA = """
CREATE TABLE IF NOT EXISTS events (
    id TEXT PRIMARY KEY, sensor TEXT NOT NULL, kind TEXT NOT NULL, phase TEXT NOT NULL,
    start_s REAL NOT NULL, end_s REAL, start_t_s REAL NOT NULL, end_t_s REAL,
    peak REAL NOT NULL, reason TEXT NOT NULL, clip TEXT, mark TEXT
);
CREATE INDEX IF NOT EXISTS events_by_start ON events (start_s);
CREATE TABLE IF NOT EXISTS statuses (
    n INTEGER PRIMARY KEY, time_s REAL NOT NULL, state TEXT NOT NULL, reason TEXT NOT NULL,
    sensor TEXT
);
CREATE TABLE IF NOT EXISTS decisions (
    n INTEGER PRIMARY KEY, time_s REAL NOT NULL, seq INTEGER NOT NULL, t_s REAL NOT NULL,
    gate TEXT NOT NULL, power_db REAL, threshold_db REAL, p_human REAL, p_pet REAL,
    p_other REAL, label TEXT, alarm INTEGER NOT NULL, range_m REAL, sensor TEXT
);
"""
_PUT_EVENT = """
INSERT INTO events (id, sensor, kind, phase, start_s, end_s, start_t_s, end_t_s, peak, reason,
                    clip, mark)
VALUES (:id, :sensor, :kind, :phase, :time_s, :end_s, :start_t_s, :end_t_s, :peak, :reason,
        :clip, :mark)
ON CONFLICT (id) DO UPDATE SET
    phase = excluded.phase, end_s = excluded.end_s, end_t_s = excluded.end_t_s,
    peak = max(peak, excluded.peak), clip = coalesce(excluded.clip, clip),
    reason = CASE excluded.kind WHEN 'alarm' THEN reason ELSE excluded.reason END
"""
"""An alarm keeps the reason of its beginning: that of its end is nearly always 'nobody seen'."""
_PUT_DECISION = """
INSERT INTO decisions (time_s, seq, t_s, gate, power_db, threshold_db, p_human, p_pet, p_other,
                       label, alarm, range_m, sensor)
VALUES (:time_s, :seq, :t_s, :gate, :power_db, :threshold_db, :fused_p_human, :fused_p_pet,
        :fused_p_other, :label, :alarm, :range_m, :sensor)
"""
_NEWER = {
    2: tuple(f"ALTER TABLE {t} ADD COLUMN sensor TEXT" for t in ("statuses", "decisions")),
    3: ("ALTER TABLE events ADD COLUMN mark TEXT",),
}
"""Statements that bring a file of the previous version to each version."""
_OLDEST = """
DELETE FROM {0} WHERE rowid IN (
    SELECT rowid FROM {0} ORDER BY {1} LIMIT max(1, (SELECT count(*) FROM {0}) / 10)
)
"""


def open_from_url(url: str, options: SinkOptions, context: SinkContext) -> "StoreSink":
    """Return the sink of `store:FILE`."""
    return StoreSink(Path(url.partition(":")[2]), options.store, context)


class StoreSink(DirectSink):
    """Keep records in a SQLite file."""

    tick_s = 1.0
    is_durable = True

    def __init__(self, path: Path, options: StoreSection, context: SinkContext) -> None:
        super().__init__(f"store:{path}", Backoff(0.5, 10.0, str(path)), waits=context.can_wait)
        self._options = options
        self._sensor = context.sensor
        self._n_open = 0
        self._committed_s = time.monotonic()
        self._pruned_s = float("-inf")
        self._path = path
        self._db: sqlite3.Connection | None = None
        try:
            self._db = self._opened()
        except (OSError, sqlite3.Error, ForeignDatabase) as err:
            # Where nobody waits, a full disk must not keep the radar from its work.
            if self.waits or not is_passing(err):
                msg = f"--output {self.name}: cannot be used: {err}"
                raise OutputError(msg) from err

    def _opened(self) -> sqlite3.Connection:
        return open_database(
            self._path, _SCHEMA, application_id=APPLICATION_ID, version=VERSION, newer=_NEWER
        )

    def _take(self, record: Record) -> None:
        kind = record["type"]
        if kind in {"event", "status"} or (kind == "decision" and self._options.decisions):
            super()._take(record)

    def _deliver(self, record: Record) -> None:
        kind = record["type"]
        try:
            if self._db is None:
                self._db = self._opened()
            if not self._db.in_transaction:
                self._db.execute("BEGIN IMMEDIATE")
            if kind == "decision":
                time_s = _seconds(record["time"])
                row = {**record, "time_s": time_s, "sensor": self._of(record)}
                self._db.execute(_PUT_DECISION, row)
                self._n_open += 1
            elif kind == "event":
                self._db.execute(_PUT_EVENT, self._event_row(record))
                self._commit()
            else:
                self._db.execute(
                    "INSERT INTO statuses (time_s, state, reason, sensor) VALUES (?, ?, ?, ?)",
                    (time.time(), record["state"], record["reason"], self._of(record)),
                )
                self._commit()
        except (OSError, sqlite3.Error, ForeignDatabase) as err:
            self._roll_back()
            msg = f"cannot keep it: {err}"
            raise DeliveryError(msg) from err

    def _tick(self) -> None:
        now_s = time.monotonic()
        with self._rolled_back_on_error():
            if self._n_open and now_s - self._committed_s > _COMMIT_S:
                self._commit()
            if self._db is not None and now_s - self._pruned_s > _PRUNE_S:
                self._pruned_s = now_s
                self._commit()
                prune(self._db, self._options, time.time())

    def _shut(self) -> None:
        with self._rolled_back_on_error():
            self._commit()
        if self._db is not None:
            self._db.close()

    def _event_row(self, record: Record) -> dict[str, object]:
        time_s = _seconds(record["time"])
        end_s = time_s if record["phase"] == "end" else None
        mark = next((name for name in MARKS if record.get(name)), None)
        row = {"sensor": self._sensor, **record, "time_s": time_s}
        return row | {"end_s": end_s, "mark": mark}

    def _of(self, record: Record) -> str:
        return str(record.get("sensor", self._sensor))

    def _commit(self) -> None:
        self._committed_s = time.monotonic()
        if self._db is not None and self._db.in_transaction:
            self._db.execute("COMMIT")
        self._n_open = 0

    @contextlib.contextmanager
    def _rolled_back_on_error(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as err:
            self._roll_back()
            self._failed(f"cannot commit: {err}")

    def _roll_back(self) -> None:
        """Drop what is not committed: decisions of ten seconds at most."""
        if self._db is not None and self._db.in_transaction:
            with contextlib.suppress(sqlite3.Error):
                self._db.execute("ROLLBACK")
        self._drop(self._n_open, "the store takes nothing")
        self._n_open = 0


def prune(db: sqlite3.Connection, options: StoreSection, now_s: float) -> None:
    """Delete what is too old, and the oldest while the file is too large."""
    limit_s = now_s - options.keep_days * 86_400
    for table, column in (("decisions", "time_s"), ("statuses", "time_s"), ("events", "start_s")):
        db.execute(f"DELETE FROM {table} WHERE {column} < ?", (limit_s,))  # noqa: S608 - ours
    while _used_bytes(db) > options.keep_mb * 1e6:
        for table, column in (("decisions", "n"), ("statuses", "n"), ("events", "start_s")):
            if db.execute(_OLDEST.format(table, column)).rowcount > 0:
                break
        else:
            break
    # Frees one page a step, and only a script takes every step (Python's sqlite3 takes one).
    db.executescript("PRAGMA incremental_vacuum")
    db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()


def _used_bytes(db: sqlite3.Connection) -> int:
    pages, free, size = (
        int(db.execute(f"PRAGMA {name}").fetchone()[0])
        for name in ("page_count", "freelist_count", "page_size")
    )
    return (pages - free) * size


def _seconds(text: str) -> float:
    return datetime.fromisoformat(text).timestamp()
