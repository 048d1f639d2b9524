"""What a daemon tells of events: all its outputs, one of them a broker in a process of its own."""

import contextlib
import json
import sqlite3
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from amqtt.broker import BrokerContext
from amqtt.plugins.base import BasePlugin
from amqtt.session import ApplicationMessage

from campaigns.processes import wait_for
from tests.sink_helpers import MqttBroker


class EventLog(BasePlugin[BrokerContext]):
    """Writes the payload of every message on a topic that ends with /event, a line each."""

    async def on_broker_message_received(
        self, *, client_id: str, message: ApplicationMessage
    ) -> None:
        """Write the payload of an event."""
        del client_id
        if message.topic.endswith("/event") and message.data:
            with Path(self.config.path).open("ab") as file:
                file.write(bytes(message.data) + b"\n")

    @dataclass
    class Config:
        """Where to."""

        path: str = ""


class Broker(MqttBroker):
    """An MQTT broker that notes the events that it takes."""

    def __init__(self, folder: Path) -> None:
        self._events = folder / "broker.events"
        noted = {"campaigns.outputs.EventLog": {"path": str(self._events)}}
        super().__init__(folder, plugins=noted)
        self.url = f"mqtt://127.0.0.1:{self.port}/radard"

    def events(self) -> list[dict[str, Any]]:
        """Return the events that it took, in order."""
        lines = self._events.read_text().splitlines() if self._events.exists() else ()
        return [json.loads(line) for line in lines]


def records(path: Path, kind: str) -> Iterator[dict[str, Any]]:
    """Yield the records of a type in JSON Lines; the last line of a killed run may be torn."""
    for line in path.read_text().splitlines() if path.exists() else ():
        with contextlib.suppress(ValueError):
            if (row := json.loads(line))["type"] == kind:
                yield row


class Outputs:
    """A file, a store and a broker that one daemon tells of the same events."""

    def __init__(self, folder: Path, broker: Broker) -> None:
        self.broker = broker
        self.out, self.store = folder / "out.jsonl", folder / "store" / "radard.db"
        self.store.parent.mkdir(parents=True)
        urls = (f"json:{self.out}", f"store:{self.store}", broker.url)
        self.arguments = [word for url in urls for word in ("-o", url)]

    def records(self, kind: str) -> Iterator[dict[str, Any]]:
        """Yield the records of a type in the file."""
        return records(self.out, kind)

    def kept(self) -> list[str]:
        """Return the ids of the store's events, one a row."""
        if not self.store.exists():
            return []
        with closing(sqlite3.connect(f"file:{self.store}?mode=ro", uri=True, timeout=30)) as db:
            return [row[0] for row in db.execute("SELECT id FROM events")]

    def missing(self) -> set[tuple[str, str]]:
        """Return the events, with their phase, of which one output was told and another not."""
        told, came = phases(self.records("event")), phases(self.broker.events())
        kept = set(self.kept())
        unsaid = {(each, "") for each in kept - {each for each, _ in came}}
        return (told - came) | unsaid | {row for row in told | came if row[0] not in kept}

    def lost(self, missing: Callable[[], set[tuple[str, str]]]) -> int:
        """Wait until no event is missing; return how many never come."""
        with contextlib.suppress(TimeoutError):
            wait_for(lambda: not missing(), "events at all outputs")
        for row in (left := missing()):
            print(f"lost: {row} of {len(left)}", file=sys.stderr)
        return len(left)


def phases(rows: Iterable[Mapping[str, Any]]) -> set[tuple[str, str]]:
    """Return the ids of events, each with its phase."""
    return {(row["id"], row["phase"]) for row in rows}
