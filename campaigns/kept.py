"""A daemon with a file, a store and a broker, and what must stay true of all that it keeps."""

import contextlib
import json
import random
import sqlite3
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from amqtt.broker import BrokerContext
from amqtt.plugins.base import BasePlugin
from amqtt.session import ApplicationMessage

from campaigns.processes import CONFIG, Daemon, end_with, parser_of
from radard.run.control import ask, control_path
from tests.sink_helpers import MqttBroker
from tests.waiting import wait_for

# A simulated module whose stream is the same in every run; it has four seconds a second, so that
# more happens between two disturbances.
BUSY = {**CONFIG, "sensor": {"port": "sim:human?run=kept", "speed": "4"}}
_OWN = {"time", "latency_ms", "alarm"}  # of the wall clock, or an alarm that was on at a start


class EventLog(BasePlugin[BrokerContext]):
    """In a broker: writes the payload of every message on a topic that ends with /event."""

    async def on_broker_message_received(self, *, message: ApplicationMessage, **_: str) -> None:
        """Write the payload of an event, a line each."""
        if message.topic.endswith("/event") and message.data:
            with Path(self.config.path).open("ab") as file:
                file.write(bytes(message.data) + b"\n")

    @dataclass
    class Config:
        """Where to."""

        path: str = ""


def records(path: Path, *kinds: str) -> Iterator[dict[str, Any]]:
    """Yield the records of some types in JSON Lines; the last line of a killed run may be torn."""
    for line in path.read_text().splitlines() if path.exists() else ():
        with contextlib.suppress(ValueError):
            if (row := json.loads(line))["type"] in kinds:
                yield row


def phases(rows: Iterable[Mapping[str, Any]]) -> set[tuple[str, str]]:
    """Return the ids of events, each with its phase."""
    return {(row["id"], row["phase"]) for row in rows}


class House:
    """A daemon with all its outputs, what it has kept, and the harm that came to that.

    `before` is code that it runs first. A campaign says in `once` what happens to it.
    """

    config: Mapping[str, Any] = CONFIG
    before = ""

    def __init__(self, folder: Path, rng: random.Random, stack: ExitStack) -> None:
        self._at_broker = folder / "broker.events"
        noted = {"campaigns.kept.EventLog": {"path": str(self._at_broker)}}
        self.broker = MqttBroker(folder, plugins=noted)
        stack.callback(self.broker.stop)
        self.root, self.home, self.rng = folder, folder / "radard", rng
        self.state = self.home / "state"
        self.out, self.store = folder / "out.jsonl", folder / "store" / "radard.db"
        self.store.parent.mkdir(parents=True)
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
        broker = f"mqtt://127.0.0.1:{self.broker.port}/radard"
        outputs = ("-o", f"json:{self.out}", "-o", f"store:{self.store}", "-o", broker)
        self.daemon = Daemon(self.home, *arguments, *outputs, config=config, before=self.before)

    def wait_status(self) -> None:
        """Wait until it says how it is: the file of the one before is still there."""
        daemon, pid = self.daemon, self.daemon.process.pid
        wait_for(lambda: daemon.status().get("pid") == pid or not daemon.is_alive)

    def stop(self, *, is_slow: bool = False) -> None:
        """End the daemon; where every write waits it may end by force, if it says so."""
        n_before = len(self.daemon.log)
        code = self.daemon.stop()
        is_forced = is_slow and "not ended in" in self.daemon.log[n_before:]
        if is_forced:
            # The clip of the last event may have been in the making.
            self._unfinished |= {row["id"] for row in list(self.records("event"))[-1:]}
        if (code != 0 and not is_forced) or "Traceback" in self.daemon.log:
            self.note("crashes", f"ended with {code}: {self.daemon.log[-3000:]}")

    def state_is(self, state: str) -> bool:
        """Return whether its status says so."""
        return bool(self.daemon.status().get("state") == state)

    def n_told(self, kind: str) -> int:
        """Return how many records of a type the file has."""
        return sum(1 for _ in self.records(kind))

    def records(self, kind: str) -> Iterator[dict[str, Any]]:
        """Yield the records of a type in the file."""
        return records(self.out, kind)

    def kept(self) -> list[str]:
        """Return the ids of the store's events, one a row."""
        if not self.store.exists():
            return []
        with closing(sqlite3.connect(f"file:{self.store}?mode=ro", uri=True, timeout=30)) as db:
            return [row[0] for row in db.execute("SELECT id FROM events")]

    def expect(self, key: str, what: str, condition: Callable[[], object]) -> None:
        """Wait for something; note it if it never is, or if the daemon has ended meanwhile."""
        try:
            wait_for(lambda: condition() or not self.daemon.is_alive)
        except AssertionError:
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
        """Return the events, with their phase, of which one output was told and another not."""
        told, came = phases(self.records("event")), phases(records(self._at_broker, "event"))
        alone = {each for each, _ in told | came} ^ set(self.kept())
        return (told - came) | {(each, "in the store alone, or not in it") for each in alone}

    def untold(self) -> set[tuple[str, str]]:
        """Return the events, with their phase, that did not come to the broker."""
        return phases(self.records("event")) - phases(records(self._at_broker, "event"))

    def let_arrive(self) -> None:
        """Wait until no event is missing; note those that never come."""
        with contextlib.suppress(AssertionError):
            wait_for(lambda: not self.missing())
        for row in self.missing():
            self.note("lost_events", str(row))

    def finish(self) -> None:
        """Let all events arrive, end the daemon, and look at it all."""
        self.let_arrive()
        self.look()
        self.stop()
        self.counts["events"] = len({row["id"] for row in self.records("event")})

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
        stored = self.kept()
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
        for event in self.records("event"):
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
        for row in records(self.out, "hello", "event", "decision"):
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
        house.counts.setdefault(option, args.n)
        expected = house.reference(60 if args.n < 10 else 600)
        try:
            for k in range(args.n):
                house.once(k)
            house.finish()
        finally:
            house.stop()
        house.counts["decisions"] = house.look_at_decisions(expected)
    return end_with({**house.counts, **house.found})
