"""EventLog: what happened, once and in order, until every output has it.

Memory is the log, and a SQLite file (`radard.log_file`) its copy, which a thread of its own
writes: no disk holds up an alarm for longer than half a second. Every record has a number and a
key that no other ever has. An output is a `Cursor`; after a kill it is told again what the file
does not yet say it has. Nothing goes by the clock on the wall.
"""

import contextlib
import json
import logging
import sqlite3
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from radard.log_file import (
    LogFile,
    StoredEvent,
    damage,
    fault_text,
    fold_events,
    is_damage,
    parse_record,
)

log = logging.getLogger("radard")
Record = Mapping[str, Any]
Wants = Callable[[Record], bool]
_Rows = list[tuple[int, str, float, bytes]]  # of the table `log`
_WAIT_S = 0.5  # a person does not notice it; disks take a tenth of it
_OPEN_S = 5.0  # a disk that spins up takes as long; beyond it the run begins without its past
_CLOSE_S = 1.0  # of the 6 s that systemd gives, the rest is for outputs
_TEND_S = 10.0  # how soon a disk is tried again, and what a kill takes off an event's age
_ATTEMPTS = 3  # a file that is taken away while it is made again looks damaged, too
_CHECK_S = 3600.0  # reading all pages takes a tenth of a second
_SAID_S = 3600.0  # so long the state says that a file was put aside, or events were dropped


@dataclass(slots=True, eq=False)
class Entry:
    """A record in the log, as JSON; it has waited since `put_s` of the monotonic clock.

    Its number `n` is the order of the log; it changes only for those that were appended before a
    file could be read, which then come behind what that holds. Its `key` is the same in every
    attempt to deliver it and in no other entry, ever.
    """

    n: int
    key: str
    put_s: float
    text: str

    @property
    def record(self) -> Record:
        """The record; a new mapping each time."""
        return dict(json.loads(self.text))


@dataclass(frozen=True, slots=True)
class Place:
    """Where a cursor stands in the file: `done` but for `deferred`; `seen` is the last offered."""

    done: int
    seen: int
    deferred: tuple[int, ...] = ()

    @property
    def owes(self) -> bool:
        """Whether there was something left to deliver."""
        return self.done < self.seen or bool(self.deferred)


class Cursor:
    """What one output has still to be told, in order, under the log's `lock`; for any thread."""

    def __init__(
        self, name: str, wants: Wants, lock: threading.Condition, on_move: Callable[[], object]
    ) -> None:
        self.name = name
        self._wants = wants
        self._lock = lock
        self._on_move = on_move
        self._waiting: deque[Entry] = deque()
        self._deferred: deque[Entry] = deque()
        self.n_lost = 0  # entries that went before they were delivered, since there were too many
        self.on_put: Callable[[], None] = lambda: None
        """Called when there is more to deliver; must not wait."""

    def __len__(self) -> int:
        return len(self._waiting) + len(self._deferred)

    def first(self) -> Entry | None:
        """Return what is to be delivered next; those that were deferred come last."""
        with self._lock:
            waiting = self._waiting or self._deferred
            return waiting[0] if waiting else None

    def waiting(self, record: Record | None = None) -> list[Entry]:
        """Return what is to be delivered, up to a record: nothing once that is delivered."""
        with self._lock:
            waiting, deferred = list(self._waiting), list(self._deferred)
        if record is None:
            return waiting + deferred
        texts = [entry.text for entry in waiting]
        text = json.dumps(dict(record))
        return waiting[: texts.index(text) + 1] if text in texts else []

    def done(self, entry: Entry) -> None:
        """Note that an entry was delivered, or given up."""
        with self._lock:
            self._drop(entry)
            self._on_move()

    def defer(self, entry: Entry) -> None:
        """Put an entry behind all others."""
        with self._lock:
            if self._drop(entry):
                self._deferred.append(entry)
                self._on_move()

    def offer(self, entries: Sequence[Entry]) -> bool:
        """Take those that are wanted; return whether there are any; under the log's lock."""
        wanted = [entry for entry in entries if self._wants(entry.record)]
        self._waiting.extend(wanted)
        return bool(wanted)

    def lose(self, entry: Entry) -> bool:
        """Let go of an entry for which there is no room; under the log's lock."""
        is_lost = self._drop(entry)
        self.n_lost += is_lost
        return is_lost

    def take_over(self, before: "Cursor") -> None:
        """Take what another one had still to deliver; under the log's lock."""
        self._waiting.extend(e for e in before._waiting if self._wants(e.record))
        self._deferred.extend(e for e in before._deferred if self._wants(e.record))
        self.n_lost = before.n_lost

    def resume(self, place: Place, entries: Sequence[Entry]) -> None:
        """Go on where an earlier run ended, before what has come since; under the log's lock."""
        by_n = {entry.n: entry for entry in entries}
        last = [by_n[n] for n in place.deferred if n in by_n]
        left = [e for e in entries if e.n > place.done and e not in last and self._wants(e.record)]
        self._waiting.extendleft(reversed(left))
        self._deferred.extendleft(reversed(last))

    def place(self, told: int, last: int) -> Place:
        """Return where it stands, by the last number offered and appended; under the lock."""
        done = self._waiting[0].n - 1 if self._waiting else told
        return Place(done, last, tuple(entry.n for entry in self._deferred))

    def _drop(self, entry: Entry) -> bool:
        for row in (self._waiting, self._deferred):
            with contextlib.suppress(ValueError):
                row.remove(entry)
                return True
        return False


class EventLog:
    """Keep the last `max_events` records in order, in memory and in a file; for any thread."""

    def __init__(
        self,
        path: Path | None,
        *,
        max_events: int = 10_000,
        keeps_events: bool = True,
        lock: Callable[[Path], None] = lambda _folder: None,
    ) -> None:
        self._file = LogFile(path, self._say) if path is not None else None
        self._lock = lock  # the folder against a second daemon; raises OSError if there is one
        self.max_events = max_events
        self._keeps_events = keeps_events
        self._id = uuid.uuid4().hex[:12]
        # The lock of the log and of its cursors.
        self._changed = threading.Condition(threading.RLock())
        self._entries: deque[Entry] = deque()
        self._last = self._written = 0
        self.told = 0  # number of the last entry that outputs heard of
        self._cursors: dict[str, Cursor] = {}
        self._places: dict[str, Place] = {}
        self._kept: dict[str, str] = {}
        self._held: dict[str, str] = {}
        self._on: dict[str, Record] = {}  # the last phase of events that have not ended
        self._is_loaded = path is None
        self._offset_s = 0.0  # from this process's monotonic clock to the file's count of seconds
        self._n_asked = self._n_done = 0
        self._is_ended = False
        self._trouble = ""
        self._said, self._said_s = "", float("-inf")
        self._writer: threading.Thread | None = None
        if (file := self._file) is not None:
            self._n_asked = 1
            self._writer = threading.Thread(
                target=self._run, args=(file,), name="event log", daemon=True
            )
            self._writer.start()
            self._wait(1, _OPEN_S)

    @property
    def fault(self) -> str:
        """Why the state is degraded: the file takes nothing, or something was lost; else empty."""
        if self._trouble:
            return f"events are kept in memory only: {self._trouble}"
        return self._said if time.monotonic() - self._said_s < _SAID_S else ""

    def append(self, record: Record) -> Entry:
        """Add a record; return once it is on disk, or after half a second; then tell outputs."""
        with self._changed:
            self._last += 1
            key = f"{self._id}-{self._last}"
            entry = Entry(self._last, key, time.monotonic(), json.dumps(dict(record)))
            self._entries.append(entry)
            self._note(record)
            if self._keeps_events:
                self._wait(self._ask(), _WAIT_S)
            fresh = [each for each in self._entries if self.told < each.n <= entry.n]
            self.told = max(self.told, entry.n)
            wanting = [cursor for cursor in self._cursors.values() if cursor.offer(fresh)]
            self._bound()
        for cursor in wanting:
            cursor.on_put()
        return entry

    def cursor(self, name: str, wants: Wants, after: int | None = None) -> Cursor:
        """Return an output's cursor over what it `wants`, from where it was, or behind `after`."""
        with self._changed:
            before = self._cursors.get(name)
            cursor = self._cursors[name] = Cursor(name, wants, self._changed, self._ask)
            if before is not None:
                cursor.take_over(before)
            else:
                place = self._places.get(name)
                if place is None or not place.owes:
                    begin = self.told if after is None else after
                    place = Place(begin, begin)
                cursor.resume(place, [each for each in self._entries if each.n <= self.told])
            self._ask()
            return cursor

    def forget(self, name: str) -> None:
        """Take away a cursor whose output there is no more."""
        with self._changed:
            self._cursors.pop(name, None)
            self._places.pop(name, None)
            self._ask()

    def events(self) -> list[StoredEvent]:
        """Return the events that the log holds, the oldest first."""
        with self._changed:
            entries = list(self._entries)
        return fold_events(entry.record for entry in entries)

    def open_events(self) -> list[Record]:
        """Return the last phase of every event that has not ended, also in an earlier run."""
        with self._changed:
            return list(self._on.values())

    def keep(self, name: str, text: str) -> None:
        """Keep a text over restarts in place of an earlier one; returns as `append` does."""
        with self._changed:
            if self._kept.get(name) == text:
                return
            self._kept[name] = text
            self._wait(self._ask(), _WAIT_S)

    def kept(self, name: str) -> str | None:
        """Return what is kept under a name."""
        with self._changed:
            return self._kept.get(name)

    def why_lost(self, name: str, text: str) -> str | None:
        """Return why a text would not outlive a kill: empty if it would, None if not yet."""
        with self._changed:
            if self._file is None or self._held.get(name) == text:
                return ""
            return self._trouble or None

    def close(self) -> None:
        """Write what waits, and close the file; what comes later is in memory only."""
        with self._changed:
            self._is_ended = True
            self._changed.notify_all()
        if self._writer is not None:
            self._writer.join(_CLOSE_S)

    def _note(self, record: Record) -> None:
        """Note which events are on; under the lock."""
        if record["type"] == "event":
            self._on.pop(record["id"], None)
            if record["phase"] != "end":
                self._on[record["id"]] = record

    def _ask(self) -> int:
        """Let what there is be written soon; under the lock."""
        self._n_asked += 1
        self._changed.notify_all()
        return self._n_asked

    def _wait(self, n: int, timeout_s: float) -> None:
        if self._file is not None:
            with self._changed:
                self._changed.wait_for(lambda: self._n_done >= n or self._is_ended, timeout_s)

    def _bound(self) -> None:
        n_lost = 0
        while len(self._entries) > self.max_events:
            entry = self._entries.popleft()
            n_lost += sum([cursor.lose(entry) for cursor in self._cursors.values()])
        if n_lost:
            self._say(f"too many events wait: the oldest were dropped ({n_lost})")

    def _say(self, text: str) -> None:
        if text != self._said or time.monotonic() - self._said_s >= _SAID_S:
            log.warning("%s: %s", self._file.path if self._file else "events", text)
        self._said, self._said_s = text, time.monotonic()

    def _run(self, file: LogFile) -> None:
        is_over = False
        while not is_over:
            with self._changed:
                self._changed.wait_for(
                    lambda: self._n_asked > self._n_done or self._is_ended, _TEND_S
                )
                n, is_over = self._n_asked, self._is_ended
                is_late = time.monotonic() - file.checked_s >= _CHECK_S
                is_due = is_late or self._trouble or any(map(len, self._cursors.values()))
            if n > self._n_done or is_over or is_due:
                for _ in range(_ATTEMPTS):
                    if not self._begins_anew(file):
                        break
            with self._changed:
                self._n_done = n
                self._changed.notify_all()
        file.close()

    def _begins_anew(self, file: LogFile) -> bool:
        """Write; return whether the file is damaged and aside: all goes at once into a new one."""
        trouble = ""
        try:
            try:
                self._write(file)
            except (OSError, sqlite3.Error) as err:
                if not file.put_aside(err):
                    raise
                self._write_all_again()
                return True
        except (OSError, sqlite3.Error) as err:
            trouble = fault_text(err)
            if not self._trouble:
                log.warning("%s: events are kept in memory only: %s", file.path, trouble)
        self._trouble = trouble
        return False

    def _write_all_again(self) -> None:
        with self._changed:
            self._written = 0
            self._held = {}

    def _load(self, file: LogFile, db: sqlite3.Connection) -> None:
        """Take what the file holds, of a damaged one what can be read; newer is put behind it."""
        rows: _Rows = []
        places: dict[str, Place] = {}
        kept: dict[str, str] = {}
        last, run_s, fault = 0, 0.0, None
        try:
            kept.update(db.execute("SELECT name, text FROM kept"))
            for name, done, seen, deferred in db.execute("SELECT * FROM cursors"):
                places[name] = Place(done, seen, tuple(json.loads(deferred)))
            run_s, last = db.execute("SELECT run_s, last FROM stand").fetchone() or (run_s, last)
            if self._keeps_events:
                query = "SELECT n, key, run_s, CAST(record AS BLOB) FROM log ORDER BY n"
                rows.extend(db.execute(query))  # all before a damaged one
            file.check()
        except (sqlite3.Error, ValueError, TypeError) as err:
            if isinstance(err, sqlite3.Error) and not is_damage(err):
                raise
            fault = str(err)
        self._join(rows, places, kept, last, run_s)
        self._is_loaded = True
        if fault is not None:
            raise damage(fault)

    def _join(
        self, rows: _Rows, places: dict[str, Place], kept: dict[str, str], last: int, run_s: float
    ) -> None:
        now_s = time.monotonic()
        entries, known = [], {entry.key for entry in self._entries}
        for n, key, put_s, text in rows:
            if key in known:
                continue
            if parse_record(text) is None:
                self._say(f"entry {n} is unreadable, skipped")
                continue
            # A kill may have come before the count was noted.
            age_s = max(0.0, run_s - put_s)
            entries.append(Entry(n, str(key), now_s - age_s, text.decode()))
        with self._changed:
            self._offset_s = run_s - now_s
            last = max([last, *(row[0] for row in rows)])
            for entry in self._entries:
                entry.n += last
            for name, cursor in self._cursors.items():
                if (place := places.get(name)) is not None and place.owes:
                    cursor.resume(place, entries)
            self._written = last
            self._last += last
            self.told += last
            self._entries.extendleft(reversed(entries))
            self._on.clear()
            for entry in self._entries:
                self._note(entry.record)
            self._places = places
            self._held = dict(kept)
            self._kept = {**kept, **self._kept}
            self._bound()

    def _write(self, file: LogFile) -> None:
        now_s = time.monotonic()
        if file.is_taken_away():
            self._write_all_again()
            # Another one may be there, as of a disk that was mounted late.
            self._is_loaded = False
        if file.db is None:
            self._lock(file.path.parent)
        db = file.open()
        if not self._is_loaded:
            self._load(file, db)
        file.check(_CHECK_S)
        with self._changed:
            held, last = dict(self._kept), self._last
            entries = [e for e in self._entries if e.n > self._written]
            first = self._entries[0].n if self._entries else last + 1
            now = {name: each.place(self.told, last) for name, each in self._cursors.items()}
            places = self._places | now
        db.execute("BEGIN IMMEDIATE")
        if self._keeps_events:
            db.executemany(
                "INSERT OR REPLACE INTO log VALUES (?, ?, ?, ?)",
                [(e.n, e.key, e.put_s + self._offset_s, e.text) for e in entries],
            )
            db.execute("DELETE FROM log WHERE n < ?", (first,))
            db.execute("DELETE FROM cursors")
            rows = [(k, p.done, p.seen, json.dumps(p.deferred)) for k, p in places.items()]
            db.executemany("INSERT INTO cursors VALUES (?, ?, ?, ?)", rows)
        db.executemany("INSERT OR REPLACE INTO kept VALUES (?, ?)", held.items())
        stand = (now_s + self._offset_s, last)
        db.execute("INSERT OR REPLACE INTO stand VALUES (0, ?, ?)", stand)
        db.execute("COMMIT")
        with self._changed:
            self._written, self._held = last, held
