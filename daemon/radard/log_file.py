"""The SQLite file of a log: in WAL mode, checked, put aside when damaged, read by anyone.

Tables::

    log      n (never used twice), key, run_s, record (JSON)
    cursors  name, done, seen, deferred (JSON): how far each output is, see `radard.log.Cursor`
    kept     name, text: what must outlive the daemon beside events
    stand    run_s: seconds for which daemons have run with this file; last: its last number

The views `events` (one row an event, by its last phase) and `statuses` are for those who query it.
"""

import contextlib
import errno
import json
import os
import re
import sqlite3
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from radard.errors import RadardError, UsageError

MARKS = ("test", "simulated", "replayed")  # of a test, and of a stream that is not live
_APPLICATION_ID = int.from_bytes(b"rdlg", "big")
_VERSION = 1  # of the schema
_BUSY_S = 1.0  # a lock, as of a backup, is soon gone; the next attempt comes anyway
_KEYS = {"event": ("id", "phase", "kind", "t_s", "time", "start_t_s", "peak", "reason", "clip")}
"""What a record of a type must have to be one."""
_UNIT_S = {"s": 1, "min": 60, "h": 3600, "d": 86_400, "w": 604_800}
_DAMAGE = frozenset({sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR})
"""SQLITE_ERROR: a table or column of ours is missing."""
_PASSING_ON_DISK = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO})
_PASSING = frozenset(
    {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_FULL}
)
_SCHEMA = """
CREATE TABLE IF NOT EXISTS log (
    n INTEGER PRIMARY KEY AUTOINCREMENT, key TEXT NOT NULL UNIQUE, run_s REAL NOT NULL,
    record TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS cursors (
    name TEXT PRIMARY KEY, done INTEGER NOT NULL, seen INTEGER NOT NULL, deferred TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS kept (name TEXT PRIMARY KEY, text TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS stand (
    row INTEGER PRIMARY KEY CHECK (row = 0), run_s REAL NOT NULL, last INTEGER NOT NULL
);
CREATE VIEW IF NOT EXISTS phases AS
    SELECT n, json_extract(record, '$.id') AS id, json_extract(record, '$.sensor') AS sensor,
        json_extract(record, '$.kind') AS kind, json_extract(record, '$.phase') AS phase,
        (julianday(json_extract(record, '$.time')) - 2440587.5) * 86400 AS time_s,
        json_extract(record, '$.t_s') AS t_s, json_extract(record, '$.start_t_s') AS start_t_s,
        json_extract(record, '$.peak') AS peak, json_extract(record, '$.reason') AS reason,
        json_extract(record, '$.clip') AS clip,
        CASE WHEN json_extract(record, '$.test') THEN 'test'
            WHEN json_extract(record, '$.simulated') THEN 'simulated'
            WHEN json_extract(record, '$.replayed') THEN 'replayed' END AS mark
    FROM log WHERE json_extract(record, '$.type') = 'event';
CREATE VIEW IF NOT EXISTS events AS
    SELECT first.id, first.sensor, first.kind, last.phase, first.time_s AS start_s,
        CASE last.phase WHEN 'end' THEN last.time_s END AS end_s, first.start_t_s,
        CASE last.phase WHEN 'end' THEN last.t_s END AS end_t_s, whole.peak,
        CASE first.kind WHEN 'alarm' THEN first.reason ELSE last.reason END AS reason,
        whole.clip, first.mark
    FROM (SELECT id, min(n) AS first_n, max(n) AS last_n, max(peak) AS peak, max(clip) AS clip
        FROM phases GROUP BY id) AS whole
    JOIN phases AS first ON first.n = whole.first_n JOIN phases AS last ON last.n = whole.last_n
    ORDER BY first.n;
CREATE VIEW IF NOT EXISTS statuses AS
    SELECT n, (julianday(json_extract(record, '$.time')) - 2440587.5) * 86400 AS time_s,
        json_extract(record, '$.state') AS state, json_extract(record, '$.reason') AS reason,
        json_extract(record, '$.sensor') AS sensor
    FROM log WHERE json_extract(record, '$.type') = 'status';
"""


class ForeignDatabase(sqlite3.DatabaseError):
    """A file of another program, or of a newer version."""


class StoreError(RadardError):
    """A log is missing or unreadable."""

    exit_code = 66


def marks_of(record: Mapping[str, Any]) -> str:
    """Return how a text says so of an event, behind a blank; nothing of a live one."""
    marks = [mark for mark in MARKS if record.get(mark)]
    return f" ({', '.join(marks)})" if marks else ""


def open_log_file(path: Path, more: str = "") -> sqlite3.Connection:
    """Open or make a log in autocommit mode; every commit reaches the disk.

    It is made for its owner alone, whatever the umask. `more` are statements that make further
    tables where there are none. Any thread may use the connection, under the caller's lock. Raises
    ForeignDatabase if it is not ours to change, OSError or sqlite3.Error if it cannot be made, or
    is damaged (`is_damage`).
    """
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    with contextlib.suppress(FileExistsError):
        os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
    if not path.is_file():
        raise OSError(errno.EINVAL, "it is no file", str(path))
    # Not as it is written: SQLite takes some names, as :memory:, for no file.
    whole = path.absolute()
    db = sqlite3.connect(whole, timeout=_BUSY_S, isolation_level=None, check_same_thread=False)
    try:
        _check_owner(db)
        db.execute("PRAGMA auto_vacuum=INCREMENTAL")
        # First, so that a kill leaves no file that looks like another program's; and only if it
        # must be: a file that is open elsewhere cannot always be written.
        for name, value in (("application_id", _APPLICATION_ID), ("user_version", _VERSION)):
            if db.execute(f"PRAGMA {name}").fetchone()[0] != value:
                db.execute(f"PRAGMA {name}={value}")
        db.execute("PRAGMA journal_mode=WAL")
        db.execute("PRAGMA synchronous=FULL")
        db.executescript(_SCHEMA + more)
    except BaseException:
        db.close()
        raise
    return db


def damage(what: str) -> sqlite3.DatabaseError:
    """Return an error that `is_damage`."""
    error = sqlite3.DatabaseError(what)
    error.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
    return error


class LogFile:
    """Keeps a log's file open, and puts it aside when it is damaged.

    `say` is told when the file was taken away or put aside; `more` as for `open_log_file`.
    """

    def __init__(self, path: Path, say: Callable[[str], None], more: str = "") -> None:
        self.path, self._say, self._more = path, say, more
        self._files = [path.with_name(path.name + tail) for tail in ("", "-wal", "-shm")]
        self.db: sqlite3.Connection | None = None
        self._inodes: list[object] = []  # of the files when they were opened
        self.checked_s = float("-inf")  # of the monotonic clock

    def open(self) -> sqlite3.Connection:
        """Return the connection, made as `open_log_file` does unless there is one."""
        if self.db is None:
            self.db = open_log_file(self.path, self._more)
            self._inodes = [*map(_inode_of, self._files)]
        return self.db

    def close(self) -> None:
        """Close the file; what is not committed is lost."""
        db, self.db = self.db, None
        if db is not None:
            with contextlib.suppress(sqlite3.Error):
                db.close()

    def is_taken_away(self) -> bool:
        """Return whether one of the files has gone since it was opened; then close it."""
        # Its companions go with the last connection, so they tell something of an open one alone.
        known = self._inodes if self.db is not None else self._inodes[:1]
        if is_gone := [*map(_inode_of, self._files)][: len(known)] != known:
            self._say("the file was taken away")
            self.close()
            self._inodes = []
        return is_gone

    def check(self, every_s: float = 0.0) -> None:
        """Read all pages, past all caches, unless that was done of late; may raise `damage`."""
        if time.monotonic() - self.checked_s >= every_s:
            self.checked_s = time.monotonic()
            uri = f"{self.path.resolve().as_uri()}?mode=ro"
            with closing(sqlite3.connect(uri, uri=True, timeout=_BUSY_S)) as db:
                found = db.execute("PRAGMA quick_check(1)").fetchone()[0]
            if found != "ok":
                raise damage(found)

    def put_aside(self, err: Exception) -> bool:
        """Close it; if damaged rename it to *.broken, one there goes. Return whether; OSError."""
        self.close()
        if is_damage(err):
            aside = self.path.replace(f"{self.path}.broken")
            for companion in self._files[1:]:
                companion.unlink(missing_ok=True)
            self._inodes = []
            self._say(f"damaged ({fault_text(err)}), put aside as {aside.name}")
        return is_damage(err)


def is_damage(err: Exception) -> bool:
    """Return whether a file is damaged, and not only out of reach for now."""
    return isinstance(err, sqlite3.DatabaseError) and _code(err) in _DAMAGE


def is_passing(err: BaseException | None) -> bool:
    """Return whether a fault of a disk or of SQLite may pass by itself, as a full disk does."""
    if isinstance(err, OSError):
        return err.errno in _PASSING_ON_DISK
    return isinstance(err, sqlite3.Error) and _code(err) in _PASSING


def fault_text(err: Exception) -> str:
    """Return what is wrong with a file, in one line that names no numbers of the system's."""
    return " ".join(str((isinstance(err, OSError) and err.strerror) or err).split())


def _code(err: sqlite3.Error) -> int:
    return int(getattr(err, "sqlite_errorcode", 0)) & 0xFF


def _check_owner(db: sqlite3.Connection) -> None:
    is_empty = db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] == 0
    owner, version = (
        db.execute(f"PRAGMA {name}").fetchone()[0] for name in ("application_id", "user_version")
    )
    if not is_empty and owner != _APPLICATION_ID:
        raise ForeignDatabase("a database of another program")
    if version > _VERSION:
        raise ForeignDatabase("made by a newer version")


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredEvent:
    """One event in its last known phase, by the names of the records of type event.

    `start_time` and `end_time` are the wall clock in UTC, ISO 8601; `end_time` is None if it has
    not ended, or the daemon did not see its end. `*_t_s` are stream time, in seconds. `reason` is
    that of an alarm's beginning, for its end is nearly always 'nobody seen'; else the last one.
    `mark` is one of `MARKS`, None of a live event. `lasted_s` is stream time, which nobody sets;
    over a restart the wall clock's, None where that was set back.
    """

    id: str
    sensor: str
    kind: str
    phase: str
    start_time: str
    end_time: str | None
    start_t_s: float
    end_t_s: float | None
    peak: float
    reason: str
    clip: str | None
    mark: str | None = None
    lasted_s: float | None = None


def fold_events(records: Iterable[Mapping[str, Any]]) -> list[StoredEvent]:
    """Return one event for all records of its phases, in the order of their beginnings."""
    found: dict[str, StoredEvent] = {}
    for record in records:
        if record["type"] != "event":
            continue
        is_over, first = record["phase"] == "end", found.get(record["id"])
        found[record["id"]] = StoredEvent(
            id=record["id"],
            sensor=first.sensor if first else record.get("sensor", ""),
            kind=record["kind"],
            phase=record["phase"],
            start_time=first.start_time if first else record["time"],
            end_time=record["time"] if is_over else None,
            start_t_s=first.start_t_s if first else record["start_t_s"],
            end_t_s=record["t_s"] if is_over else None,
            peak=max(record["peak"], first.peak) if first else record["peak"],
            reason=first.reason if first and record["kind"] == "alarm" else record["reason"],
            clip=record["clip"] or (first.clip if first else None),
            mark=next((mark for mark in MARKS if record.get(mark)), None),
            lasted_s=_lasted(first, record) if is_over else None,
        )
    return list(found.values())


def newest_events(
    events: Iterable[StoredEvent],
    *,
    since_s: float | None = None,
    kinds: Sequence[str] = (),
    limit: int | None = None,
) -> list[StoredEvent]:
    """Return those that began at `since_s` (wall clock, seconds since 1970) or later, of `kinds`.

    No kinds are all of them; of the rest the newest `limit`, the oldest first.
    """
    if since_s is not None:
        events = [each for each in events if _seconds(each.start_time) >= since_s]
    chosen = [each for each in events if not kinds or each.kind in kinds]
    return chosen[-limit:] if limit else chosen


def _lasted(first: StoredEvent | None, last: Mapping[str, Any]) -> float | None:
    if first is None or first.start_t_s == last["start_t_s"]:
        return round(float(last["t_s"] - last["start_t_s"]), 3)
    lasted_s = _seconds(last["time"]) - _seconds(first.start_time)
    return lasted_s if lasted_s >= 0 else None


def read_events(path: Path) -> list[StoredEvent]:
    """Return the events of a log, the oldest first; a daemon may be writing it meanwhile.

    Raises StoreError if it is missing, no log, or unreadable.
    """
    if not path.is_file():
        raise StoreError(f"{path}: no such store")
    if not os.access(path, os.R_OK):
        raise StoreError(f"{path}: only its owner may read it; try sudo -u {path.owner()}")
    try:
        rows = _read_rows(path)
    except sqlite3.Error as err:
        raise StoreError(f"{path}: cannot be read as a store: {err}") from err
    return fold_events(filter(None, (parse_record(text) for (text,) in rows)))


def parse_record(text: str | bytes) -> dict[str, Any] | None:
    """Return a record that a log holds; None for what is none, as after a fault of the disk."""
    try:
        record = json.loads(text)
        is_whole = all(key in record for key in _KEYS.get(record["type"], ()))
    except (ValueError, LookupError, TypeError, RecursionError):
        return None
    return record if is_whole else None


def parse_since(text: str, now_s: float) -> float:
    """Return `text`, 90s to 2w ago or ISO 8601, in seconds since 1970; or UsageError."""
    if match := re.fullmatch(r"(\d+(?:\.\d+)?)\s*(s|min|h|d|w)", text):
        return now_s - float(match[1]) * _UNIT_S[match[2]]
    try:
        return _seconds(text)
    except ValueError as err:
        msg = f"since '{text}': use 30min, 24h, 7d or a date like 2026-11-21T06:00"
        raise UsageError(msg) from err


def _read_rows(path: Path) -> list[tuple[bytes]]:
    # Where nothing can be written beside it, SQLite reads only what it may take for immutable.
    fault = sqlite3.OperationalError()
    for mode in ("mode=ro", "mode=ro&immutable=1"):
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?{mode}", uri=True)) as db:
            try:
                _check_owner(db)
                return db.execute("SELECT CAST(record AS BLOB) FROM log ORDER BY n").fetchall()
            except sqlite3.OperationalError as err:
                fault = err
    raise fault


def _inode_of(path: Path) -> tuple[int, int] | None:
    try:
        about = path.stat()
    except OSError:
        return None
    return about.st_dev, about.st_ino


def _seconds(text: str) -> float:
    at = datetime.fromisoformat(text)
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()
