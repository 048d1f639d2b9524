"""From the values of -o/--output to sinks, and what is done with several: a test, their end."""

import importlib
import logging
import threading
import time
from collections.abc import Callable, Sequence

from radard.config.sink_table import FORMS, SCHEMES, SinkOptions, find_row
from radard.errors import OutputError, UsageError
from radard.outputs.base import Sink, SinkContext, SinkState
from radard.outputs.thread_sink import CLOSE_S
from x2radar.plugins import Plugin, find_plugin

log = logging.getLogger("radard")
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
_OF_A_SINK = ("name", "state", "waits", "write", "finish", "close")


def start_sink(sink: Sink) -> None:
    """Let a sink of `make_output` begin to work."""
    if (start := getattr(sink, "start", None)) is not None:
        start()


def make_output(output: str, options: SinkOptions, context: SinkContext) -> Sink:
    """Return the sink that one value of -o/--output names, to be started; raises likewise."""
    plugin = check_output(output)
    if plugin is None:
        row = find_row(output)
        opener: Opener = importlib.import_module(row.module if row else "").open_from_url
        return opener(output, options, context)
    plugged: Sink = plugin.call(output, options, context)
    plugin.check(plugged, _OF_A_SINK)
    return plugged


def check_output(output: str) -> Plugin | None:
    """Return the plug-in that an output names, None for a built-in one; UsageError for none."""
    scheme, _, rest = output.partition(":")
    if find_row(output) is not None:
        return None
    plugin = None if scheme in SCHEMES else find_plugin("radard.sinks", scheme)
    if plugin is not None:
        return plugin
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
