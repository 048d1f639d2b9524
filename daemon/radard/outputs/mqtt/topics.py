"""MqttTopics: the content of a sensor's topics; decides which messages to publish, and when.

No network here: records, states and times go in, messages come out. Topics below
`PREFIX/SENSOR/`:

    availability   online | offline                      retained, also the last will
    state          {armed, panel, alarm, label, ...}     retained
    health         {state, reason, fault, tamper, ...}   retained
    decision       every decision                        QoS 0
    event          every phase of every event            QoS 1, from the log
    picture        PNG of the last alarm                 retained
    command/NAME   see `radard.outputs.mqtt.commands`      never retained
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from radard.alarm.sensor_state import SensorState
from radard.config.sink_table import MqttSection
from radard.outputs.base import Record
from radard.outputs.mqtt.homeassistant import CodeForm, discovery, panel_state

_HOP_S = 1.0
"""Time from one decision to the next (`radard.pipeline`)."""


@dataclass(frozen=True, slots=True)
class Publication:
    """One message to publish."""

    topic: str
    payload: str | bytes
    qos: int = 1
    is_retained: bool = True


class MqttTopics:
    """What a sensor's topics hold, all below `prefix`/`sensor`."""

    def __init__(
        self,
        sensor: str,
        prefix: str,
        options: MqttSection,
        *,
        takes_commands: bool,
        code_form: CodeForm = None,
    ) -> None:
        self._code_form = code_form
        self._sensor = sensor
        self._takes_commands = takes_commands
        self._options = options
        self.base = f"{prefix}/{sensor}"
        self._hello: Record | None = None
        self._open: dict[str, str] = {}
        self._is_armed = True
        self._panel: SensorState | None = None
        self._sensitivity: str | None = None
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
    def birth_topic(self) -> str:
        """Where Home Assistant says that it has started."""
        return f"{self._options.discovery_prefix}/status"

    def event(self, record: Record) -> Publication:
        """Return the message of an event."""
        return Publication(f"{self.base}/event", _json(record), 1, is_retained=False)

    def on_record(self, record: Record, now_s: float) -> list[Publication]:
        """Take a record at a monotonic time; return what to publish now.

        Not events (`event`), and after a `hello` not `discovery`: these have their own order.
        """
        kind = record["type"]
        if kind == "hello":
            self._hello = record
            self._is_armed = bool(record.get("armed", self._is_armed))
            self._sensitivity = record.get("sensitivity")
            return []
        if kind == "decision":
            return self._on_decision(record, now_s)
        if kind == "status":
            self._status = (record["state"], record["reason"])
        elif kind == "event" and not record.get("test"):
            # A test sounds no siren: it is among the events alone.
            self._open.pop(record["kind"], None)
            if record["phase"] != "end":
                self._open[record["kind"]] = record["reason"]
        return self._changes(now_s)

    def refresh(
        self,
        now_s: float,
        status: tuple[str, str] | None,
        panel: SensorState | None,
        *,
        calibration: str | None = None,
    ) -> list[Publication]:
        """Take state and reason (None: as before), panel, progress; return what changed.

        `panel` is that of `radard.outputs.base.Host`.
        """
        self._calibration = calibration
        self._status = status or self._status
        self._panel = panel
        if panel is not None:
            self._is_armed, self._sensitivity = panel.armed, panel.sensitivity
        return self._changes(now_s)

    def announce(self, now_s: float) -> list[Publication]:
        """Return states and availability: after a connection, and when Home Assistant starts."""
        self._published.clear()
        return self._changes(now_s)

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
            is_on = "alarm" in self._open
            held = {
                "armed": self._is_armed,
                "panel": panel_state(self._panel, is_armed=self._is_armed, is_on=is_on),
                "sensitivity": self._sensitivity,
                "alarm": is_on,
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

    def discovery(self) -> list[Publication]:
        """Return what Home Assistant is told, once there was a `hello`."""
        if self._hello is None:
            return []
        pairs = discovery(
            self._sensor,
            self.base,
            self._hello,
            self._options,
            takes_commands=self._takes_commands,
            code_form=self._code_form,
        )
        found = [Publication(topic, payload) for topic, payload in pairs]
        # What an earlier version or setting left there.
        return found if self._options.picture else [*found, self.picture(b"")]

    def picture(self, png: bytes) -> Publication:
        """Return the message of the last alarm's picture; empty removes it."""
        return Publication(f"{self.base}/picture", png)


def _json(content: Mapping[str, Any]) -> str:
    return json.dumps(dict(content), separators=(",", ":"))
