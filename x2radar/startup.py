"""The first moment of a command, before imports that take a second: streams and signals."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType

_STOP = (signal.SIGINT, signal.SIGTERM)


class Interrupted(KeyboardInterrupt):
    """What SIGINT and SIGTERM raise.

    Python kills itself with SIGINT at its end when a plain KeyboardInterrupt has gone through any
    `exec`, as of a dataclass that is being made, even if it was caught.
    """


def begin() -> None:
    """Make standard streams and signals what every command relies on; to be called first.

    A standard stream that is closed becomes the null device, so that no file which is opened later
    takes its number; stdout is UTF-8 whatever the locale, and takes names of files of any bytes.
    SIGINT and SIGTERM end the process with 0 until `interrupts`; as process 1 of a container it
    would not even notice them.
    """
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != descriptor:
                os.dup2(opened, descriptor)
                os.close(opened)
            mode = "w" if descriptor else "r"
            stream = open(descriptor, mode, encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
    with contextlib.suppress(AttributeError):
        sys.stdout.reconfigure(encoding="utf-8", errors="surrogateescape")  # type: ignore[union-attr]
    for number in _STOP:
        if signal.getsignal(number) in {signal.SIG_DFL, signal.default_int_handler}:
            signal.signal(number, _end)


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
    """Let SIGINT and SIGTERM raise Interrupted, where nobody else has a say in it."""
    own: dict[signal.Signals, object] = {}
    if threading.current_thread() is threading.main_thread():
        for number in _STOP:
            before = signal.getsignal(number)
            if before in {signal.SIG_DFL, signal.default_int_handler, _end}:
                own[number] = before
                signal.signal(number, _interrupt)
    try:
        yield
    finally:
        for number, handler in own.items():
            signal.signal(number, handler)  # type: ignore[arg-type]


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise Interrupted


def _end(_number: int, _frame: FrameType | None) -> None:
    os._exit(0)
