"""What all sinks share: a bounded queue and a thread that empties it.

A sink that hands every record on by itself is a `DirectSink`; one whose events must outlive
a dead far end is an `OutboxSink` (`radard.sinks.outbox_sink`).
"""

import logging
import threading
import time
from abc import ABC, abstractmethod

from radard.errors import OutputError
from radard.sinks.backoff import Backoff
from radard.sinks.base import DeliveryError, Record, SinkState, StateKeeper
from radard.sinks.record_queue import ROOM, RecordQueue

log = logging.getLogger("radard")
CLOSE_S = 2.0


class ThreadSink(ABC):
    """A queue and a thread; `start` it once it is built.

    Parameters
    ----------
    name : str
        For people; without secrets.
    room : int
        Decisions that may wait.
    waits : bool
        The stream waits for this sink, see `SinkContext.can_wait`.

    Attributes
    ----------
    waits : bool
        The stream waits for this sink.
    tick_s : float or None
        How often `_look_around` is called when nothing comes; None is never.
    """

    tick_s: float | None = None

    def __init__(self, name: str, *, room: int = ROOM, waits: bool = False) -> None:
        self.name = name
        self.waits = waits
        self._keeper = StateKeeper()
        self._queue = RecordQueue(room, waits=waits)
        self._fatal: Exception | None = None
        self._deadline_s = float("inf")
        self._thread = threading.Thread(target=self._run, name=f"sink {name}", daemon=True)

    def start(self) -> None:
        """Begin to work."""
        self._thread.start()

    @property
    def state(self) -> SinkState:
        """As in `Sink`."""
        return self._keeper.state(len(self._queue))

    def write(self, record: Record) -> None:
        """As in `Sink`."""
        self._raise()
        self._drop(self._queue.put(record), "no room")

    def finish(self, timeout_s: float | None = None) -> None:
        """As in `Sink`."""
        if timeout_s is not None:
            self._deadline_s = min(self._deadline_s, time.monotonic() + timeout_s)
        self._queue.end()

    def close(self, timeout_s: float | None = None) -> None:
        """As in `Sink`."""
        if timeout_s is None and not self.waits:
            timeout_s = CLOSE_S
        self.finish(timeout_s)
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        if self._thread.is_alive():
            # A thread that waits for its far end cannot be ended, only left behind.
            log.warning("%s: did not end in time, %d records left", self.name, len(self._queue))
        self._raise()

    def _raise(self) -> None:
        error, self._fatal = self._fatal, None
        if error is not None:
            raise error

    def _fail_for_good(self, error: Exception) -> None:
        """Refuse everything from here on; the next call of `write` or `close` raises."""
        self._fatal = error
        self._queue.end()

    def _left_s(self) -> float:
        """Return the time that `close` still gives, in seconds."""
        return max(0.0, self._deadline_s - time.monotonic())

    def _drop(self, n: int, why: str) -> None:
        if self._keeper.dropped(n):
            log.warning("%s: drops records (%s); `state` counts them", self.name, why)

    def _failed(self, reason: str) -> None:
        if self._keeper.failed(reason):
            log.warning("%s: %s", self.name, reason)

    def _sent(self, n: int = 1) -> None:
        if self._keeper.sent(n):
            log.info("%s: works again", self.name)

    def _run(self) -> None:
        try:
            while True:
                record = self._queue.take(self.tick_s)
                if record is None and self._queue.is_ended and not len(self._queue):
                    break
                try:
                    if record is not None:
                        self._take(record)
                    self._look_around()
                except Exception as err:
                    # One record that cannot be made into output must not cost all others.
                    log.exception("%s: a record could not be handled", self.name)
                    self._keeper.failed(f"internal error: {err!r}")
                    self._drop(record is not None, "cannot be handled")
        finally:
            self._shut()

    @abstractmethod
    def _take(self, record: Record) -> None:
        """Handle one record; in the sink's thread."""

    def _look_around(self) -> None:  # noqa: B027 - a hook that few need
        """See to what is not a record; in the sink's thread."""

    def _shut(self) -> None:  # noqa: B027 - likewise
        """Let go, within `_left_s()`; in the sink's thread."""


class DirectSink(ThreadSink):
    """A sink whose thread hands on every record itself, and repeats it until that works.

    Parameters
    ----------
    name, room, waits
        As in `ThreadSink`.
    backoff : Backoff
        Waits between attempts.
    """

    def __init__(
        self, name: str, backoff: Backoff, *, room: int = ROOM, waits: bool = False
    ) -> None:
        super().__init__(name, room=room, waits=waits)
        self._backoff = backoff

    @abstractmethod
    def _deliver(self, record: Record) -> None:
        """Hand on one record; raises DeliveryError to be called again with the same."""

    def _take(self, record: Record) -> None:
        while not self._try(record):
            if self.waits:
                self._fail_for_good(OutputError(f"--output {self.name}: {self.state.reason}"))
                return
            if self._queue.wait_for_end(self._backoff.next_s()) and not self._try(record):
                self._drop(1 + self._drain(), "left at the end")
                return

    def _try(self, record: Record) -> bool:
        try:
            self._deliver(record)
        except DeliveryError as err:
            self._failed(str(err))
            return False
        self._backoff.reset()
        self._sent()
        return True

    def _drain(self) -> int:
        n = 0
        while self._queue.take(0) is not None:
            n += 1
        return n
