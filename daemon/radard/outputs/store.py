"""store: events, states and decisions in a SQLite file of limited size, for queries.

It has the form of the event log (`radard.log_file`) with a table of decisions beside it, which are
committed every ten seconds. Rows go by their order, decisions first, when the file is too large or
radard has run long enough since; a clock that is set deletes nothing.
"""

import contextlib
import json
import sqlite3
import time
import uuid
from datetime import datetime
from pathlib import Path

from radard.config.sink_table import SinkOptions, StoreSection, named_file
from radard.errors import OutputError
from radard.log_file import LogFile, fault_text, is_damage, is_passing
from radard.outputs.base import DeliveryError, Record, SinkContext
from radard.outputs.thread_sink import DirectSink
from x2radar.backoff import Backoff
from x2radar.wall_clock import utc_text

_COMMIT_S = 10.0  # what a power cut may cost of decisions
_PRUNE_S = 600.0  # a file grows by less than a megabyte meanwhile
_CHECK_S = 86_400.0  # reading 200 MB takes a memory card some seconds
_MAGIC, _MIN_PAGE = b"SQLite format 3\0", 512  # bytes (SQLite, "Database File Format", 1.3)
_DECISIONS = """
CREATE TABLE IF NOT EXISTS decisions (
    n INTEGER PRIMARY KEY AUTOINCREMENT, run_s REAL NOT NULL, time_s REAL NOT NULL,
    seq INTEGER NOT NULL, t_s REAL NOT NULL, gate TEXT NOT NULL, power_db REAL,
    threshold_db REAL, p_human REAL, p_pet REAL, p_other REAL, label TEXT,
    alarm INTEGER NOT NULL, range_m REAL, sensor TEXT
);
"""
_PUT_DECISION = """
INSERT INTO decisions (run_s, time_s, seq, t_s, gate, power_db, threshold_db, p_human, p_pet,
                       p_other, label, alarm, range_m, sensor)
VALUES (:run_s, :time_s, :seq, :t_s, :gate, :power_db, :threshold_db, :fused_p_human,
        :fused_p_pet, :fused_p_other, :label, :alarm, :range_m, :sensor)
"""
_PUT = "INSERT INTO log (key, run_s, record) VALUES (?, ?, ?)"
_OLD = "DELETE FROM {} WHERE run_s < (SELECT coalesce(max(run_s), 0) FROM stand) - ?"
_USED_BYTES = """
SELECT (page_count - freelist_count) * page_size
FROM pragma_page_count, pragma_freelist_count, pragma_page_size
"""
_OLDEST = """
DELETE FROM {0} WHERE n IN (
    SELECT n FROM {0} ORDER BY n LIMIT max(1, (SELECT count(*) FROM {0}) / 10)
)
"""


class StoreSink(DirectSink):
    """Keep records in the SQLite file of `store:FILE`."""

    tick_s = 1.0

    def __init__(self, url: str, options: SinkOptions, context: SinkContext) -> None:
        path, self._options = named_file(url), options.store
        kinds = {"event", "status"} | ({"decision"} if self._options.decisions else set())
        backoff, target = Backoff(0.5, 10.0, str(path)), str(path)
        super().__init__(f"store:{path}", backoff, context, target, kinds=kinds)
        self._sensor = context.sensor
        self._file = LogFile(path, self._keeper.remark, _DECISIONS)
        self._n_open = 0  # decisions that are not committed
        self._committed_s = time.monotonic()
        self._pruned_s = float("-inf")
        self._offset_s = 0.0  # from the monotonic clock to seconds that radard ran
        try:
            self._opened()
        except (OSError, sqlite3.Error) as err:
            # Where nobody waits, a full disk must not keep the radar from its work.
            is_other = is_damage(err) and _never_was_one(path)
            may_pass = is_passing(err) and not self.waits
            if is_other or not (self._begins_anew(err) or may_pass):
                raise OutputError(
                    f"--output {self.name}: cannot be used: {fault_text(err)}"
                ) from err

    def _opened(self) -> sqlite3.Connection:
        if self._file.is_taken_away():
            self._drop_open()
        is_open, db = self._file.db is not None, self._file.open()
        if not is_open:
            (run_s,) = db.execute("SELECT coalesce(max(run_s), 0) FROM stand").fetchone()
            self._offset_s = run_s - time.monotonic()
        return db

    def _deliver(self, record: Record) -> None:
        try:
            self._put(record)
        except (OSError, sqlite3.Error) as err:
            if not self._begins_anew(err):
                raise DeliveryError(f"cannot keep it: {fault_text(err)}") from err
            self._deliver(record)

    def _put(self, record: Record) -> None:
        db, kind = self._opened(), record["type"]
        if not db.in_transaction:
            db.execute("BEGIN IMMEDIATE")
        run_s = time.monotonic() + self._offset_s
        row = {"sensor": self._sensor, **record}
        if kind == "decision":
            time_s = datetime.fromisoformat(record["time"]).timestamp()
            db.execute(_PUT_DECISION, {**row, "time_s": time_s, "run_s": run_s})
            self._n_open += 1
            return
        text = json.dumps({"time": utc_text(), **row})
        db.execute(_PUT, (uuid.uuid4().hex, run_s, text))
        self._commit()

    def _tick(self) -> None:
        now_s = time.monotonic()
        try:
            if self._n_open and now_s - self._committed_s > _COMMIT_S:
                self._commit()
            if (db := self._file.db) is not None:
                self._file.check(_CHECK_S)
                if now_s - self._pruned_s > _PRUNE_S:
                    self._pruned_s = now_s
                    self._commit()
                    prune(db, self._options)
        except (OSError, sqlite3.Error) as err:
            if not self._begins_anew(err):
                self._keeper.failed(f"cannot commit: {fault_text(err)}")

    def _shut(self) -> None:
        with contextlib.suppress(sqlite3.Error):
            self._commit()
        self._file.close()
        self._drop_open()

    def _commit(self) -> None:
        self._committed_s = now_s = time.monotonic()
        db = self._file.db
        if db is not None and db.in_transaction:
            run_s = now_s + self._offset_s
            db.execute("INSERT OR REPLACE INTO stand VALUES (0, ?, 0)", (run_s,))
            db.execute("COMMIT")
        self._n_open = 0

    def _drop_open(self) -> None:
        """Count what went with the file uncommitted: decisions of ten seconds at most."""
        self._keeper.dropped(self._n_open, "the store takes nothing")
        self._n_open = 0

    def _begins_anew(self, err: Exception) -> bool:
        """Put a damaged file aside; return whether that was the fault and a new one is there."""
        self._drop_open()
        try:
            return self._file.put_aside(err) and self._opened() is not None
        except (OSError, sqlite3.Error):
            return False


open_from_url = StoreSink


def _never_was_one(path: Path) -> bool:
    """Return whether a file that is no database never was: a damaged one has whole pages."""
    with path.open("rb") as file:
        head = file.read(len(_MAGIC))
    return not _MAGIC.startswith(head) and path.stat().st_size % _MIN_PAGE != 0


def prune(db: sqlite3.Connection, options: StoreSection) -> None:
    """Delete what has been there for too long, and the oldest while the file is too large."""
    for table in ("decisions", "log"):
        db.execute(_OLD.format(table), (options.keep_days * 86_400,))
    while db.execute(_USED_BYTES).fetchone()[0] > options.keep_mb * 1e6:
        if not any(db.execute(_OLDEST.format(t)).rowcount > 0 for t in ("decisions", "log")):
            break
    # Frees one page a step, and only a script takes every step (Python's sqlite3 takes one).
    db.executescript("PRAGMA incremental_vacuum")
    db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
