"""Sinks with a thread: a `DirectSink` empties a queue, a `Delivery` what its cursor owes."""

import json
import logging
import threading
import time
import uuid
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Self

from radard.config.sink_table import LogSection
from radard.errors import OutputError
from radard.log import Cursor, Entry, Wants
from radard.outputs.base import DeliveryError, Record, SinkContext, SinkState, StateKeeper
from x2radar.backoff import Backoff

log = logging.getLogger("radard")
CLOSE_S = 2.0  # with the stream's own end it stays within the 6 s of TimeoutStopSec in the unit
_TRANSIENT = 100  # of states and decisions only the newest matter
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

    def end(self) -> None:
        """Refuse further records; what waits can still be taken."""
        with self._changed:
            self.is_ended = True
            self._changed.notify_all()


class ThreadSink:
    """A queue and a thread; `start` it once it is built."""

    cursor: Cursor | None = None  # what the log knows of what was handed on, once at work
    tick_s: float | None = None  # how often `_tick` is called when nothing comes; None is never

    def __init__(
        self,
        name: str,
        context: SinkContext | None = None,
        target: str = "",
        wants: Wants = lambda _record: True,
        *,
        waits: bool = False,
    ) -> None:
        self.name, self.waits = name, waits
        self._context, self._target, self._wants = context, target, wants
        self._keeper = StateKeeper(name)
        self._queue = RecordQueue(waits=waits)
        self._skips_wait = threading.Event()  # that after a failure, as the end is near
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
        self._skips_wait.set()

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
        """Begin what works beside the sink's own thread, with the cursor of a `target`."""
        if self._context is not None and self._target:
            self.cursor = self._context.cursor(self.name, self._target, self._wants)

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
        def wants(record: Record) -> bool:
            return kinds is None or record["type"] in kinds

        waits = context is not None and context.can_wait
        super().__init__(name, context, target, wants, waits=waits)
        self._backoff = backoff
        self._left: list[Entry] = []

    def _begin(self) -> None:
        super()._begin()
        if self.cursor is not None:
            self._left = self.cursor.waiting()

    @abstractmethod
    def _deliver(self, record: Record) -> None:
        """Hand on one record; raises DeliveryError to be called again with the same."""

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
            if self._skips_wait.wait(self._backoff.next_s()):
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


class Delivery(ThreadSink):
    """A sink that hands on what its cursor owes, over any outage; `start` it once it is built.

    Events go in order. One that the far end refuses again and again is given up; an alarm is put
    behind the others, and tried until it is too old. Other records wait in memory, and go last.
    `target` tells this far end from others, and may be secret; `wants` says whether a record is
    for this sink. `send` hands on one entry, of number 0 for what is no event; it raises
    DeliveryError unless the far end has confirmed it.
    """

    def __init__(  # noqa: PLR0917 - all are what it is made of
        self,
        name: str,
        target: str,
        options: LogSection,
        context: SinkContext,
        wants: Wants,
        send: Callable[[Entry], None],
        keeper: StateKeeper | None = None,
    ) -> None:
        super().__init__(name, context, target, wants)
        self._options = options
        self._send = send
        self._keeper = keeper or self._keeper
        self._backoff = Backoff(options.first_retry_s, options.longest_retry_s, name)
        self._transient: deque[Entry] = deque(maxlen=_TRANSIENT)
        self._n_refused = 0
        self._begun_s: float | None = None

    def _begin(self) -> None:
        super()._begin()
        if (cursor := self.cursor) is not None:
            cursor.on_put = self._queue.wake
            if len(cursor):
                log.info("%s: %d events of an earlier run wait", self.name, len(cursor))
                self._queue.wake()

    @property
    def state(self) -> SinkState:
        """How the delivery is doing; for any thread."""
        cursor, begun_s = self.cursor, self._begun_s
        n_owed, n_lost = (len(cursor), cursor.n_lost) if cursor is not None else (0, 0)
        state = self._keeper.state(n_owed + len(self._transient))
        busy_s = 0.0 if begun_s is None else time.monotonic() - begun_s
        return replace(state, n_dropped=state.n_dropped + n_lost, busy_s=busy_s)

    def write(self, record: Record) -> None:
        """Put a state or decision into the queue; events come by the log."""
        if record["type"] != "event" and self._wants(record):
            self._keeper.dropped(len(self._transient) == _TRANSIENT, "too many wait")
            text = json.dumps(dict(record))
            self._transient.append(Entry(0, uuid.uuid4().hex, time.monotonic(), text))
            self._queue.wake()

    def retry_now(self) -> None:
        """Deliver at once: something has changed for the better."""
        self._backoff.reset()
        self._skips_wait.set()

    def _tick(self) -> None:
        if (wait_s := self._deliver_all()) is not None:
            self._queue.wake()
            # New events do not shorten the wait, and a last round needs none.
            self._skips_wait.clear()
            if not self._queue.is_ended:
                self._skips_wait.wait(wait_s)

    def _shut(self) -> None:
        if self.cursor is not None:
            self._deliver_all()

    def _deliver_all(self) -> float | None:
        """Deliver until nothing is left; return how long to wait after a failure."""
        while self._left_s() > 0 and (entry := self._next()) is not None:
            self._begun_s = time.monotonic()
            try:
                self._send(entry)
            except DeliveryError as err:
                self._keeper.failed(str(err))
                if not self._gives_up(entry, err):
                    return self._backoff.next_s()
            except Exception as err:  # noqa: BLE001 - logged there
                self._cannot(err, 0)
                self._give_up(entry, "cannot be sent")
            else:
                self._backoff.reset()
                self._keeper.sent(is_event=entry.n > 0)
                self._settle(entry)
            finally:
                self._begun_s = None
        return None

    def _next(self) -> Entry | None:
        entry = self.cursor.first() if self.cursor is not None else None
        return entry or (self._transient[0] if self._transient else None)

    def _settle(self, entry: Entry) -> None:
        self._n_refused = 0
        if entry.n > 0 and self.cursor is not None:
            self.cursor.done(entry)
        elif self._transient and self._transient[0] is entry:
            self._transient.popleft()

    def _gives_up(self, entry: Entry, err: DeliveryError) -> bool:
        self._n_refused += err.is_refusal
        is_refused = self._n_refused >= self._options.attempts
        if time.monotonic() - entry.put_s > self._options.give_up_h * 3600:
            self._give_up(entry, "too old")
        elif is_refused and entry.record.get("kind") != "alarm":
            self._give_up(entry, f"refused {self._n_refused} times")
        else:
            if is_refused and self.cursor is not None:
                log.error("%s: refuses %s %d times", self.name, entry.key, self._n_refused)
                self._n_refused = 0
                self.cursor.defer(entry)
            return False
        return True

    def _give_up(self, entry: Entry, why: str) -> None:
        log.error("%s: gives up %s: %s", self.name, entry.key, why)
        self._settle(entry)
        self._keeper.dropped(1, why)


def picture_path(record: Record) -> Path | None:
    """Return where an alarm's picture is, or will be; None for a record without a clip."""
    clip = record.get("clip") if record.get("kind") == "alarm" else None
    return Path(clip).with_suffix(".png") if clip else None


def wants_events(kinds: Sequence[str], phases: Sequence[str], others: Sequence[str] = ()) -> Wants:
    """Return a filter: events of these kinds and phases, and records of these other types."""

    def wants(record: Record) -> bool:
        if record["type"] == "event":
            return record["kind"] in kinds and record["phase"] in phases
        return record["type"] in others

    return wants
