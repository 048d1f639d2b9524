"""Cursor: what one output has still to be told of the event log, in order."""

import contextlib
import json
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Record = Mapping[str, Any]
Wants = Callable[[Record], bool]


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
