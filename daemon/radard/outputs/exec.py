"""exec: a program is run for every event, with the event on its standard input.

It is started without a shell, in a session of its own, and killed with all its children when
its time is up. Exit status 0 confirms the event. Any other counts as a refusal, but for an alarm
as an outage: a program cannot say that it never will. Its stdout is discarded, for stdout is for
data; its stderr is the daemon's.
"""

import contextlib
import os
import shlex
import shutil
import signal
import subprocess

from radard.config.sink_table import SinkOptions
from radard.errors import OutputError, UsageError
from radard.outputs.base import DeliveryError, Record, SinkContext
from radard.outputs.delivery import DeliverySink, Item, body_of, wants_events

_FIELDS = ("id", "phase", "kind", "t_s", "time", "peak", "reason", "clip")


def open_from_url(url: str, options: SinkOptions, context: SinkContext) -> "ProgramSink":
    """Return the sink of `exec:COMMAND`."""
    command = url.partition(":")[2]
    try:
        words = shlex.split(command)
    except ValueError as err:
        msg = f"--output exec: {err}"
        raise UsageError(msg) from err
    if not words:
        msg = "--output exec: no command"
        raise UsageError(msg)
    return ProgramSink(words, options, context)


class ProgramSink(DeliverySink):
    """Run a program for every event."""

    def __init__(self, words: list[str], options: SinkOptions, context: SinkContext) -> None:
        o = options.exec
        if shutil.which(words[0]) is None:
            msg = f"--output exec: {words[0]}: no such program, or not executable"
            raise OutputError(msg)
        self._words = words
        self._timeout_s = o.timeout_s
        self._sensor = context.sensor
        super().__init__(
            f"exec:{words[0]}",
            "\0".join(words),
            options.log,
            context,
            wants_events(o.kinds, o.phases),
        )

    def _send(self, item: Item) -> None:
        is_refusal = item.record.get("kind") != "alarm"
        try:
            process = subprocess.Popen(  # noqa: S603 - the command is the user's own
                self._words,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                env={**os.environ, **self._variables(item.record)},
                start_new_session=True,
            )
        except OSError as err:
            msg = f"cannot be started: {err.strerror}"
            raise DeliveryError(msg) from err
        try:
            body = body_of(self._sensor, item.record) + b"\n"
            process.communicate(body, self._timeout_s)
        except subprocess.TimeoutExpired as err:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            msg = f"killed after {self._timeout_s:g} s"
            raise DeliveryError(msg, is_refusal=is_refusal) from err
        code = process.returncode
        if code != 0:
            how = f"ended by {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
            raise DeliveryError(how, is_refusal=is_refusal)

    def _variables(self, record: Record) -> dict[str, str]:
        """Return the environment: not RADARD_..., which the daemon reads as configuration."""
        fields = {key: record.get(key) for key in _FIELDS}
        return {
            "RADAR_SENSOR": str(record.get("sensor", self._sensor)),
            **{
                f"RADAR_EVENT_{key.upper()}": "" if value is None else str(value)
                for key, value in fields.items()
            },
        }
