"""OutboxSink: store and forward. Events go to an `Outbox` first; a second thread delivers them.

The sink's own thread does nothing but local work, so that an event is on disk within
milliseconds whatever the far end does; the delivery thread may wait for the far end as long
as it takes. Events arrive in order: none is tried before the one ahead of it has been
confirmed or given up.
"""

import hashlib
import json
import logging
import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from radard.config.sink_table import OutboxSection
from radard.outputs.base import DeliveryError, Record, SinkContext, SinkState
from radard.outputs.outbox import Item, Outbox
from radard.outputs.thread_sink import ThreadSink
from x2radar.backoff import Backoff

log = logging.getLogger("radard")
_LAST_ROUND_S = 60.0
"""Longest that `close` waits for deliveries; chosen: the run's own limit is far shorter."""


def outbox_path(context: SinkContext, scheme: str, target: str) -> Path | None:
    """Return the outbox of one output; None when the run keeps nothing.

    The file's name holds a digest of the target, so that another target never gets what was
    meant for this one, and no secret is readable in it.
    """
    if context.state_dir is None:
        return None
    digest = hashlib.blake2b(target.encode(), digest_size=4).hexdigest()
    return context.state_dir / "outbox" / f"{context.marked_sensor}-{scheme}-{digest}.db"


def wants_events(
    kinds: Sequence[str], phases: Sequence[str], others: Sequence[str] = ()
) -> Callable[[Record], bool]:
    """Return a filter: events of these kinds and phases, and records of these other types."""

    def wants(record: Record) -> bool:
        if record["type"] == "event":
            return record["kind"] in kinds and record["phase"] in phases
        return record["type"] in others

    return wants


def body_of(sensor: str, record: Record) -> bytes:
    """Return the JSON of a record with the key `sensor` in front."""
    return json.dumps({"sensor": sensor, **record}, separators=(",", ":")).encode("ascii")


class OutboxSink(ThreadSink):
    """Deliver wanted records, events after any outage.

    Parameters
    ----------
    name : str
        For people; without secrets.
    path : Path or None
        Of the outbox, see `outbox_path`.
    options : OutboxSection
        Bounds and waits.
    wants : callable
        Whether a record is for this sink.
    """

    tick_s = 5.0
    is_durable = True

    def __init__(
        self,
        name: str,
        path: Path | None,
        options: OutboxSection,
        wants: Callable[[Record], bool],
    ) -> None:
        super().__init__(name)
        self._outbox = Outbox(path, options.max_events)
        self._options = options
        self._wants = wants
        self._backoff = Backoff(options.first_retry_s, options.longest_retry_s, name)
        self._has_work = threading.Event()
        self._skips_wait = threading.Event()
        self._is_last_round = self._is_over = False
        self._n_refused = 0
        self._begun_s: float | None = None
        self._deliverer = threading.Thread(
            target=self._run_delivery, name=f"delivery {name}", daemon=True
        )

    def _begin(self) -> None:
        """Begin with what an earlier run has left."""
        self._outbox.open()
        if n := len(self._outbox):
            log.info("%s: %d events of an earlier run wait", self.name, n)
        self._deliverer.start()

    @property
    def state(self) -> SinkState:
        """As in `Sink`."""
        state = self._keeper.state(len(self._queue) + len(self._outbox))
        if state.is_ok and (fault := self._outbox.fault):
            state = replace(state, status="retrying", reason=fault)
        begun_s = self._begun_s
        return state if begun_s is None else replace(state, busy_s=time.monotonic() - begun_s)

    def left(self) -> list[Record]:
        """Return the events that only memory holds, once it is closed."""
        return self._outbox.unsaved()

    @abstractmethod
    def _send(self, item: Item) -> None:
        """Hand on one item, in the delivery thread; raises DeliveryError unless confirmed."""

    def _take(self, record: Record) -> None:
        if self._wants(record):
            is_event = record["type"] == "event"
            put = self._outbox.put if is_event else self._outbox.put_transient
            self._drop(put(record), "the outbox is full")
            self._has_work.set()
        if not self._outbox.fault:
            self._has_taken(record)

    def _tick(self) -> None:
        self._drop(self._outbox.tend(), "the outbox is full")

    def _retry_now(self) -> None:
        """Deliver at once: something has changed for the better."""
        self._backoff.reset()
        self._skips_wait.set()

    def _shut(self) -> None:
        self._is_last_round = True
        self._has_work.set()
        self._skips_wait.set()
        if self._deliverer.ident is not None:
            self._deliverer.join(min(self._left_s(), _LAST_ROUND_S))
        self._is_over = True
        if not self._deliverer.is_alive():
            self._outbox.close()

    def _run_delivery(self) -> None:
        while not self._is_over:
            is_last_round = self._is_last_round
            self._has_work.clear()
            wait_s = self._deliver_all()
            if is_last_round:
                return
            if wait_s is None:
                self._has_work.wait()
            else:
                # New events do not shorten the wait, and a last round needs none.
                self._skips_wait.clear()
                if not self._is_last_round:
                    self._skips_wait.wait(wait_s)

    def _deliver_all(self) -> float | None:
        """Deliver until nothing is left; return how long to wait after a failure."""
        while not self._is_over and (item := self._next()) is not None:
            self._begun_s = time.monotonic()
            try:
                self._send(item)
            except DeliveryError as err:
                self._failed(str(err))
                if not self._gives_up(item, err):
                    return self._backoff.next_s()
            except Exception as err:
                log.exception("%s: an event could not be sent", self.name)
                self._failed(f"internal error: {err!r}")
                self._give_up(item, "cannot be sent")
            else:
                self._n_refused = 0
                self._backoff.reset()
                self._sent()
                self._outbox.remove(item)
            finally:
                self._begun_s = None
        return None

    def _next(self) -> Item | None:
        item = self._outbox.first()
        self._drop(self._outbox.take_unreadable(), "unreadable in the outbox")
        return item

    def _gives_up(self, item: Item, err: DeliveryError) -> bool:
        self._n_refused += err.is_refusal
        age_s = time.monotonic() - item.put_s
        is_refused = self._n_refused >= self._options.attempts
        if age_s > self._options.give_up_h * 3600:
            self._give_up(item, "too old")
        elif is_refused and item.record.get("kind") == "alarm":
            # An alarm is tried as long as it is not too old; what is behind it comes first now.
            log.error("%s: refuses %s %d times", self.name, item.key, self._n_refused)
            self._n_refused = 0
            self._outbox.defer(item)
            return False
        elif is_refused:
            self._give_up(item, f"refused {self._n_refused} times")
        else:
            return False
        return True

    def _give_up(self, item: Item, why: str) -> None:
        log.error("%s: gives up %s: %s", self.name, item.key, why)
        self._n_refused = 0
        self._outbox.remove(item)
        self._drop(1, why)
