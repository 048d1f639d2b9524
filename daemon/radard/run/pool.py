"""WorkerPool: a few threads that share the cores between all radars.

More threads than cores only wait for each other. A radar's items are worked on in order, by
whichever thread is free, one item a turn: no radar keeps the others waiting for longer.
"""

import os
import threading
import time
from collections import deque
from collections.abc import Callable

_MIN_THREADS = 2  # with one core, too: a radar whose work stands still must not stop the others
_HELP_S = 0.05  # so late a second thread helps: two at once wait for the interpreter's lock
_SPREAD = (5**0.5 - 1) / 2  # of a second, between streams' beginnings: no two in phase


class Turns:
    """The turns of one radar: `step` does a piece of its work and says whether there is more."""

    def __init__(self, step: Callable[[], bool], pool: "WorkerPool") -> None:
        self._step = step
        self._pool = pool
        self._lock = threading.Lock()
        self._is_asked = self._is_queued = False

    def ask(self) -> None:
        """Have `step` called soon, once more than before; for any thread."""
        if self.note():
            self._pool.queue(self)

    def ask_in(self, seconds: float) -> None:
        """Have `step` called in so many seconds, or before; for any thread."""
        self._pool.queue_at(time.monotonic() + seconds, self)

    def take(self) -> bool:
        """Do one piece of work; return whether another is to be queued; for the pool."""
        with self._lock:
            self._is_asked = False
        has_more = self._step()
        with self._lock:
            self._is_queued = has_more or self._is_asked
            return self._is_queued

    def note(self) -> bool:
        """Note that it was asked for; return whether it is yet to be queued; for the pool."""
        with self._lock:
            self._is_asked = True
            was_queued, self._is_queued = self._is_queued, True
            return not was_queued


class WorkerPool:
    """Threads that work until `close`."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._ready: deque[Turns] = deque()
        self._later: dict[Turns, float] = {}  # when each is to be queued, monotonic
        self._is_watched = self._is_closed = False
        self._n_threads = 0
        self._n_begun, self._first_s = 0, 0.0

    def fit(self, n_radars: int) -> None:
        """Have as many threads as so many radars can use."""
        n_cores = len(os.sched_getaffinity(0))
        for _ in range(self._n_threads, min(n_radars, max(_MIN_THREADS, n_cores))):
            self.grow()

    def grow(self) -> None:
        """Have one thread more, in place of one that never comes back."""
        self._n_threads += 1
        name = f"worker {self._n_threads}"
        threading.Thread(target=self._work, name=name, daemon=True).start()

    def begin_s(self) -> float:
        """Return when another stream should begin, monotonic, so that dwells alternate."""
        now_s = time.monotonic()
        with self._changed:
            if not self._n_begun:
                self._first_s = now_s
            begin_s = self._first_s + self._n_begun * _SPREAD
            self._n_begun += 1
        return now_s + (begin_s - now_s) % 1.0

    def queue(self, turns: Turns) -> None:
        """Let a turn be taken by the next thread that is free; for `Turns`."""
        with self._changed:
            self._ready.append(turns)
            self._changed.notify()

    def queue_at(self, due_s: float, turns: Turns) -> None:
        """Let a turn be taken at a time of the host's monotonic clock; for `Turns`."""
        with self._changed:
            due_s = self._later[turns] = min(due_s, self._later.get(turns, due_s))
            if due_s == min(self._later.values()):
                self._changed.notify()

    def close(self) -> None:
        """Tell every thread to end; returns at once."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def _work(self) -> None:
        with self._changed:
            while (turns := self._next()) is not None:
                self._changed.release()
                try:
                    has_more = turns.take()
                finally:
                    self._changed.acquire()
                if has_more:
                    # Nobody is woken: this thread is free.
                    self._ready.append(turns)

    def _next(self) -> Turns | None:
        """Wait for the next turn to be taken; None at the end."""
        while not self._is_closed:
            now_s = time.monotonic()
            for turns in [each for each, due_s in self._later.items() if due_s <= now_s]:
                del self._later[turns]
                if turns.note():
                    self._ready.append(turns)
            if self._ready:
                return self._ready.popleft()
            self._wait(min(self._later.values()) - now_s if self._later else None)
        return None

    def _wait(self, seconds: float | None) -> None:
        """Wait until something is ready, or for so long; one thread in time, the others later."""
        if self._is_watched:
            self._changed.wait(None if seconds is None else seconds + _HELP_S)
            return
        self._is_watched = True
        self._changed.wait(seconds)
        self._is_watched = False
