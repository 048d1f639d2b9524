"""Home Assistant's MQTT discovery: which entities a sensor has, in both forms.

`device`: one retained message for the whole device (Home Assistant from 2024.11).
`components`: one for every entity; older versions and openHAB understand only these. Keys are
the abbreviated ones of Home Assistant's documentation of MQTT discovery.

The alarm is a `motion` sensor, because alarm panels take motion for an intruder; any other
movement is `occupancy`, which they ignore. `exp_aft` makes an entity unavailable when a daemon
that hangs keeps its connection but sends no state.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from radard.config.sink_table import MqttSection


@dataclass(frozen=True, slots=True)
class Entity:
    """One entity; `expires`: it is unavailable without a fresh state."""

    platform: str
    key: str
    config: Mapping[str, Any]
    expires: bool = False


def _flag(key: str, name: str, expression: str, *, topic: str = "state", **more: str) -> Entity:
    template = "{{ 'ON' if " + expression + " else 'OFF' }}"
    config = {"name": name, "stat_t": f"~/{topic}", "val_tpl": template, **more}
    return Entity("binary_sensor", key, config, expires=topic == "state")


def _value(key: str, name: str, topic: str, expression: str, **more: Any) -> Entity:
    config = {"name": name, "stat_t": f"~/{topic}", "val_tpl": f"{{{{ {expression} }}}}", **more}
    return Entity("sensor", key, config, expires=True)


def _button(key: str, name: str, **more: str) -> Entity:
    return Entity("button", key, {"name": name, "cmd_t": f"~/command/{key}", "pl_prs": "", **more})


_LABELS = ["human", "pet", "other", "pending", "none", "invalid"]
_OPEN = "value_json.gate == 'open'"
_PROBLEM = "value_json.state != 'online' or value_json.fault"
_STATE_ENTITIES = (
    _flag("alarm", "Alarm", "value_json.alarm", dev_cla="motion"),
    _flag("movement", "Movement", _OPEN, dev_cla="occupancy", ent_cat="diagnostic"),
    _flag("pet", "Pet", "value_json.label == 'pet'", dev_cla="occupancy"),
    _flag("armed", "Armed", "value_json.armed", ic="mdi:shield"),
    _value("label", "Who", "state", "value_json.label or 'none'", dev_cla="enum", ops=_LABELS),
    _flag("tamper", "Tamper", "value_json.tamper", topic="health", dev_cla="tamper"),
    _flag(
        "problem",
        "Problem",
        _PROBLEM,
        topic="health",
        dev_cla="problem",
        ent_cat="diagnostic",
        json_attr_t="~/health",
    ),
)
_PERCENT = {"unit_of_meas": "%", "stat_cla": "measurement", "sug_dsp_prc": 0, "en": False}
_METRES = {
    "unit_of_meas": "m",
    "dev_cla": "distance",
    "stat_cla": "measurement",
    "sug_dsp_prc": 1,
    "en": False,
}
_P_HUMAN = "(value_json.fused_p_human or 0) * 100"
_DECISION_ENTITIES = (
    _value("p_human", "Human", "decision", _P_HUMAN, **_PERCENT),
    _value("range", "Range", "decision", "value_json.range_m", **_METRES),
)
"""Disabled at first: a value every second fills Home Assistant's database."""
_COMMAND_ENTITIES = (
    _button("arm", "Arm", ic="mdi:shield-lock"),
    _button("disarm", "Disarm", ic="mdi:shield-off"),
    _button("ack", "Acknowledge", ic="mdi:check"),
    _button("calibrate", "Calibrate", ic="mdi:tune", ent_cat="config"),
)


_ENTITIES = (*_STATE_ENTITIES, *_DECISION_ENTITIES, *_COMMAND_ENTITIES)


def entities(options: MqttSection, *, takes_commands: bool) -> tuple[Entity, ...]:
    """Return the entities that a sensor has with these options."""
    return (
        *_STATE_ENTITIES,
        *(_DECISION_ENTITIES if options.decisions else ()),
        *(_COMMAND_ENTITIES if takes_commands else ()),
    )


def discovery(
    sensor: str,
    base: str,
    hello: Mapping[str, Any],
    options: MqttSection,
    *,
    takes_commands: bool,
) -> Iterator[tuple[str, str]]:
    """Yield topic and payload of everything to be retained; an empty payload removes.

    `base` is the topic above the sensor's own, `hello` the run's first record. What the chosen
    form does not use is removed first, so that a change of form or options leaves nothing behind.
    """
    prefix, form = options.discovery_prefix, options.discovery
    wanted = {e.key: e for e in entities(options, takes_commands=takes_commands)}
    device_topic = f"{prefix}/device/radard_{sensor}/config"
    about = _about(sensor, base, hello)
    if form != "device":
        yield device_topic, ""
    for entity in _ENTITIES:
        topic = f"{prefix}/{entity.platform}/radard_{sensor}/{entity.key}/config"
        is_wanted = form == "components" and entity.key in wanted
        config = {**about, **_config(entity, sensor, base, options)}
        yield topic, json.dumps(config) if is_wanted else ""
    if form == "device":
        # With its platform alone, an entity that there once was is removed.
        components = {
            entity.key: {
                "p": entity.platform,
                **(_config(entity, sensor, base, options) if entity.key in wanted else {}),
            }
            for entity in _ENTITIES
        }
        yield device_topic, json.dumps({**about, "cmps": components})


def _about(sensor: str, base: str, hello: Mapping[str, Any]) -> dict[str, Any]:
    version, model = str(hello.get("version", "unknown")), str(hello.get("device", "radar"))
    return {
        "dev": {"ids": [f"radard_{sensor}"], "name": sensor, "mdl": model, "sw": version},
        "o": {"name": "radard", "sw": version},
        "avty_t": f"{base}/availability",
        "qos": 1,
    }


def _config(entity: Entity, sensor: str, base: str, options: MqttSection) -> dict[str, Any]:
    config = {
        key: value.replace("~/", f"{base}/", 1) if key.endswith("_t") else value
        for key, value in entity.config.items()
    }
    config["uniq_id"] = f"radard_{sensor}_{entity.key}"
    if entity.expires:
        config["exp_aft"] = round(options.expire_after_s)
    return config
