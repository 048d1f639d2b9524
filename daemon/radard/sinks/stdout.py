"""Stdout: records as JSON Lines or as a table, written past Python's buffers.

A thread that hangs in a write to `sys.stdout` holds that object's lock, and the interpreter
cannot end without it. So the bytes go straight to the descriptor, where there is one.
"""

import io
import json
import os
import sys
from collections.abc import Callable

from radard.errors import OutputError
from radard.sinks.backoff import Backoff
from radard.sinks.base import Record
from radard.sinks.thread_sink import DirectSink


def json_line(record: Record) -> str:
    """Return the line of a record in the JSON Lines contract, with its end."""
    return json.dumps(dict(record), separators=(",", ":"), allow_nan=False) + "\n"


class StdoutSink(DirectSink):
    """Write records to stdout; its failure ends the run, for stdout is what it was started for.

    Parameters
    ----------
    name : str
        json or table.
    render : callable
        Record to text.
    waits : bool
        The stream waits for the reader.

    Raises
    ------
    OutputError
        If there is no stdout.
    """

    def __init__(self, name: str, render: Callable[[Record], str], *, waits: bool = False) -> None:
        super().__init__(name, Backoff(1.0, 1.0, name), waits=waits)
        self._render = render
        self._stream = sys.stdout
        if self._stream is None:
            msg = f"--output {name}: there is no stdout"
            raise OutputError(msg)
        try:
            self._stream.flush()
            self._fd: int | None = self._stream.fileno()
        except io.UnsupportedOperation:
            self._fd = None
        except (OSError, ValueError) as err:
            msg = f"--output {name}: stdout: {err}"
            raise OutputError(msg) from err

    def _deliver(self, record: Record) -> None:
        text = self._render(record)
        try:
            self._put(text)
        except BrokenPipeError as err:
            self._fail_for_good(err)
        except OSError as err:
            self._fail_for_good(OutputError(f"--output {self.name}: stdout: {err.strerror}"))

    def _put(self, text: str) -> None:
        if self._fd is None:
            self._stream.write(text)
            return
        rest = text.encode(self._stream.encoding or "utf-8", "replace")
        while rest:
            rest = rest[os.write(self._fd, rest) :]
