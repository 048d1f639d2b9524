"""WorkerPool: a few threads that share the cores between all radars.

More threads than cores only wait for each other. A radar's items are worked on in order, by
whichever thread is free, one item a turn: no radar keeps the others waiting for longer.
"""

import os
import threading
import time
from collections import deque
from collections.abc import Callable

Step = Callable[[], bool]
_MIN_THREADS = 2  # with one core, too: a radar whose work stands still must not stop the others
_HELP_S = 0.05  # so late a second thread helps: two at once wait for the interpreter's lock
_SPREAD = (5**0.5 - 1) / 2  # of a second, between streams' beginnings: no two in phase


class WorkerPool:
    """Threads that call one `step` of every radar, which says whether it has more to do."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._ready: deque[Step] = deque()
        self._queued: set[Step] = set()  # ready, or at work
        self._asked: set[Step] = set()  # since they were called last
        self._later: dict[Step, float] = {}  # when each is to be queued, monotonic
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
        threading.Thread(target=self._work, name=f"worker {self._n_threads}", daemon=True).start()

    def begin_s(self) -> float:
        """Return when another stream should begin, monotonic, so that dwells alternate."""
        now_s = time.monotonic()
        with self._changed:
            if not self._n_begun:
                self._first_s = now_s
            begin_s = self._first_s + self._n_begun * _SPREAD
            self._n_begun += 1
        return now_s + (begin_s - now_s) % 1.0

    def ask(self, step: Step) -> None:
        """Have a step called soon, once more than before; for any thread."""
        with self._changed:
            if self._queue(step):
                self._changed.notify()

    def ask_in(self, step: Step, seconds: float) -> None:
        """Have a step called in so many seconds, or before; for any thread."""
        due_s = time.monotonic() + seconds
        with self._changed:
            due_s = self._later[step] = min(due_s, self._later.get(step, due_s))
            if due_s == min(self._later.values()):
                self._changed.notify()

    def close(self) -> None:
        """Tell every thread to end; returns at once."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def _work(self) -> None:
        with self._changed:
            while (step := self._next()) is not None:
                self._asked.discard(step)
                self._changed.release()
                try:
                    has_more = step()
                finally:
                    self._changed.acquire()
                self._queued.discard(step)
                if has_more or step in self._asked:
                    # Nobody is woken: this thread is free.
                    self._queue(step)

    def _queue(self, step: Step) -> bool:
        """Note that a step was asked for; return whether it was neither ready nor at work."""
        self._asked.add(step)
        if step in self._queued:
            return False
        self._queued.add(step)
        self._ready.append(step)
        return True

    def _next(self) -> Step | None:
        """Wait for the next step to be called; None at the end."""
        while not self._is_closed:
            now_s = time.monotonic()
            for step in [each for each, due_s in self._later.items() if due_s <= now_s]:
                del self._later[step]
                self._queue(step)
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
