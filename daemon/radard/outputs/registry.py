"""From the values of -o/--output to sinks; for several of them a test, a watch and their end."""

import importlib
import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from radard.config.sink_table import FORMS, SCHEMES, SinkOptions, SinkRow, find_row
from radard.errors import OutputError, UsageError
from radard.outputs.base import Sink, SinkContext, SinkState
from radard.outputs.thread_sink import CLOSE_S
from x2radar.plugins import Plugin, find_plugin

log = logging.getLogger("radard")
Key = tuple[str | None, str]
Opener = Callable[[str, SinkOptions, SinkContext], Sink]
"""Takes all of -o, the configuration's sections and the run; returns a sink.

`open_from_url` of a built-in sink's module, or a plug-in. It raises UsageError if the value is
incomplete, ConfigError if a credential cannot be read, OutputError if a file, a program or a
folder is not to be had, MissingExtra. A far end need not be there yet. At a reload the sink that
it replaces is still at work: what only one can hold belongs in a method `start`, which is called
once when that one is closed.
"""
ANSWERED_S = 8.0  # above what a webhook may take
_LOOK_S = 0.1  # a person waits
GRACE_S = 5.0  # a retry that helps within that is no trouble; a connection takes a moment, too
STUCK_S = 20.0  # records wait and nothing moves: the sink's thread hangs, or its far end does
DROPPED_S = 60.0  # how long it is said that records were dropped: long enough to be read
_OF_A_SINK = ("name", "state", "waits", "write", "finish", "close")


def start_sink(sink: Sink) -> None:
    """Let a sink of `make_output` begin to work."""
    getattr(sink, "start", lambda: None)()


def make_output(output: str, options: SinkOptions, context: SinkContext) -> Sink:
    """Return the sink that one value of -o/--output names, to be started; raises likewise."""
    found = check_output(output)
    if isinstance(found, SinkRow):
        opener: Opener = importlib.import_module(found.module).open_from_url
        return opener(output, options, context)
    plugged: Sink = found.guard(lambda: found.made(output, options, context))
    found.check(plugged, _OF_A_SINK)
    return plugged


def check_output(output: str) -> SinkRow | Plugin:
    """Return the row or plug-in that an output names; UsageError for none."""
    scheme, _, rest = output.partition(":")
    plugin = None if scheme in SCHEMES else find_plugin("radard.sinks", scheme)
    if (found := find_row(output) or plugin) is not None:
        return found
    # Only the scheme: the rest may hold a secret.
    shown = output if scheme == output else f"{scheme}:{'...' if scheme in SCHEMES else rest}"
    raise UsageError(f"--output '{shown}': unknown or incomplete; known are {FORMS}")


def close_sinks(sinks: Sequence[Sink]) -> None:
    """Close all within `CLOSE_S`; log what goes wrong."""
    deadline_s = time.monotonic() + CLOSE_S
    for sink in sinks:
        sink.finish(None if sink.waits else CLOSE_S)
    for sink in sinks:
        try:
            sink.close(None if sink.waits else max(0.0, deadline_s - time.monotonic()))
        except BrokenPipeError:
            # Who read it has gone, and so knows.
            continue
        except OutputError as err:
            log.warning("%s", err)


def tried(
    sinks: Sequence[Sink], send: Callable[[], None], halt: threading.Event | None = None
) -> list[dict[str, str]]:
    """Send a test alarm; return `output` and `answer` of every sink. `halt` ends the wait."""
    pairs = [(sink, sink.state) for sink in sinks]
    send()

    def is_over() -> bool:
        states = [(sink.state, was) for sink, was in pairs]
        return all(
            now.n_failures > was.n_failures or (now.is_ok and now.n_told > was.n_told)
            for now, was in states
        )

    wait_until(is_over, ANSWERED_S, halt or threading.Event())
    return [{"output": sink.name, "answer": _answer(sink, was)} for sink, was in pairs]


def wait_until(is_so: Callable[[], bool], timeout_s: float, halt: threading.Event) -> None:
    """Wait until something holds, as people wait; `timeout_s` at most, or until `halt`."""
    end_s = time.monotonic() + timeout_s
    while not is_so() and time.monotonic() < end_s and not halt.wait(_LOOK_S):
        pass


def _answer(sink: Sink, was: SinkState) -> str:
    now = sink.state
    if not now.is_ok:
        return f"failed: {now.reason}"
    if now.n_told > was.n_told:
        return "taken"
    return "no answer yet" if now.n_waiting else "not wanted there"


@dataclass(slots=True)
class _Seen:
    """What was seen of a sink, and when it was last well in one respect or the other."""

    ok_s: float
    moved_s: float
    dropped_s: float = float("-inf")
    counts: tuple[int, int, int] = (0, 0, 0)  # sent, dropped, failures

    def trouble(self, state: SinkState, now_s: float) -> str:
        """Return what is wrong with the sink by its state at a time; empty if nothing is."""
        counts = (state.n_sent, state.n_dropped, state.n_failures)
        if state.n_dropped > self.counts[1]:
            self.dropped_s = now_s
        if counts != self.counts or not state.n_waiting:
            self.counts, self.moved_s = counts, now_s
        if state.is_ok:
            self.ok_s = now_s
        why = ""
        if now_s - self.ok_s >= GRACE_S:
            why = state.reason or "does not work"
        elif max(now_s - self.moved_s, state.busy_s) >= STUCK_S:
            why = f"stands still, {state.n_waiting} records wait"
        drops = "drops records" if now_s - self.dropped_s < DROPPED_S else ""
        return ", ".join(filter(None, (why, state.remark, drops)))


class SinkWatch:
    """Look at sinks again and again, by the host's monotonic clock."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._seen: dict[Key, _Seen] = {}

    def look(self, sinks: Iterable[tuple[str | None, Sink]]) -> dict[Key, str]:
        """Return what is wrong with sinks, by their only sensor, if any, and name."""
        found: dict[Key, str] = {}
        now_s = self._clock()
        known, self._seen = self._seen, {}
        for sensor, sink in sinks:
            key = (sensor, sink.name)
            seen = self._seen[key] = known.get(key) or _Seen(now_s, now_s)
            if reason := seen.trouble(sink.state, now_s):
                found[key] = reason
        return found
