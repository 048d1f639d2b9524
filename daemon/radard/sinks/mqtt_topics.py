"""MqttTopics: what a sensor's topics say; decides which messages to publish, and when.

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

from radard.config.sink_sections import MqttSection
from radard.sinks.base import Record
from radard.sinks.homeassistant import discovery

COMMANDS = ("arm", "disarm", "ack", "calibrate")
_HOP_S = 1.0


@dataclass(frozen=True, slots=True)
class Publication:
    """One message to publish."""

    topic: str
    payload: str
    qos: int = 1
    is_retained: bool = True


class MqttTopics:
    """What is on a sensor's topics.

    Parameters
    ----------
    sensor : str
        Name of the sensor.
    prefix : str
        First part of the topics.
    options : MqttSection
        Expiry, discovery, what is wanted.
    """

    def __init__(self, sensor: str, prefix: str, options: MqttSection) -> None:
        self._sensor = sensor
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
        self._shown: dict[str, str] = {}

    @property
    def will(self) -> Publication:
        """The last will: what the broker says when the daemon is gone."""
        return Publication(f"{self.base}/availability", "offline")

    @property
    def command_filter(self) -> str:
        """Subscription that brings all commands."""
        return f"{self.base}/command/+"

    @property
    def birth_topic(self) -> str:
        """Where Home Assistant says that it has started."""
        return f"{self._options.discovery_prefix}/status"

    def command_of(self, topic: str, payload: bytes, *, is_retained: bool) -> str | None:
        """Return the command that a message gives; None if it is none.

        Raises
        ------
        ValueError
            If it looks like one and is not: unknown, with a payload, or retained. A retained
            `disarm` would disarm at every reconnection.
        """
        head, _, name = topic.rpartition("/")
        if head != f"{self.base}/command":
            return None
        if is_retained:
            msg = f"command '{name}' ignored: it was retained; remove it from the broker"
            raise ValueError(msg)
        if name not in COMMANDS:
            msg = f"no command '{name}'; known are {', '.join(COMMANDS)}"
            raise ValueError(msg)
        if payload:
            msg = f"command '{name}' ignored: its payload must be empty"
            raise ValueError(msg)
        return name

    def event(self, record: Record) -> Publication:
        """Return the message of an event."""
        return Publication(f"{self.base}/event", _json(record), 1, is_retained=False)

    def on_record(self, record: Record, now_s: float) -> list[Publication]:
        """Take a record.

        Parameters
        ----------
        record : Record
            Any.
        now_s : float
            Monotonic time.

        Returns
        -------
        list of Publication
            To be published now; events are not among them, see `event`.
        """
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
        """Ask what holds now; return what has changed.

        Parameters
        ----------
        now_s : float
            Monotonic time.
        status : (str, str) or None
            State and reason of the daemon; None: as the last record said.
        is_armed : bool or None
            None: as before.
        calibration : str or None
            How far the calibration is that a command asked for, or how it ended.
        """
        self._calibration = calibration
        self._status = status or self._status
        self._is_armed = self._is_armed if is_armed is None else is_armed
        return self._changes(now_s)

    def announce(self, now_s: float) -> list[Publication]:
        """Return all that is retained: after a connection, and when Home Assistant is born."""
        self._shown.clear()
        return self._discovery() + self._changes(now_s)

    def farewell(self, reason: str) -> list[Publication]:
        """Return what is said at a clean end."""
        self._status = ("offline", reason or self._status[1] or "stopped")
        return self._changes(float("inf"))

    def _on_decision(self, record: Record, now_s: float) -> list[Publication]:
        self._label, self._gate, self._t_s = record["label"], record["gate"], record["t_s"]
        self._decided_s = now_s
        # The next decision may come too late for the third: this one must do then.
        if now_s - self._stated_s >= self._options.expire_after_s / 3 - _HOP_S:
            self._shown.pop("state", None)
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
        messages = self._show("health", health, health)
        # A state from before an outage must not look like a fresh one.
        if now_s - self._decided_s < self._options.expire_after_s:
            telling = {
                "armed": self._is_armed,
                "alarm": "alarm" in self._open,
                "label": self._label,
                "gate": self._gate,
            }
            state_messages = self._show("state", telling, {**telling, "t_s": self._t_s})
            if state_messages:
                self._stated_s = now_s
            messages += state_messages
        availability = "online" if is_well else "offline"
        if self._shown.get("availability") != availability:
            self._shown["availability"] = availability
            message = Publication(f"{self.base}/availability", availability)
            # Good news after, bad news before the values that it is about.
            messages.insert(len(messages) if is_well else 0, message)
        return messages

    def _show(
        self, name: str, telling: Mapping[str, Any], whole: Mapping[str, Any]
    ) -> list[Publication]:
        text = _json(telling)
        if self._shown.get(name) == text:
            return []
        self._shown[name] = text
        return [Publication(f"{self.base}/{name}", _json(whole))]

    def _discovery(self) -> list[Publication]:
        if self._hello is None:
            return []
        pairs = discovery(self._sensor, self.base, self._hello, self._options)
        return [Publication(topic, payload) for topic, payload in pairs]


def _json(content: Mapping[str, Any]) -> str:
    return json.dumps(dict(content), separators=(",", ":"))
