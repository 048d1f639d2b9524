"""Sinks: where records go. `open_sinks` reads what -o/--output says."""

from collections.abc import Sequence

from radard.errors import UsageError
from radard.sinks.base import Sink
from radard.sinks.jsonl import JsonLinesSink
from radard.sinks.null import NullSink
from radard.sinks.table import TableSink

KNOWN = "json, json:FILE, table, null"


def open_sinks(outputs: Sequence[str], *, stdout_is_terminal: bool) -> list[Sink]:
    """Return the sinks that `outputs` names.

    Parameters
    ----------
    outputs : sequence of str
        Values of -o/--output; none means a table on a terminal, JSON Lines elsewhere.
    stdout_is_terminal : bool
        Whether a person reads stdout.

    Returns
    -------
    list of Sink
        Open. Either all or none: nothing is created when one of them is wrong.

    Raises
    ------
    UsageError
        If a value is unknown, or two of them want stdout.
    OutputError
        If a file cannot be written.
    """
    chosen = list(outputs) or ["table" if stdout_is_terminal else "json"]
    for output in chosen:
        scheme, _, rest = output.partition(":")
        if output not in {"json", "table", "null"} and not (scheme == "json" and rest):
            msg = f"--output '{output}': unknown; this version knows {KNOWN}"
            raise UsageError(msg)
    if sum(output in {"json", "table"} for output in chosen) > 1:
        msg = "--output: json and table both want stdout; give one of them a file"
        raise UsageError(msg)
    return [_open(output) for output in chosen]


def _open(output: str) -> Sink:
    if output == "null":
        return NullSink()
    if output == "table":
        return TableSink()
    return JsonLinesSink(output.partition(":")[2] or None)
