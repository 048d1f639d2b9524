"""Sinks with a bounded queue and a thread that empties it; `Delivery` is one for networks."""

import logging
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Collection
from typing import Self

from radard.errors import OutputError
from radard.log_cursor import Cursor, Entry
from radard.outputs.base import DeliveryError, Record, SinkContext, SinkState, StateKeeper
from x2radar.backoff import Backoff

log = logging.getLogger("radard")
CLOSE_S = 2.0  # with the stream's own end it stays within the 6 s of TimeoutStopSec in the unit
_ROOM = 1000  # records that may wait: a quarter of an hour of decisions; events wait beside them


class RecordQueue:
    """Hand on records in order; what is too much drops oldest decisions, or `waits`."""

    def __init__(self, *, waits: bool = False) -> None:
        self._waits = waits
        self._records: deque[Record] = deque()
        self._n_others = 0
        self.is_ended = self._is_woken = False  # whether `end` was called
        self._changed = threading.Condition()

    def __len__(self) -> int:
        return len(self._records)

    def put(self, record: Record) -> int:
        """Take a record; return how many were dropped for it."""
        with self._changed:
            is_other = record.get("type") != "event"
            while self._waits and is_other and self._n_others >= _ROOM and not self.is_ended:
                self._changed.wait()
            if self.is_ended:
                return 1
            is_full = is_other and self._n_others >= _ROOM
            if is_full:
                oldest = next((r for r in self._records if r.get("type") == "decision"), None)
                self._records.remove(oldest if oldest is not None else self._records[0])
                self._n_others -= 1
            self._records.append(record)
            self._n_others += is_other
            self._changed.notify_all()
            return int(is_full)

    def take(self, timeout_s: float | None = None) -> Record | None:
        """Return the oldest record; None after `timeout_s`, after `wake`, or at the end."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._records or self.is_ended or self._is_woken, timeout_s
            )
            if not self._records:
                self._is_woken = False
                return None
            record = self._records.popleft()
            self._n_others -= record.get("type") != "event"
            self._changed.notify_all()
            return record

    def wake(self) -> None:
        """Let `take` return although there is no record."""
        with self._changed:
            self._is_woken = True
            self._changed.notify_all()

    def wait_for_end(self, timeout_s: float) -> bool:
        """Wait until `end` is called; return whether it was."""
        with self._changed:
            return self._changed.wait_for(lambda: self.is_ended, timeout_s)

    def end(self) -> None:
        """Refuse further records; what waits can still be taken."""
        with self._changed:
            self.is_ended = True
            self._changed.notify_all()


class ThreadSink:
    """A queue and a thread; `start` it once it is built."""

    cursor: Cursor | None = None  # what the log knows of what was handed on, once at work
    tick_s: float | None = None  # how often `_tick` is called when nothing comes; None is never

    def __init__(self, name: str, *, waits: bool = False) -> None:
        self.name = name
        self.waits = waits
        self._keeper = StateKeeper(name)
        self._queue = RecordQueue(waits=waits)
        self._fatal: Exception | None = None
        self._is_broken = False  # it has failed for good, which is said once
        self._deadline_s = float("inf")
        self._thread = threading.Thread(target=self._run, name=f"sink {name}", daemon=True)

    def start(self) -> Self:
        """Begin to work; return the sink. A second call does nothing."""
        if self._thread.ident is None:
            self._begin()
            self._thread.start()
        return self

    @property
    def state(self) -> SinkState:
        """How the sink is doing, and how many records wait; for any thread."""
        return self._keeper.state(len(self._queue))

    def write(self, record: Record) -> None:
        """Put a record into the queue; raises what ended the thread."""
        self._raise()
        n_dropped = self._queue.put(record)
        if not self._is_broken:
            self._keeper.dropped(n_dropped, "no room")

    def finish(self, timeout_s: float | None = None) -> None:
        """Take no more records; begin to hand on the rest within `timeout_s`."""
        if timeout_s is not None:
            self._deadline_s = min(self._deadline_s, time.monotonic() + timeout_s)
        self._queue.end()

    def close(self, timeout_s: float | None = None) -> None:
        """Finish, wait for the thread in time, and release everything."""
        if timeout_s is None and not self.waits:
            timeout_s = CLOSE_S
        self.finish(timeout_s)
        if self._thread.ident is None:
            self._shut()
        else:
            self._thread.join(timeout_s)
        if self._thread.is_alive():
            # A thread that waits for its far end cannot be ended, only left behind.
            n = self.state.n_waiting
            log.warning("%s: did not end in time, %d records left", self.name, n)
        self._raise()

    def _raise(self) -> None:
        error, self._fatal = self._fatal, None
        if error is not None:
            raise error

    def _fail_for_good(self, error: Exception) -> None:
        """Refuse everything from here on; the next call of `write` or `close` raises."""
        self._fatal, self._is_broken = error, True
        self._queue.end()

    def _left_s(self) -> float:
        """Return the time that `close` still gives, in seconds."""
        return max(0.0, self._deadline_s - time.monotonic())

    def _run(self) -> None:
        try:
            while True:
                record = self._queue.take(self.tick_s)
                if record is None and self._queue.is_ended and not len(self._queue):
                    break
                try:
                    if record is not None:
                        self._take(record)
                    self._tick()
                except Exception as err:  # noqa: BLE001 - logged there
                    self._cannot(err, record is not None)
        finally:
            self._shut()

    def _cannot(self, err: Exception, n_records: int) -> None:
        """Log what is wrong with this program: one record must not cost all others."""
        log.error("%s: a record could not be handled", self.name, exc_info=err)
        self._keeper.failed(f"internal error: {err!r}")
        self._keeper.dropped(n_records, "cannot be handled")

    def _begin(self) -> None:
        """Begin what works beside the sink's own thread."""

    def _take(self, record: Record) -> None:
        """Handle one record; in the sink's thread."""

    def _tick(self) -> None:
        """Do what no record asks for; in the sink's thread."""

    def _shut(self) -> None:
        """Release everything, within `_left_s()`; in the sink's thread if it was started."""


class DirectSink(ThreadSink, ABC):
    """A sink whose thread hands on every record itself, and repeats it until that works.

    `context` says whether the stream waits. With `target`, which tells this far end from others,
    its log knows what has been handed on, and an event that a run could not hand on comes in the
    next, behind the first record. Without one, nothing outlives the process. `kinds` are types of
    records that it takes; None is all.
    """

    def __init__(
        self,
        name: str,
        backoff: Backoff,
        context: SinkContext | None = None,
        target: str = "",
        *,
        kinds: Collection[str] | None = None,
    ) -> None:
        super().__init__(name, waits=context is not None and context.can_wait)
        self._backoff = backoff
        self._context = context
        self._target = target
        self._kinds = kinds
        self._left: list[Entry] = []

    def _begin(self) -> None:
        if self._context is not None and self._target:
            self.cursor = self._context.cursor(self.name, self._target, self._wants)
            self._left = self.cursor.waiting()

    @abstractmethod
    def _deliver(self, record: Record) -> None:
        """Hand on one record; raises DeliveryError to be called again with the same."""

    def _wants(self, record: Record) -> bool:
        return self._kinds is None or record["type"] in self._kinds

    def _take(self, record: Record) -> None:
        if record["type"] == "event" and self.cursor is not None:
            self._hand_on(self.cursor.waiting(record))
            return
        if self._wants(record) and not self._try_until_done(record):
            return
        left, self._left = self._left, []
        self._hand_on(left)

    def _hand_on(self, entries: list[Entry]) -> None:
        for entry in entries:
            try:
                if not self._try_until_done(entry.record):
                    return
            except Exception as err:  # noqa: BLE001 - logged there
                self._cannot(err, 1)
            if self.cursor is not None:
                self.cursor.done(entry)

    def _try_until_done(self, record: Record) -> bool:
        """Try until it works, or the end comes; return whether it was handed on."""
        while not self._try(record):
            if self.waits:
                return False
            if self._queue.wait_for_end(self._backoff.next_s()):
                if self._try(record):
                    return True
                n = 1
                while self._queue.take(0) is not None:
                    n += 1
                self._keeper.dropped(n, "left at the end")
                return False
        return True

    def _try(self, record: Record) -> bool:
        try:
            self._deliver(record)
        except DeliveryError as err:
            if self.waits:
                # All who wait are told, and nobody twice.
                self._fail_for_good(OutputError(f"--output {self.name}: {err}"))
            else:
                self._keeper.failed(str(err))
            return False
        self._backoff.reset()
        self._keeper.sent(is_event=record["type"] == "event")
        return True
