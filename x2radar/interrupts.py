"""SIGINT and SIGTERM while a command works: they raise, or are held back for a moment."""

import _thread
import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from types import FrameType

from x2radar.startup import STOP, end_at_once


class Interrupted(KeyboardInterrupt):
    """What SIGINT and SIGTERM raise.

    Python kills itself with SIGINT at its end when a plain KeyboardInterrupt has gone through any
    `exec`, as of a dataclass that is being made, even if it was caught.
    """


@contextlib.contextmanager
def without_interrupts() -> Iterator[None]:
    """Hold SIGINT back while processes are started, which inherit that: Ctrl-C is the parent's."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def interrupts() -> Iterator[None]:
    """Let SIGINT and SIGTERM raise Interrupted, where nobody else has a say in it.

    A signal is not lost where Python drops what is raised (`__del__`, a callback of a weak
    reference, as the lock of an import has one): it comes again a moment later.
    """
    own: dict[signal.Signals, object] = {}
    hook = sys.unraisablehook
    if threading.current_thread() is threading.main_thread():
        for number in STOP:
            before = signal.getsignal(number)
            if before in {signal.SIG_DFL, signal.default_int_handler, end_at_once}:
                own[number] = before
                signal.signal(number, _interrupt)

    def again(dropped: "sys.UnraisableHookArgs") -> None:
        if isinstance(dropped.exc_value, Interrupted):
            # Not a Thread, whose start waits: this may run anywhere.
            _thread.start_new_thread(_send_later, dropped.exc_value.args)
        else:
            hook(dropped)

    if own:
        sys.unraisablehook = again
    try:
        yield
    finally:
        for number, handler in own.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
        if own:
            sys.unraisablehook = hook


def _interrupt(number: int, _frame: FrameType | None) -> None:
    raise Interrupted(number)


def _send_later(number: int) -> None:
    time.sleep(0.01)
    if signal.getsignal(number) is not signal.SIG_DFL:
        os.kill(os.getpid(), number)
