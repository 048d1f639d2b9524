"""From the values of -o/--output to sinks."""

import importlib
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from radard import plugins
from radard.config.sink_sections import SinkOptions
from radard.errors import OutputError, UsageError
from radard.sinks.base import Sink, SinkContext
from radard.sinks.null import NullSink
from radard.sinks.thread_sink import CLOSE_S

KNOWN = (
    "json, json:FILE, table, null, mqtt://HOST, mqtts://HOST, webhook:URL, exec:COMMAND, "
    "syslog:, store:FILE, http://HOST:PORT"
)
_STDOUT = ("json", "table")
_FAR = {
    "mqtt": "radard.sinks.mqtt",
    "mqtts": "radard.sinks.mqtt",
    "webhook": "radard.sinks.webhook",
    "exec": "radard.sinks.exec",
    "syslog": "radard.sinks.syslog",
    "store": "radard.sinks.store",
    "http": "radard.web.sink",
}
"""Loaded when asked for: most runs need none of their libraries."""
_WITHOUT_REST = ("syslog", "webhook")

Opener = Callable[[str, SinkOptions, SinkContext], Sink]
"""Takes all of -o, the configuration's sections and the run; also what a plug-in is."""
_OF_A_SINK = ("name", "state", "waits", "write", "finish", "close")


def open_output(url: str, options: SinkOptions, context: SinkContext) -> Sink:
    """Return the sink that one value of -o/--output names.

    Parameters
    ----------
    url : str
        One of `KNOWN`, filled in.
    options : SinkOptions
        Its section of the configuration.
    context : SinkContext
        What the run offers.

    Returns
    -------
    Sink
        At work. Far ends need not be there yet.

    Raises
    ------
    UsageError
        If the value is unknown or incomplete.
    ConfigError
        If a credential cannot be read.
    OutputError
        If a file, a program or a folder is not to be had.
    PluginError
        If it is a plug-in's, and that is broken.
    """
    check_output(url)
    if url == "null":
        return NullSink()
    if url in _STDOUT:
        return _open_stdout(url, context)
    scheme = url.partition(":")[0]
    if scheme == "json":
        from radard.sinks.jsonl import JsonLinesSink  # noqa: PLC0415 - as those of _FAR

        sink = JsonLinesSink(Path(url.partition(":")[2]), options.jsonl, context)
        sink.start()
        return sink
    if scheme not in _FAR:
        plugin = plugins.plugged(plugins.SINKS, scheme)
        assert plugin is not None  # noqa: S101 - check_output found it
        plugged: Sink = plugin.call(url, options, context)
        plugin.check(plugged, _OF_A_SINK)
        return plugged
    opener: Opener = importlib.import_module(_FAR[scheme]).open_from_url
    return opener(url, options, context)


def check_output(url: str) -> None:
    """Raise UsageError unless `url` has the form of an output."""
    scheme, _, rest = url.partition(":")
    if url in {*_STDOUT, "null"} or (scheme == "json" and rest):
        return
    if scheme in _FAR and (rest or (":" in url and scheme in _WITHOUT_REST)):
        return
    if scheme not in {*_FAR, *_STDOUT} and plugins.plugged(plugins.SINKS, scheme) is not None:
        return
    # Only the scheme: the rest may hold what nobody else should read.
    shown = url if scheme == url else f"{scheme}:{'...' if scheme in _FAR else rest}"
    msg = f"--output '{shown}': unknown or incomplete; known are {KNOWN}"
    raise UsageError(msg)


def open_sinks(
    outputs: Sequence[str],
    *,
    stdout_is_terminal: bool,
    options: SinkOptions | None = None,
    context: SinkContext | None = None,
) -> list[Sink]:
    """Return the sinks that `outputs` names.

    Parameters
    ----------
    outputs : sequence of str
        Values of -o/--output; none means a table on a terminal, JSON Lines elsewhere.
    stdout_is_terminal : bool
        Whether a person reads stdout.
    options : SinkOptions, optional
        Built-in values otherwise.
    context : SinkContext, optional
        A stream that can wait, and no more, otherwise.

    Returns
    -------
    list of Sink
        At work, in the order of `outputs`. All or none.

    Raises
    ------
    UsageError, ConfigError, OutputError
        See `open_output`; also if two outputs want stdout.
    """
    chosen = list(outputs) or ["table" if stdout_is_terminal else "json"]
    for output in chosen:
        check_output(output)
    if sum(output in _STDOUT for output in chosen) > 1:
        msg = "--output: json and table both want stdout; give one of them a file"
        raise UsageError(msg)
    options = options or SinkOptions()
    context = context or SinkContext(can_wait=True)
    sinks: list[Sink] = []
    try:
        for output in chosen:
            sinks.append(open_output(output, options, context))  # noqa: PERF401 - closed on error
    except BaseException:
        close_sinks(sinks, 0.0)
        raise
    return sinks


def close_sinks(sinks: Sequence[Sink], timeout_s: float = CLOSE_S) -> list[Exception]:
    """Close all at the same time; return what they still had to say.

    Parameters
    ----------
    sinks : sequence of Sink
        To be closed.
    timeout_s : float
        For all of them together; sinks on which the stream waits take the time they need.

    Returns
    -------
    list of Exception
        BrokenPipeError and OutputError, see `Sink.close`.
    """
    deadline_s = time.monotonic() + timeout_s
    for sink in sinks:
        sink.finish(None if sink.waits else timeout_s)
    said: list[Exception] = []
    for sink in sinks:
        try:
            sink.close(None if sink.waits else max(0.0, deadline_s - time.monotonic()))
        except (BrokenPipeError, OutputError) as err:
            said.append(err)
    return said


def _open_stdout(name: str, context: SinkContext) -> Sink:
    from radard.sinks.stdout import StdoutSink, json_line  # noqa: PLC0415 - as those of _FAR
    from radard.sinks.table import Table  # noqa: PLC0415

    render = json_line
    if name == "table":
        render = Table(has_colour=sys.stdout is not None and sys.stdout.isatty()).render
    sink = StdoutSink(name, render, waits=context.can_wait)
    sink.start()
    return sink
