"""What must stay true of all that a daemon keeps and decides, looked at again and again."""

import contextlib
import json
import sqlite3
import sys
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from campaigns.outputs import Outputs, records
from campaigns.processes import Daemon
from radard.run.control import ask, control_path

PORT = "sim:human?run=kept"
"""A simulated module whose stream is the same in every run."""
_OWN = {"time", "latency_ms", "alarm"}
"""What tells of the clock on the wall, or of an alarm that was on before a start."""


class Kept:
    """Events, their numbers and clips in the event log, the store and the file of one daemon."""

    def __init__(self, outputs: Outputs, state: Path) -> None:
        self._outputs = outputs
        self._log = state / "log.db"
        self._numbers: dict[int, str] = {}
        self._records: dict[str, str] = {}
        self._stored: set[str] = set()
        self._unfinished: set[str] = set()
        self.found = dict.fromkeys(
            ("lost_events", "duplicate_events", "unreadable", "decisions_differ"), 0
        )

    def begin_again(self) -> None:
        """Expect no more what a damaged file held; a key is still never used twice."""
        self._numbers.clear()
        self._stored.clear()

    def look(self) -> None:
        """Hold what there is now against what there was."""
        with closing(sqlite3.connect(f"file:{self._log}?mode=ro", uri=True, timeout=10)) as db:
            rows = db.execute("SELECT n, key, record FROM log").fetchall()
        for n, key, record in rows:
            one, same = self._numbers.setdefault(n, key), self._records.setdefault(key, record)
            if (one, same) != (key, record):
                self._note("duplicate_events", f"number {n}: {one}, then {key}: {record}")
        stored = self._outputs.kept()
        for each in self._stored - set(stored):
            self._note("lost_events", f"{each} is in the store no more")
        for _ in range(len(stored) - len(set(stored))):
            self._note("duplicate_events", "an event is in the store twice")
        self._stored = set(stored)

    def end_by_force(self) -> None:
        """Expect no clip of the last event: it may have been in the making."""
        self._unfinished |= {event["id"] for event in list(self._outputs.records("event"))[-1:]}

    def look_at_clips(self, log: str) -> None:
        """Clips that events name exist, but for the oldest, which make room for others.

        The disk may fail once a clip is named: of that one the log says what became of it.
        """
        told: dict[str, list[Mapping[str, Any]]] = {}
        for event in self._outputs.records("event"):
            # A simulated stream that begins again brings the ids of before: the last counts.
            told[event["id"]] = [*told.pop(event["id"], ()), event]
        # By its last phase; of one that has only begun the clip may just be made.
        ends = [rows[-1] for rows in told.values() if len(rows) > 1 and rows[-1]["clip"]]
        ends = [event for event in ends if event["id"] not in self._unfinished]
        exist = [Path(event["clip"]).exists() for event in ends]
        first = exist.index(True) if True in exist else 0
        for event, is_there in zip(ends[first:], exist[first:], strict=True):
            if not is_there and f"clip: {event['clip']}: " not in log:
                self._note("unreadable", f"no clip {event['clip']}\n{log[-3000:]}")

    def look_at_decisions(self, reference: Sequence[Mapping[str, Any]]) -> int:
        """Compare those of each start with a run that nothing happened to; return how many.

        Where a busy computer lost frames, what comes behind them differs by right.
        """
        n, is_same, k = 0, True, 0
        for line in self._outputs.out.read_text().splitlines():
            row = json.loads(line)
            if row["type"] == "hello":
                is_same, k = True, 0
            if row["type"] != "decision":
                continue
            is_same = is_same and not row["dropped"] and k < len(reference)
            if is_same and said(row) != said(reference[k]):
                self._note("decisions_differ", f"{row} and not {reference[k]}")
            n, k = n + is_same, k + 1
        return n

    def _note(self, key: str, what: str) -> None:
        self.found[key] += 1
        print(f"{key}: {what}", file=sys.stderr)


def alarm_again(daemon: Daemon) -> None:
    """End an alarm, by disarming, and let another begin."""
    sock = control_path(daemon.folder, "radar")
    with contextlib.suppress(OSError, ValueError):
        ask(sock, "disarm")
        ask(sock, "arm")


def said(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a decision says of the stream."""
    return {key: row[key] for key in row.keys() - _OWN}


def reference(folder: Path, config: Mapping[str, Any], seconds: int) -> list[dict[str, Any]]:
    """Return what is decided on the same stream where nothing happens."""
    out = folder / "reference.jsonl"
    at_once = ("--speed", "max", "--duration", str(seconds))
    daemon = Daemon(folder / "alone", "--port", PORT, *at_once, "-o", f"json:{out}", config=config)
    daemon.process.wait()
    return list(records(out, "decision"))
