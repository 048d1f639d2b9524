"""Stdout: records as JSON Lines or as a table, written past Python's buffers.

A thread that hangs in a write to `sys.stdout` holds that object's lock, and the interpreter
cannot end without it. So the bytes go straight to the descriptor, where there is one.
"""

import io
import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass

from radard.config.sink_table import SinkOptions
from radard.errors import OutputError
from radard.log_file import marks_of
from radard.outputs.base import Record, Sink, SinkContext
from radard.outputs.thread_sink import DirectSink, ThreadSink
from x2radar.backoff import Backoff

_HEAD = "    time  gate      power   floor   range  human   pet  who"
_HEAD_EVERY = 20  # lines: a head is always on the screen
_RED, _DIM, _PLAIN = "\x1b[1;31m", "\x1b[2m", "\x1b[0m"


def open_from_url(name: str, _options: SinkOptions, context: SinkContext) -> Sink:
    """Return the sink of `json`, `table` or `null`."""
    if name == "null":
        return ThreadSink(name, waits=context.can_wait)  # which does nothing with a record
    render = json_line
    if name == "table":
        render = Table(has_colour=sys.stdout is not None and sys.stdout.isatty()).render
    return StdoutSink(name, render, context)


def json_line(record: Record) -> str:
    """Return the line of a record in the JSON Lines contract, with its end."""
    return json.dumps(dict(record), separators=(",", ":"), allow_nan=False) + "\n"


class StdoutSink(DirectSink):
    """Write records to stdout; its failure ends the run, for stdout is what it was started for."""

    def __init__(self, name: str, render: Callable[[Record], str], context: SinkContext) -> None:
        super().__init__(name, Backoff(1.0, 1.0, name), context)
        self._render = render
        self._stream = sys.stdout
        if self._stream is None:
            raise OutputError(f"--output {name}: there is no stdout")
        try:
            self._stream.flush()
            self._fd: int | None = self._stream.fileno()
        except io.UnsupportedOperation:
            self._fd = None
        except (OSError, ValueError) as err:
            raise OutputError(f"--output {name}: stdout: {err}") from err

    def _deliver(self, record: Record) -> None:
        text = self._render(record)
        if self._fd is None:
            self._stream.write(text)
            return
        rest = text.encode(self._stream.encoding or "utf-8", "replace")
        try:
            while rest:
                rest = rest[os.write(self._fd, rest) :]
        except BrokenPipeError as err:
            self._fail_for_good(err)
        except OSError as err:
            self._fail_for_good(OutputError(f"--output {self.name}: stdout: {err.strerror}"))


@dataclass(slots=True)
class Table:
    """Render records as lines that a person reads, with colours where the terminal has them."""

    has_colour: bool
    _n_lines: int = 0

    def render(self, record: Record) -> str:
        """Return the text of one record, with its line end."""
        text = self._rendered(record)
        # `hello` names its sensor always, and its port anyway.
        sensor = "" if record["type"] == "hello" else record.get("sensor", "")
        return f"{sensor:<10} {text}" if sensor else text

    def _rendered(self, record: Record) -> str:
        kind = record["type"]
        if kind == "decision":
            head = self._styled(_HEAD, _DIM) if self._n_lines % _HEAD_EVERY == 0 else ""
            self._n_lines += 1
            return head + self._styled(*_decision_line(record))
        if kind == "event":
            what = f"{record['kind'].upper()} {record['phase']}{marks_of(record)}"
            style = _RED if record["phase"] == "new" else ""
            return self._styled(f"{record['t_s']:7.2f}s  {what}: {record['reason']}", style)
        if kind == "status":
            reason = f" ({record['reason']})" if record["reason"] else ""
            return self._styled(f"{'':9} {record['state']}{reason}", _DIM)
        model = record["model"] or "no model, gate only"
        rate = f"{record['frame_rate_hz']:g} Hz, {record['n_range']} bins"
        return f"radard {record['version']} on {record['port']} ({rate}; {model})\n"

    def _styled(self, text: str, style: str) -> str:
        return f"{style}{text}{_PLAIN}\n" if self.has_colour and style else f"{text}\n"


def _decision_line(record: Record) -> tuple[str, str]:
    def number(key: str, form: str, unit: str = "") -> str:
        value = record[key]
        width = int(form.partition(".")[0])
        return f"{'-':>{width + len(unit)}}" if value is None else f"{value:{form}f}{unit}"

    who = record["label"] or ""
    if record["alarm"]:
        who = f"{who}  << ALARM"
    line = (
        f"{record['t_s']:7.2f}s  {record['gate']:<7} {number('power_db', '7.1')} "
        f"{number('noise_floor_db', '7.1')}  {number('range_m', '5.2', 'm')}  "
        f"{number('fused_p_human', '5.2')} {number('fused_p_pet', '5.2')}  {who}"
    )
    return line, _RED if record["alarm"] else (_DIM if record["gate"] == "closed" else "")
