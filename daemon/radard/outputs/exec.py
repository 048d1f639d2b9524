"""exec: a program is run for every event, with the event on its standard input.

It is killed with all its children when its time is up. Exit status 0 confirms the event; any other
is a refusal, but for an alarm an outage: a program cannot say that it never will.
"""

import contextlib
import os
import shlex
import shutil
import signal
import subprocess

from radard.config.sink_table import SinkOptions
from radard.errors import OutputError, UsageError
from radard.log_file import MARKS
from radard.outputs.base import DeliveryError, Record, SinkContext
from radard.outputs.stdout import json_line
from radard.outputs.thread_sink import Delivery, wants_events

_FIELDS = ("id", "phase", "kind", "t_s", "time", "peak", "reason", "clip", *MARKS)
_SIGNALS = {each.value: each.name for each in signal.Signals}  # real-time ones have no name


def open_from_url(url: str, options: SinkOptions, context: SinkContext) -> Delivery:
    """Return the sink of `exec:COMMAND`."""
    command = url.partition(":")[2]
    try:
        words = shlex.split(command)
    except ValueError as err:
        raise UsageError(f"--output exec: {err}") from err
    if not words:
        raise UsageError("--output exec: no command")
    if shutil.which(words[0]) is None:
        raise OutputError(f"--output exec: {words[0]}: no such program, or not executable")
    o, sensor = options.exec, context.sensor
    return Delivery(
        f"exec:{words[0]}",
        "\0".join(words),
        options.log,
        context,
        wants_events(o.kinds, o.phases),
        lambda entry: _run(words, {"sensor": sensor, **entry.record}, o.timeout_s),
    )


def _run(words: list[str], record: Record, timeout_s: float) -> None:
    """Run a program for an event; raises DeliveryError unless it ends with 0 in time."""
    is_refusal = record.get("kind") != "alarm"
    # Not RADARD_..., which the daemon reads as configuration.
    environ = {**os.environ, "RADAR_SENSOR": str(record["sensor"])}
    for key in _FIELDS:
        value = record.get(key)
        environ[f"RADAR_EVENT_{key.upper()}"] = "" if value is None else str(value)
    try:
        process = subprocess.Popen(  # noqa: S603 - the command is the user's own
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            env=environ,
            start_new_session=True,
        )
    except OSError as err:
        raise DeliveryError(f"cannot be started: {err.strerror}") from err
    try:
        process.communicate(json_line(record).encode(), timeout_s)
    except subprocess.TimeoutExpired as err:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        raise DeliveryError(f"killed after {timeout_s:g} s", is_refusal=is_refusal) from err
    if (code := process.returncode) != 0:
        ended = f"ended by {_SIGNALS.get(-code, f'signal {-code}')}"
        raise DeliveryError(ended if code < 0 else f"exit status {code}", is_refusal=is_refusal)
