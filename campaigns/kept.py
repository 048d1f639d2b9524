"""A daemon that is started again and again, and what must stay true of all that it keeps."""

import contextlib
import json
import random
import sqlite3
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from campaigns.outputs import Broker, Outputs, records
from campaigns.processes import Daemon, end_with, parser_of, wait_for
from radard.run.control import ask, control_path

PORT = "sim:human?run=kept"
"""A simulated module whose stream is the same in every run."""
_OWN = {"time", "latency_ms", "alarm"}
"""What tells of the clock on the wall, or of an alarm that was on before a start."""


class House:
    """A daemon with all its outputs, what it has kept, and the harm that came to that.

    `before` is code that it runs first. A campaign says in `once` what happens to it.
    """

    config: Mapping[str, Any]
    before = ""
    compares = True
    """Whether its decisions are held against those of a run that nothing happens to."""

    def __init__(self, folder: Path, rng: random.Random, stack: ExitStack) -> None:
        broker = Broker(folder)
        stack.callback(broker.stop)
        self.root, self.home, self.rng = folder, folder / "radard", rng
        self.state = self.home / "state"
        self.outputs = Outputs(folder, broker)
        self.found: Counter[str] = Counter()
        self.counts: dict[str, Any] = {}
        self.daemon: Daemon
        self._numbers: dict[int, str] = {}
        self._records: dict[str, str] = {}
        self._stored: set[str] = set()
        self._unfinished: set[str] = set()

    def once(self, k: int) -> None:
        """Let the k-th thing happen."""
        raise NotImplementedError

    def note(self, key: str, what: str) -> None:
        """Count harm, and say which."""
        self.found[key] += 1
        print(f"{key}: {what}", file=sys.stderr)

    def start(self, *arguments: str) -> None:
        """Start the daemon."""
        config = {**self.config, "service": {"state_dir": str(self.state)}}
        arguments = (*arguments, *self.outputs.arguments)
        self.daemon = Daemon(self.home, *arguments, config=config, before=self.before)

    def wait_status(self) -> None:
        """Wait until it says how it is: the file of the one before is still there."""
        daemon, pid = self.daemon, self.daemon.process.pid
        wait_for(lambda: daemon.status().get("pid") == pid or not daemon.is_alive, "a status")

    def stop(self, *, is_slow: bool = False) -> None:
        """End the daemon; where every write waits it may end by force, if it says so."""
        n_before = len(self.daemon.log)
        code = self.daemon.stop()
        is_forced = is_slow and "not ended in" in self.daemon.log[n_before:]
        if is_forced:
            # The clip of the last event may have been in the making.
            self._unfinished |= {row["id"] for row in list(self.outputs.records("event"))[-1:]}
        if (code != 0 and not is_forced) or "Traceback" in self.daemon.log:
            self.note("crashes", f"ended with {code}: {self.daemon.log[-3000:]}")

    def state_is(self, state: str) -> bool:
        """Return whether its status says so."""
        return bool(self.daemon.status().get("state") == state)

    def n_told(self, kind: str) -> int:
        """Return how many records of a type the file has."""
        return sum(1 for _ in self.outputs.records(kind))

    def expect(self, key: str, what: str, condition: Callable[[], object]) -> None:
        """Wait for something; note it if it never is, or if the daemon has ended meanwhile."""
        try:
            wait_for(lambda: condition() or not self.daemon.is_alive, what)
        except TimeoutError:
            self.note(key, f"{what}: {self.daemon.status()}")
        if not self.daemon.is_alive:
            self.note("crashes", f"{what}: it ended: {self.daemon.log[-3000:]}")
            self.revive()

    def revive(self) -> None:
        """Start a daemon that has ended again."""
        self.start()

    def goes_on(self, n: int, what: str = "decisions") -> None:
        """Wait for so many decisions more."""
        first = self.n_told("decision")
        self.expect("silent_stalls", what, lambda: self.n_told("decision") >= first + n)

    def ask(self, command: str) -> Mapping[str, Any]:
        """Ask the daemon to do something; return its answer, empty without one."""
        with contextlib.suppress(OSError, ValueError):
            return ask(control_path(self.home, "radar"), command)
        return {}

    def alarm_again(self) -> None:
        """End an alarm, by disarming, and let another begin."""
        self.ask("disarm")
        self.ask("arm")

    def missing(self) -> set[tuple[str, str]]:
        """Return the events of which one output was told and another not."""
        return self.outputs.missing()

    def finish(self) -> None:
        """Let all events arrive, end the daemon, and look at it all."""
        self.found["lost_events"] += self.outputs.lost(self.missing)
        self.look()
        self.stop()
        self.counts["events"] = len({row["id"] for row in self.outputs.records("event")})

    def begin_again(self) -> None:
        """Expect no more what a damaged file held; a key is still never used twice."""
        self._numbers.clear()
        self._stored.clear()

    def look(self) -> None:
        """Hold the event log and the store against what they held."""
        log = f"file:{self.state / 'log.db'}?mode=ro"
        with closing(sqlite3.connect(log, uri=True, timeout=10)) as db:
            rows = db.execute("SELECT n, key, record FROM log").fetchall()
        for n, key, record in rows:
            one, same = self._numbers.setdefault(n, key), self._records.setdefault(key, record)
            if (one, same) != (key, record):
                self.note("duplicate_events", f"number {n}: {one}, then {key}: {record}")
        stored = self.outputs.kept()
        for each in self._stored - set(stored):
            self.note("lost_events", f"{each} is in the store no more")
        for _ in range(len(stored) - len(set(stored))):
            self.note("duplicate_events", "an event is in the store twice")
        self._stored = set(stored)

    def look_at_clips(self) -> None:
        """Clips that events name exist, but for the oldest, which make room for others.

        The disk may fail once a clip is named: of that one the log says what became of it.
        """
        log = self.daemon.log
        told: dict[str, list[Mapping[str, Any]]] = {}
        for event in self.outputs.records("event"):
            # A simulated stream that begins again brings the ids of before: the last counts.
            told[event["id"]] = [*told.pop(event["id"], ()), event]
        # By its last phase; of one that has only begun the clip may just be made.
        ends = [rows[-1] for rows in told.values() if len(rows) > 1 and rows[-1]["clip"]]
        ends = [event for event in ends if event["id"] not in self._unfinished]
        exist = [Path(event["clip"]).exists() for event in ends]
        # All may have made room for one whose event goes on, or names it no more.
        n_gone = len(ends) if any((self.state / "clips").glob("*.h5")) else 0
        first = exist.index(True) if True in exist else n_gone
        for event, is_there in zip(ends[first:], exist[first:], strict=True):
            if not is_there and f"clip: {event['clip']}: " not in log:
                self.note("unreadable", f"no clip {event['clip']}\n{log[-3000:]}")

    def reference(self, seconds: int) -> list[dict[str, Any]]:
        """Return what is decided on the same stream where nothing happens."""
        out = self.root / "reference.jsonl"
        at_once = ("--speed", "max", "--duration", str(seconds), "-o", f"json:{out}")
        Daemon(self.root / "alone", *at_once, config=self.config).process.wait()
        return [_said(row) for row in records(out, "decision")]

    def look_at_decisions(self, reference: list[dict[str, Any]]) -> int:
        """Compare those of each start with a run that nothing happened to; return how many.

        Where a busy computer lost frames, or was so late that the module was reset, what comes
        behind that differs by right.
        """
        n, is_same, k = 0, True, 0
        for line in self.outputs.out.read_text().splitlines():
            row = json.loads(line)
            if row["type"] == "hello":
                is_same, k = True, 0
            is_same = is_same and row.get("kind") != "fault"
            if row["type"] != "decision":
                continue
            is_same = is_same and not row["dropped"] and k < len(reference)
            if is_same and _said(row) != reference[k]:
                self.note("decisions_differ", f"{row} and not {reference[k]}")
            n, k = n + is_same, k + 1
        return n


def _said(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a decision says of the stream."""
    return {key: row[key] for key in row.keys() - _OWN}


def campaign(doc: str | None, option: str, kind: type[House]) -> int:
    """Let it happen to a house again and again, print the last line and return the exit code.

    `option` is the name of how often, and of what the last line says of that.
    """
    parser = parser_of(doc)
    parser.add_argument(f"--{option}", type=int, default=200, dest="n")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        house = kind(folder, random.Random(args.seed), stack)  # noqa: S311 - no secret
        house.counts[option] = args.n
        expected = house.reference(60 if args.n < 10 else 600) if house.compares else []
        try:
            for k in range(args.n):
                house.once(k)
            house.finish()
        finally:
            house.stop()
        if house.compares:
            house.counts["decisions"] = house.look_at_decisions(expected)
    return end_with({**house.counts, **house.found})
