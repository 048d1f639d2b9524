"""A test alarm: what every output makes of it."""

import threading
import time
from collections.abc import Callable, Sequence

from radard.outputs.base import Sink, SinkState

ANSWERED_S = 8.0  # above what a webhook may take
_LOOK_S = 0.1  # a person waits


def tried(
    sinks: Sequence[Sink], send: Callable[[], None], halt: threading.Event | None = None
) -> list[dict[str, str]]:
    """Send a test alarm; return `output` and `answer` of every sink. `halt` ends the wait."""
    pairs = [(sink, sink.state) for sink in sinks]
    send()
    end_s = time.monotonic() + ANSWERED_S
    halt = halt or threading.Event()
    while not all(_has_answered(*pair) for pair in pairs) and time.monotonic() < end_s:
        if halt.wait(_LOOK_S):
            break
    return [{"output": sink.name, "answer": _answer(sink, was)} for sink, was in pairs]


def _has_answered(sink: Sink, was: SinkState) -> bool:
    now = sink.state
    return now.n_failures > was.n_failures or (now.is_ok and now.n_told > was.n_told)


def _answer(sink: Sink, was: SinkState) -> str:
    now = sink.state
    if not now.is_ok:
        return f"failed: {now.reason}"
    if now.n_told > was.n_told:
        return "taken"
    return "no answer yet" if now.n_waiting else "not wanted there"
