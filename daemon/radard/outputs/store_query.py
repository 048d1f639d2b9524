"""The events in a store, as `radard events` and the dashboard list them."""

import os
import re
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from radard.errors import RadardError, UsageError
from radard.outputs.store import APPLICATION_ID, VERSION

_UNIT_S = {"s": 1, "min": 60, "h": 3600, "d": 86_400, "w": 604_800}
_COLUMNS = "id, sensor, kind, phase, start_s, end_s, start_t_s, end_t_s, peak, reason, clip, mark"
_MARKED = 3  # version of the first stores that have marks


class StoreError(RadardError):
    """A store is missing or unreadable."""

    exit_code = 66


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredEvent:
    """One event in its last known phase, by the names of the records of type event.

    `start_time` and `end_time` are the wall clock in UTC, ISO 8601; `end_time` is None if it has
    not ended, or the daemon did not see its end. `*_t_s` are stream time, in seconds. `mark` is
    one of `MARKS`, None of a live event and of those that stores of earlier versions hold.
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


def read_events(
    path: Path,
    *,
    since_s: float | None = None,
    kinds: Sequence[str] = (),
    limit: int | None = None,
) -> list[StoredEvent]:
    """Return events, the oldest first; a daemon may be writing into the store meanwhile.

    Parameters
    ----------
    path : Path
        The store; StoreError if it is missing, no store, or unreadable.
    since_s : float, optional
        Only those that began at this wall-clock time or later, in seconds since 1970.
    kinds : sequence of str
        Only these; none means all.
    limit : int, optional
        Only so many, the newest.
    """
    if not path.is_file():
        msg = f"{path}: no such store"
        raise StoreError(msg)
    if not os.access(path, os.R_OK):
        msg = f"{path}: only its owner may read it; try sudo -u {path.owner()}"
        raise StoreError(msg)
    wanted = ",".join("?" * len(kinds)) if kinds else "SELECT DISTINCT kind FROM events"
    values = (since_s if since_s is not None else -1e18, *kinds, limit or -1)
    try:
        with closing(_open(path)) as db:
            version = db.execute("PRAGMA user_version").fetchone()[0]
            columns = _COLUMNS if version >= _MARKED else _COLUMNS.replace(", mark", ", NULL")
            query = (
                f"SELECT {columns} FROM events WHERE start_s >= ? AND kind IN ({wanted}) "  # noqa: S608
                "ORDER BY start_s DESC, rowid DESC LIMIT ?"
            )
            rows = db.execute(query, values).fetchall()
    except sqlite3.Error as err:
        msg = f"{path}: cannot be read as a store: {err}"
        raise StoreError(msg) from err
    return [_event(row) for row in reversed(rows)]


def parse_since(text: str, now_s: float) -> float:
    """Return a wall-clock time in seconds since 1970; raises UsageError if `text` is none.

    `text` is 90s, 30min, 24h, 7d, 2w before `now_s`, or an ISO 8601 date or time, in UTC unless
    it says otherwise.
    """
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(s|min|h|d|w)", text)
    if match:
        return now_s - float(match[1]) * _UNIT_S[match[2]]
    try:
        at = datetime.fromisoformat(text)
    except ValueError as err:
        msg = f"--since '{text}': use 30min, 24h, 7d or a date like 2026-11-21T06:00"
        raise UsageError(msg) from err
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()


def _open(path: Path) -> sqlite3.Connection:
    """Open read-only; also in a folder that cannot be written."""
    where = path.resolve().as_uri()
    for mode in ("mode=ro", "mode=ro&immutable=1"):
        db = sqlite3.connect(f"{where}?{mode}", uri=True)
        try:
            mark = db.execute("PRAGMA application_id").fetchone()[0]
            version = db.execute("PRAGMA user_version").fetchone()[0]
        except sqlite3.OperationalError:
            db.close()
            continue
        if mark == APPLICATION_ID and version <= VERSION:
            return db
        db.close()
        break
    msg = "not a store of this version"
    raise sqlite3.DatabaseError(msg)


def _event(row: tuple[object, ...]) -> StoredEvent:
    names = [name.strip() for name in _COLUMNS.split(",")]
    fields = dict(zip(names, row, strict=True))
    fields["start_time"] = _iso(fields.pop("start_s"))
    fields["end_time"] = _iso(fields.pop("end_s"))
    return StoredEvent(**fields)  # type: ignore[arg-type]


def _iso(time_s: object) -> str | None:
    if not isinstance(time_s, float):
        return None
    at = datetime.fromtimestamp(time_s, UTC)
    return at.isoformat(timespec="milliseconds").replace("+00:00", "Z")
