"""Signals: the first SIGINT or SIGTERM asks for the end, the second one forces it.

SIGHUP asks for a reload, SIGUSR1 for a dump. Handlers only set flags and wake the main
thread, which acts between two things it does.
"""

import json
import logging
import os
import signal
import sys
import threading
from queue import SimpleQueue
from types import FrameType
from typing import Any

log = logging.getLogger("radard")
_STOP = {signal.SIGINT: "stop", signal.SIGTERM: "stop"}
_ASK = {**_STOP, signal.SIGHUP: "reload", signal.SIGUSR1: "dump"}


class Signals:
    """Install the handlers for a `with` block, in the main thread; each puts into `wake`."""

    def __init__(self) -> None:
        # An Event has a lock, for which a handler would wait for ever.
        self.wake = SimpleQueue[None]()
        self._wishes: set[str] = set()
        self._before: dict[int, Any] = {}

    def __enter__(self) -> "Signals":
        """Install the handlers; outside of the main thread do nothing."""
        if threading.current_thread() is threading.main_thread():
            self._before = {n: signal.signal(n, self._handle) for n in _ASK}
            # Those that have come before.
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _ASK)
        return self

    def __exit__(self, *_error: object) -> None:
        """Put the old ones back."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def ask(self, wish: str) -> None:
        """Ask for 'stop', 'reload' or 'dump', as a signal does; for any thread."""
        self._wishes.add(wish)
        self.wake.put(None)

    def take(self, wish: str) -> bool:
        """Return whether 'stop', 'reload' or 'dump' was asked for since the last call."""
        is_wished = wish in self._wishes
        self._wishes.discard(wish)
        return is_wished

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        if number in _STOP:
            for stop in _STOP:
                signal.signal(stop, signal.SIG_DFL)
        self.ask(_ASK[signal.Signals(number)])


def stacks() -> dict[str, str]:
    """Return the file and line at which every thread is, by the threads' names."""
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    return {
        names.get(ident, str(ident)): f"{frame.f_code.co_filename}:{frame.f_lineno}"
        for ident, frame in sys._current_frames().items()
    }


def force_after(seconds: float) -> threading.Timer:
    """End the process unless the timer that is returned is cancelled before."""

    def force() -> None:
        log.error("not ended in %g s, forced; threads: %s", seconds, json.dumps(stacks()))
        os._exit(1)

    timer = threading.Timer(seconds, force)
    timer.daemon = True
    timer.start()
    return timer
