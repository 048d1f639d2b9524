"""An alarm that somebody else wrote: a function of a file, asked window by window.

``alarms(windows)`` is a generator. It takes `radard.stream.ring.Dwell` after `Dwell`, as the
daemon's ring makes them, one a second with the last 2.45 s of frames, and yields for each whether
it is an alarm. It is given a window once it has answered the one before, so it cannot look ahead.
"""

import hashlib
import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np

from radard.errors import UsageError
from radard.stream.ring import Dwell

Alarms = Callable[[Iterator[Dwell]], Iterator[bool]]
FUNCTION = "alarms"
"""The function's name, unless the entry names another."""


def is_function(text: str) -> bool:
    """Return whether an entry's text means a function: ``FILE.py`` or ``FILE.py:FUNCTION``."""
    return text.partition(":")[0].endswith(".py")


def module_of(text: str) -> ModuleType:
    """Return the module of ``FILE.py[:FUNCTION]``; its code runs here.

    Raises UsageError if there is no such file.
    """
    path = Path(text.partition(":")[0])
    if not path.is_file():
        msg = f"entry '{path}': no such file"
        raise UsageError(msg)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None  # noqa: S101 - its name ends in .py
    assert spec.loader is not None  # noqa: S101
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def function_of(text: str, default: str) -> Callable[..., object]:
    """Return the function of ``FILE.py[:FUNCTION]``; `default` is its name where none is given.

    Raises UsageError if there is none.
    """
    file, _, name = text.partition(":")
    made = getattr(module_of(text), name or default, None)
    if not callable(made):
        msg = f"entry '{file}': has no function '{name or default}'"
        raise UsageError(msg)
    return made  # type: ignore[no-any-return]


def sha256_of(text: str) -> str:
    """Return the hash of an entry's file and of its function's name."""
    file, _, name = text.partition(":")
    return hashlib.sha256(Path(file).read_bytes() + name.encode()).hexdigest()


class AlarmFunction:
    """A function's verdicts on one stream.

    Parameters
    ----------
    alarms : callable
        The generator function.
    name : str
        Of the entry, for messages.
    """

    def __init__(self, alarms: Alarms, name: str) -> None:
        self._name = name
        self._waiting: list[Dwell] = []
        self._verdicts = iter(alarms(self._windows()))

    def _windows(self) -> Iterator[Dwell]:
        while True:
            if not self._waiting:
                msg = f"entry '{self._name}': took a window before it had answered the last one"
                raise UsageError(msg)
            yield self._waiting.pop()

    def is_alarm(self, window: Dwell) -> bool:
        """Return the verdict on the next window.

        Raises UsageError if the function ends, looks ahead or answers with anything but a bool.
        """
        self._waiting.append(window)
        verdict = next(self._verdicts, None)
        if not isinstance(verdict, bool | np.bool_) or self._waiting:
            msg = f"entry '{self._name}': must yield True or False for every window"
            raise UsageError(msg)
        return bool(verdict)
