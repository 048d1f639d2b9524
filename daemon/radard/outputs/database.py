"""SQLite files that survive a kill: in WAL mode, checked, put aside when damaged."""

import contextlib
import logging
import os
import sqlite3
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from radard.outputs.base import PASSING

log = logging.getLogger("radard")
Newer = Mapping[int, Sequence[str]]
_BUSY_S = 1.0  # chosen: how long to wait for a lock, as of a backup
_PASSING_CODES = frozenset(
    {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_FULL}
)


class ForeignDatabase(Exception):
    """A file of another program, or of a newer version."""


def open_database(
    path: Path | None,
    schema: str,
    *,
    application_id: int,
    version: int,
    newer: Newer = MappingProxyType({}),
) -> sqlite3.Connection:
    """Open or make a database in autocommit mode; every commit reaches the disk.

    Parameters
    ----------
    path : Path or None
        The file; None is memory.
    schema : str
        Statements that make the tables, and do nothing to those that exist.
    application_id, version : int
        Mark the file as ours, and of this schema.
    newer : mapping of int to sequence of str
        Statements that make a file of the version before into one of that version.

    Raises
    ------
    ForeignDatabase
        If it is not ours to change.
    OSError, sqlite3.Error
        If it cannot be made. A damaged one is renamed to *.broken, and a new one made.

    Any thread may use the connection, under a lock of the caller's.
    """
    if path is None:
        return _prepared(":memory:", schema, application_id, version, newer)
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    _make_private(path)
    try:
        return _prepared(str(path), schema, application_id, version, newer)
    except sqlite3.OperationalError:
        raise
    except sqlite3.DatabaseError as err:
        aside = path.with_name(path.name + ".broken")
        log.warning("%s: damaged (%s), put aside as %s", path, err, aside.name)
        path.replace(aside)
        for tail in ("-wal", "-shm"):
            path.with_name(path.name + tail).unlink(missing_ok=True)
        _make_private(path)
        return _prepared(str(path), schema, application_id, version, newer)


def is_passing(err: Exception) -> bool:
    """Return whether a fault of `open_database` may pass by itself, as a full disk does."""
    if isinstance(err, sqlite3.Error):
        return getattr(err, "sqlite_errorcode", 0) & 0xFF in _PASSING_CODES
    return isinstance(err, OSError) and err.errno in PASSING


def _make_private(path: Path) -> None:
    """Make the file for its owner alone, whatever the umask; SQLite's others follow its mode."""
    with contextlib.suppress(FileExistsError):
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        os.close(fd)


def _prepared(
    target: str, schema: str, application_id: int, version: int, newer: Newer
) -> sqlite3.Connection:
    db = sqlite3.connect(target, timeout=_BUSY_S, isolation_level=None, check_same_thread=False)
    try:
        own = _check(db, application_id, version)
        db.execute("PRAGMA auto_vacuum=INCREMENTAL")
        db.execute("PRAGMA journal_mode=WAL")
        db.execute("PRAGMA synchronous=FULL")
        for step in range(own + 1, version + 1):
            statements = (*newer.get(step, ()), f"PRAGMA user_version={step}")
            db.executescript("; ".join(("BEGIN IMMEDIATE", *statements, "COMMIT")))
        db.executescript(schema)
        # Only if it must be: a file that is open elsewhere cannot always be written.
        for name, value in (("application_id", application_id), ("user_version", version)):
            if db.execute(f"PRAGMA {name}").fetchone()[0] != value:
                db.execute(f"PRAGMA {name}={value}")
    except BaseException:
        db.close()
        raise
    return db


def _check(db: sqlite3.Connection, application_id: int, version: int) -> int:
    """Return the version of a file's content; the wanted one when it has none."""
    is_empty = db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] == 0
    if is_empty:
        return version
    if db.execute("PRAGMA application_id").fetchone()[0] != application_id:
        msg = "a database of another program"
        raise ForeignDatabase(msg)
    own = int(db.execute("PRAGMA user_version").fetchone()[0])
    if own > version:
        msg = "made by a newer version"
        raise ForeignDatabase(msg)
    # Without a version it was not finished: the schema adds what is missing.
    return own or version
