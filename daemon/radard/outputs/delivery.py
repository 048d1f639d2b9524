"""Delivery: what a cursor of the event log owes is handed on, over any outage, in a thread.

Events go in order. One that the far end refuses again and again is given up; an alarm is put
behind the others, and tried until it is too old. Other records wait in memory, and go last.
"""

import json
import logging
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from radard.config.sink_table import LogSection
from radard.log_cursor import Entry, Wants
from radard.outputs.base import DeliveryError, Record, SinkContext, SinkState, StateKeeper
from radard.outputs.thread_sink import ThreadSink
from x2radar.backoff import Backoff

log = logging.getLogger("radard")
_TRANSIENT = 100  # of states and decisions only the newest matter


class Delivery(ThreadSink):
    """A sink that hands on what its cursor owes; `start` it once it is built.

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
        super().__init__(name)
        self._target = target
        self._options = options
        self._context = context
        self._wants = wants
        self._send = send
        self._keeper = keeper or self._keeper
        self._backoff = Backoff(options.first_retry_s, options.longest_retry_s, name)
        self._transient: deque[Entry] = deque(maxlen=_TRANSIENT)
        self._skips_wait = threading.Event()
        self._n_refused = 0
        self._begun_s: float | None = None

    def _begin(self) -> None:
        self.cursor = cursor = self._context.cursor(self.name, self._target, self._wants)
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
            if self._queue.is_ended:
                self._keeper.dropped(1, "it has ended")
                return
            self._keeper.dropped(len(self._transient) == _TRANSIENT, "too many wait")
            text = json.dumps(dict(record))
            self._transient.append(Entry(0, uuid.uuid4().hex, time.monotonic(), text))
            self._queue.wake()

    def retry_now(self) -> None:
        """Deliver at once: something has changed for the better."""
        self._backoff.reset()
        self._skips_wait.set()

    def finish(self, timeout_s: float | None = None) -> None:
        """Try all that is left once more within `timeout_s`; the rest is for the next run."""
        super().finish(timeout_s)
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
                self._n_refused = 0
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
        if entry.n > 0 and self.cursor is not None:
            self.cursor.done(entry)
        elif self._transient and self._transient[0] is entry:
            self._transient.popleft()

    def _gives_up(self, entry: Entry, err: DeliveryError) -> bool:
        self._n_refused += err.is_refusal
        if time.monotonic() - entry.put_s > self._options.give_up_h * 3600:
            self._give_up(entry, "too old")
            return True
        if self._n_refused < self._options.attempts:
            return False
        if entry.record.get("kind") != "alarm":
            self._give_up(entry, f"refused {self._n_refused} times")
            return True
        log.error("%s: refuses %s %d times", self.name, entry.key, self._n_refused)
        self._n_refused = 0
        if self.cursor is not None:
            self.cursor.defer(entry)
        return False

    def _give_up(self, entry: Entry, why: str) -> None:
        log.error("%s: gives up %s: %s", self.name, entry.key, why)
        self._n_refused = 0
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
