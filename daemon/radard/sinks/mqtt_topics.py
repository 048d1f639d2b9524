"""MqttTopics: the content of a sensor's topics; decides which messages to publish, and when.

No network here: records, states and times go in, messages come out. Topics below
`PREFIX/SENSOR/`:

    availability   online | offline                      retained, also the last will
    state          {armed, alarm, label, gate, t_s}      retained
    health         {state, reason, fault, tamper, ...}   retained
    decision       every decision                        QoS 0
    event          every phase of every event            QoS 1, through the outbox
    command/NAME   arm, disarm, ack, calibrate           empty payload, never retained
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from radard.config.sink_table import MqttSection
from radard.sinks.base import COMMANDS, Record
from radard.sinks.homeassistant import discovery

_MOST_SHOWN = 40  # characters of a stranger's topic in the log, chosen
_HOP_S = 1.0
"""Time from one decision to the next (`radard.pipeline`)."""


@dataclass(frozen=True, slots=True)
class Publication:
    """One message to publish."""

    topic: str
    payload: str
    qos: int = 1
    is_retained: bool = True


class MqttTopics:
    """What a sensor's topics hold, all below `prefix`/`sensor`."""

    def __init__(
        self, sensor: str, prefix: str, options: MqttSection, *, takes_commands: bool
    ) -> None:
        self._sensor = sensor
        self._takes_commands = takes_commands
        self._options = options
        self.base = f"{prefix}/{sensor}"
        self._hello: Record | None = None
        self._open: dict[str, str] = {}
        self._is_armed = True
        self._calibration: str | None = None
        self._label: str | None = "none"
        self._gate = "closed"
        self._t_s = 0.0
        self._status = ("starting", "")
        self._decided_s = self._stated_s = float("-inf")
        self._published: dict[str, str] = {}

    @property
    def will(self) -> Publication:
        """The last will: what the broker publishes when the connection is lost."""
        return Publication(f"{self.base}/availability", "offline")

    @property
    def command_filter(self) -> str:
        """Topic filter of all commands."""
        return f"{self.base}/command/+"

    @property
    def birth_topic(self) -> str:
        """Where Home Assistant says that it has started."""
        return f"{self._options.discovery_prefix}/status"

    def command_of(self, topic: str, payload: bytes, *, is_retained: bool) -> str | None:
        """Return the command of a message; None on other topics.

        Raises ValueError if it is unknown, has a payload, or was retained: a retained `disarm`
        would disarm at every reconnection.
        """
        head, _, name = topic.rpartition("/")
        if head != f"{self.base}/command":
            return None
        shown = repr(name[:_MOST_SHOWN])
        if is_retained:
            msg = f"command {shown} ignored: it was retained; remove it from the broker"
            raise ValueError(msg)
        if name not in COMMANDS:
            msg = f"no command {shown}; known are {', '.join(COMMANDS)}"
            raise ValueError(msg)
        if payload:
            msg = f"command {shown} ignored: its payload must be empty"
            raise ValueError(msg)
        return name

    def event(self, record: Record) -> Publication:
        """Return the message of an event."""
        return Publication(f"{self.base}/event", _json(record), 1, is_retained=False)

    def on_record(self, record: Record, now_s: float) -> list[Publication]:
        """Take a record at a monotonic time; return what to publish now, but events (`event`)."""
        kind = record["type"]
        if kind == "hello":
            self._hello = record
            self._is_armed = bool(record.get("armed", self._is_armed))
            return self._discovery()
        if kind == "decision":
            return self._on_decision(record, now_s)
        if kind == "status":
            self._status = (record["state"], record["reason"])
        elif kind == "event":
            self._open.pop(record["kind"], None)
            if record["phase"] != "end":
                self._open[record["kind"]] = record["reason"]
        return self._changes(now_s)

    def refresh(
        self,
        now_s: float,
        status: tuple[str, str] | None,
        *,
        is_armed: bool | None,
        calibration: str | None = None,
    ) -> list[Publication]:
        """Take state and reason, armed (each None: as before), progress; return what changed."""
        self._calibration = calibration
        self._status = status or self._status
        self._is_armed = self._is_armed if is_armed is None else is_armed
        return self._changes(now_s)

    def announce(self, now_s: float) -> list[Publication]:
        """Return all that is retained: after a connection, and when Home Assistant starts."""
        self._published.clear()
        return self._discovery() + self._changes(now_s)

    def at_end(self) -> list[Publication]:
        """Return what to publish at a clean end."""
        self._status = ("offline", self._status[1] or "stopped")
        return self._changes(float("inf"))

    def _on_decision(self, record: Record, now_s: float) -> list[Publication]:
        self._label, self._gate, self._t_s = record["label"], record["gate"], record["t_s"]
        self._decided_s = now_s
        # The state is published every third of its expiry; the next decision would be too late.
        if now_s - self._stated_s >= self._options.expire_after_s / 3 - _HOP_S:
            self._published.pop("state", None)
        messages = self._changes(now_s)
        if self._options.decisions:
            topic = f"{self.base}/decision"
            messages.append(Publication(topic, _json(record), 0, is_retained=False))
        return messages

    def _changes(self, now_s: float) -> list[Publication]:
        state, reason = self._status
        is_well = state in {"online", "degraded"}
        health = {
            "state": state,
            "reason": reason,
            "fault": self._open.get("fault"),
            "tamper": self._open.get("tamper"),
            "calibration": self._calibration,
        }
        messages = self._if_changed("health", health, health)
        # A state from before an outage would be stale.
        if now_s - self._decided_s < self._options.expire_after_s:
            held = {
                "armed": self._is_armed,
                "alarm": "alarm" in self._open,
                "label": self._label,
                "gate": self._gate,
            }
            state_messages = self._if_changed("state", held, {**held, "t_s": self._t_s})
            if state_messages:
                self._stated_s = now_s
            messages += state_messages
        availability = "online" if is_well else "offline"
        if self._published.get("availability") != availability:
            self._published["availability"] = availability
            message = Publication(f"{self.base}/availability", availability)
            # `online` after the state topics, `offline` before them.
            messages.insert(len(messages) if is_well else 0, message)
        return messages

    def _if_changed(
        self, name: str, held: Mapping[str, Any], whole: Mapping[str, Any]
    ) -> list[Publication]:
        text = _json(held)
        if self._published.get(name) == text:
            return []
        self._published[name] = text
        return [Publication(f"{self.base}/{name}", _json(whole))]

    def _discovery(self) -> list[Publication]:
        if self._hello is None:
            return []
        pairs = discovery(
            self._sensor,
            self.base,
            self._hello,
            self._options,
            takes_commands=self._takes_commands,
        )
        return [Publication(topic, payload) for topic, payload in pairs]


def _json(content: Mapping[str, Any]) -> str:
    return json.dumps(dict(content), separators=(",", ":"))
