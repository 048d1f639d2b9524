"""MqttTopics: the content of a sensor's topics; decides which messages to publish, and when.

Retained: `availability` (also the last will), `state`, `health`, `picture`. Not: `decision` (QoS
0), `event` (QoS 1, from the log). Home Assistant's discovery is one message for the device (from
2024.11), or `components`, one for every entity, as older versions and openHAB want it. The alarm
is `motion`, which alarm panels take for an intruder; other movement is `occupancy`. `exp_aft`
makes an entity unavailable when a daemon hangs and sends no state.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, NamedTuple

from radard.alarm.sensitivity import SENSITIVITIES
from radard.alarm.sensor_state import SensorState
from radard.config.sink_table import KINDS, PHASES, MqttSection
from radard.health.health import Status
from radard.outputs.base import Record
from radard.outputs.mqtt.link import Publication

_HOP_S = 1.0  # time from one decision to the next (`radard.pipeline`)


class Entity(NamedTuple):
    """One entity of Home Assistant."""

    platform: str
    key: str
    config: Mapping[str, Any]


def _entity(platform: str, key: str, name: str, shows: str = "", **more: Any) -> Entity:
    """Return an entity that takes commands, or `shows` an expression of a topic; or both."""
    if platform in _COMMANDING:
        more = {"cmd_t": f"~/command/{key}", **more}
    if shows:
        more |= {"stat_t": f"~/{more.pop('topic', 'state')}", "val_tpl": f"{{{{ {shows} }}}}"}
    return Entity(platform, key, {"name": name, **more})


def _flag(key: str, name: str, expression: str, **more: str) -> Entity:
    return _entity("binary_sensor", key, name, f"'ON' if {expression} else 'OFF'", **more)


_COMMANDING = {"alarm_control_panel", "select", "button"}
_LABELS = ["human", "pet", "other", "pending", "none", "invalid"]
_OPEN = "value_json.gate == 'open'"
_HEALTH = {"topic": "health", "json_attr_t": "~/health"}
_PROBLEM = "value_json.state != 'online' or value_json.fault"
_STATE_ENTITIES = (
    _flag("alarm", "Alarm", "value_json.alarm", dev_cla="motion"),
    _flag("movement", "Movement", _OPEN, dev_cla="occupancy", ent_cat="diagnostic"),
    _flag("pet", "Pet", "value_json.label == 'pet'", dev_cla="occupancy"),
    _flag("armed", "Armed", "value_json.armed", ic="mdi:shield"),
    _entity("sensor", "label", "Who", "value_json.label or 'none'", dev_cla="enum", ops=_LABELS),
    _flag("tamper", "Tamper", "value_json.tamper", topic="health", dev_cla="tamper"),
    _flag("problem", "Problem", _PROBLEM, dev_cla="problem", ent_cat="diagnostic", **_HEALTH),
)
_PERCENT = {"unit_of_meas": "%", "stat_cla": "measurement", "sug_dsp_prc": 0, "en": False}
_METRES = {**_PERCENT, "unit_of_meas": "m", "dev_cla": "distance", "sug_dsp_prc": 1}
_P_HUMAN = "(value_json.fused_p_human or 0) * 100"
_DECISION_ENTITIES = (
    _entity("sensor", "p_human", "Human", _P_HUMAN, topic="decision", **_PERCENT),
    _entity("sensor", "range", "Range", "value_json.range_m", topic="decision", **_METRES),
)
"""Disabled at first: a value every second fills Home Assistant's database."""
_PICTURE = _entity("image", "picture", "Last alarm", img_t="~/picture", cont_type="image/png")
_EVENT_TYPES = [f"{kind}_{phase}" for kind in KINDS for phase in PHASES]
_OF_EVENT = (
    "{{ {'event_type': value_json.kind ~ '_' ~ value_json.phase, 'id': value_json.id, "
    "'reason': value_json.reason, 'test': value_json.test | default(false)} | to_json }}"
)
_EVENT = _entity(
    "event", "event", "Event", stat_t="~/event", evt_typ=_EVENT_TYPES, val_tpl=_OF_EVENT
)
_CODELESS = {"sup_feat": ["arm_home", "arm_away"], "cod_arm_req": False, "cod_dis_req": False}
_PANEL = _entity("alarm_control_panel", "panel", "Panel", "value_json.panel", **_CODELESS)
_CHOICES = {"ops": list(SENSITIVITIES["fused"]), "ent_cat": "config", "ic": "mdi:tune-vertical"}
_DISARM = _entity("button", "disarm", "Disarm", pl_prs="", ic="mdi:shield-off")
_COMMAND_ENTITIES = (
    _PANEL,
    _entity("select", "sensitivity", "Sensitivity", "value_json.sensitivity", **_CHOICES),
    _entity("button", "arm", "Arm", pl_prs="", ic="mdi:shield-lock"),
    _DISARM,
    _entity("button", "ack", "Acknowledge", pl_prs="", ic="mdi:check"),
    _entity("button", "calibrate", "Calibrate", pl_prs="", ic="mdi:tune", ent_cat="config"),
)
CodeForm = Literal["REMOTE_CODE", "REMOTE_CODE_TEXT", ""]  # of digits, or any text; none
"""How Home Assistant asks for a code and hands it on; it is checked here, not published."""
_WITH_CODE = {"cod_dis_req": True, "cmd_tpl": "{{ {'action': action, 'code': code} | to_json }}"}


_ENTITIES = (*_STATE_ENTITIES, _EVENT, _PICTURE, *_DECISION_ENTITIES, *_COMMAND_ENTITIES)


def panel_state(now: SensorState, *, is_on: bool) -> str:
    """Return a panel's state as Home Assistant calls it; `is_on` says that an alarm is."""
    names = {"armed": f"armed_{now.mode}", "exit": "arming", "entry": "pending"}
    return "triggered" if is_on or now.panel == "alarm" else names.get(now.panel, "disarmed")


@dataclass(eq=False)
class MqttTopics:
    """What a sensor's topics hold, all below `prefix`/`sensor`."""

    sensor: str
    prefix: str
    options: MqttSection
    takes_commands: bool
    code_form: CodeForm = ""

    def __post_init__(self) -> None:
        self.base = f"{self.prefix}/{self.sensor}"
        # The last will: what the broker publishes when the connection is lost.
        self.will = Publication(f"{self.base}/availability", "offline")
        self.birth_topic = f"{self.options.discovery_prefix}/status"  # Home Assistant has started
        self._hello: Record = {}
        self._decision: Record = {"label": "none", "gate": "closed", "t_s": 0.0}
        self._open: dict[str, str] = {}
        self._panel = SensorState()
        self._calibration: str | None = None
        self._status = Status("starting", "")
        self._decided_s = self._stated_s = float("-inf")
        self._published: dict[str, str] = {}

    def event(self, record: Record) -> Publication:
        """Return the message of an event."""
        return Publication(f"{self.base}/event", _json(record), 1, is_retained=False)

    def on_record(self, record: Record, now_s: float) -> list[Publication]:
        """Take a record at a monotonic time, no event; return what to publish now."""
        kind = record["type"]
        if kind == "hello":
            self._hello = record
            return []
        if kind == "decision":
            return self._on_decision(record, now_s)
        if kind == "event" and not record.get("test"):
            # A test sounds no siren: it is among the events alone.
            self._open.pop(record["kind"], None)
            if record["phase"] != "end":
                self._open[record["kind"]] = record["reason"]
        return self._changes(now_s)

    def refresh(
        self, now_s: float, status: Status, panel: SensorState | None
    ) -> list[Publication]:
        """Take the status, and what a stream's panel is; return what changed."""
        room = panel.calibration if panel is not None else None
        self._calibration = f"{room.phase}: {room.text}".removesuffix(": ") if room else None
        self._status, self._panel = status, panel or self._panel
        return self._changes(now_s)

    def announce(self, now_s: float) -> list[Publication]:
        """Return states and availability: after a connection, and when Home Assistant starts."""
        self._published.clear()
        return self._changes(now_s)

    def at_end(self) -> list[Publication]:
        """Return what to publish at a clean end."""
        self._status = Status("offline", self._status.reason or "stopped")
        return self._changes(float("inf"))

    def _on_decision(self, record: Record, now_s: float) -> list[Publication]:
        self._decision, self._decided_s = record, now_s
        # The state is published every third of its expiry; the next decision would be too late.
        # So is that it is there: a broker may publish the will of a connection that was replaced.
        hop_s = max(_HOP_S, self._hello.get("hop_s", _HOP_S))
        if now_s - self._stated_s >= self.options.expire_after_s / 3 - hop_s:
            for name in ("state", "availability"):
                self._published.pop(name, None)
        messages = self._changes(now_s)
        if self.options.decisions:
            topic = f"{self.base}/decision"
            messages.append(Publication(topic, _json(record), 0, is_retained=False))
        return messages

    def _changes(self, now_s: float) -> list[Publication]:
        health = {
            **asdict(self._status),
            "fault": self._open.get("fault"),
            "tamper": self._open.get("tamper"),
            "calibration": self._calibration,
        }
        messages = self._if_changed("health", _json(health))
        # A state from before an outage would be stale.
        if now_s - self._decided_s < self.options.expire_after_s:
            is_on = "alarm" in self._open
            held = {
                "armed": self._panel.armed,
                "panel": panel_state(self._panel, is_on=is_on),
                "sensitivity": self._panel.sensitivity,
                "alarm": is_on,
                "label": self._decision["label"],
                "gate": self._decision["gate"],
            }
            text = _json({**held, "t_s": self._decision["t_s"]})
            if state_messages := self._if_changed("state", _json(held), text):
                self._stated_s = now_s
            messages += state_messages
        # `online` after the state topics, `offline` before them.
        if self._status.is_well:
            return messages + self._if_changed("availability", "online")
        return self._if_changed("availability", "offline") + messages

    def _if_changed(self, name: str, what: str, text: str = "") -> list[Publication]:
        """Return the message of a topic, `what` or a `text` in its place, if `what` is new."""
        if self._published.get(name) == what:
            return []
        self._published[name] = what
        return [Publication(f"{self.base}/{name}", text or what)]

    def discovery(self) -> list[Publication]:
        """Return what Home Assistant is told, once there was a `hello`; empty payloads remove."""
        if not self._hello:
            return []
        o, sensor = self.options, self.sensor
        prefix, form = o.discovery_prefix, o.discovery
        about = self._about()
        # A button asks for no code.
        lacks = {_DISARM.key} if self.code_form else set()
        lacks |= set() if o.picture else {_PICTURE.key}
        lacks |= set() if o.decisions else {e.key for e in _DECISION_ENTITIES}
        lacks |= set() if self.takes_commands else {e.key for e in _COMMAND_ENTITIES}
        configs = {e.key: self._config(e) for e in _ENTITIES if e.key not in lacks}
        device = Publication(f"{prefix}/device/radard_{sensor}/config", "")
        found = [] if form == "device" else [device]
        for each in _ENTITIES:
            is_wanted = form == "components" and each.key in configs
            payload = json.dumps({**about, **configs[each.key]}) if is_wanted else ""
            topic = f"{prefix}/{each.platform}/radard_{sensor}/{each.key}/config"
            found.append(Publication(topic, payload))
        if form == "device":
            # With its platform alone, an entity that there once was is removed.
            parts = {e.key: {"p": e.platform, **configs.get(e.key, {})} for e in _ENTITIES}
            found.append(replace(device, payload=json.dumps({**about, "cmps": parts})))
        # What an earlier version or setting left there.
        return found if o.picture else [*found, self.picture(b"")]

    def _about(self) -> dict[str, Any]:
        hello = self._hello
        version, module = str(hello.get("version", "unknown")), hello.get("module")
        device = {"ids": [f"radard_{self.sensor}"], "name": self.sensor, "sw": version}
        mark = next((mark for mark in ("simulated", "replayed") if hello.get(mark)), None)
        if module:
            # All the modules that the driver knows are of one maker.
            device |= {"mf": "Novelda", "mdl": f"{module} ({mark})" if mark else str(module)}
        elif mark:
            device["mdl"] = mark
        if self.options.dashboard_url:
            device["cu"] = self.options.dashboard_url
        origin = {"name": "radard", "sw": version}
        return {"dev": device, "o": origin, "avty_t": self.will.topic, "qos": 1}

    def _config(self, entity: Entity) -> dict[str, Any]:
        config = {
            key: value.replace("~/", f"{self.base}/", 1) if key.endswith("_t") else value
            for key, value in entity.config.items()
        }
        config["uniq_id"] = f"radard_{self.sensor}_{entity.key}"
        if entity is _PANEL and self.code_form:
            config |= {**_WITH_CODE, "code": self.code_form}
        if entity.platform.endswith("sensor") and entity.config["stat_t"] != "~/health":
            # Without a fresh state it is unavailable.
            config["exp_aft"] = round(self.options.expire_after_s)
        return config

    def picture(self, png: bytes) -> Publication:
        """Return the message of the last alarm's picture; empty removes it."""
        return Publication(f"{self.base}/picture", png)


def _json(content: Mapping[str, Any]) -> str:
    return json.dumps(dict(content), separators=(",", ":"))
