"""WorkerPool: a few threads that share the cores between all radars.

More threads than cores only wait for each other. A radar's items are worked on in order, by
whichever thread is free, one item a turn: no radar keeps the others waiting for longer.
"""

import os
import threading
from collections.abc import Callable
from queue import SimpleQueue

_MIN_THREADS = 2
"""With one core, too: a radar whose work stands still must not stop the others."""


class Turns:
    """The turns of one radar: `step` does a piece of its work and says whether there is more."""

    def __init__(self, step: Callable[[], bool], ready: "SimpleQueue[Turns | None]") -> None:
        self._step = step
        self._ready = ready
        self._lock = threading.Lock()
        self._is_asked = self._is_queued = False

    def ask(self) -> None:
        """Have `step` called soon, once more than before; for any thread."""
        with self._lock:
            self._is_asked = True
            if self._is_queued:
                return
            self._is_queued = True
        self._ready.put(self)

    def take(self) -> None:
        """Do one piece of work; for a thread of the pool."""
        with self._lock:
            self._is_asked = False
        has_more = self._step()
        with self._lock:
            self._is_queued = is_queued = has_more or self._is_asked
        if is_queued:
            self._ready.put(self)


class WorkerPool:
    """Threads that work until `close`."""

    def __init__(self) -> None:
        self._ready: SimpleQueue[Turns | None] = SimpleQueue()
        self._n_threads = 0

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

    def turns(self, step: Callable[[], bool]) -> Turns:
        """Return the turns of another radar."""
        return Turns(step, self._ready)

    def close(self) -> None:
        """Tell every thread to end; returns at once."""
        for _ in range(self._n_threads):
            self._ready.put(None)

    def _work(self) -> None:
        while (turns := self._ready.get()) is not None:
            turns.take()
