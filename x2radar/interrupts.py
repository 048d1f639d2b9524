"""SIGINT and SIGTERM while a command works: they raise, or wait for a moment."""

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


_held: list[int] | None = None  # signals that came where none may raise


@contextlib.contextmanager
def without_interrupts() -> Iterator[None]:
    """Hold SIGINT and SIGTERM back while processes are started; they come behind it.

    Processes that are half started say so in a traceback. They inherit that SIGINT is blocked:
    Ctrl-C is the parent's. Blocked signals alone are not held: another thread may get them.
    """
    global _held  # noqa: PLW0603 - a handler is given nothing
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    outer, held = _held, [] if _held is None else _held
    _held = held
    try:
        yield
    finally:
        _held = outer
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if outer is None and held:
            os.kill(os.getpid(), held[0])


@contextlib.contextmanager
def interrupts() -> Iterator[None]:
    """Let SIGINT and SIGTERM raise Interrupted, where nobody else has a say in it.

    A signal is not lost where Python drops what is raised (`__del__`, a callback of a weak
    reference, as the lock of an import has one): it comes again a moment later.
    """
    hook, plain = sys.unraisablehook, {signal.SIG_DFL, signal.default_int_handler, end_at_once}
    is_main = threading.current_thread() is threading.main_thread()
    own = [number for number in STOP if is_main and signal.getsignal(number) in plain]
    before = {number: signal.signal(number, _interrupt) for number in own}

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
        for number, handler in before.items():
            signal.signal(number, handler)
        if own:
            sys.unraisablehook = hook


def _interrupt(number: int, _frame: FrameType | None) -> None:
    if _held is None:
        raise Interrupted(number)
    _held.append(number)


def _send_later(number: int) -> None:
    time.sleep(0.01)
    if signal.getsignal(number) is not signal.SIG_DFL:
        os.kill(os.getpid(), number)
