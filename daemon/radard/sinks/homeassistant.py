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


def _flag(name: str, expression: str, **more: str) -> dict[str, Any]:
    template = "{{ 'ON' if " + expression + " else 'OFF' }}"
    return {"name": name, "stat_t": "~/state", "val_tpl": template, **more}


def _button(name: str, command: str, **more: str) -> dict[str, Any]:
    return {"name": name, "cmd_t": f"~/command/{command}", "pl_prs": "", **more}


_LABELS = ["human", "pet", "other", "pending", "none", "invalid"]
_STATE_ENTITIES = (
    Entity("binary_sensor", "alarm", _flag("Alarm", "value_json.alarm", dev_cla="motion"), True),
    Entity(
        "binary_sensor",
        "movement",
        _flag("Movement", "value_json.gate == 'open'", dev_cla="occupancy", ent_cat="diagnostic"),
        True,
    ),
    Entity(
        "binary_sensor",
        "pet",
        _flag("Pet", "value_json.label == 'pet'", dev_cla="occupancy"),
        True,
    ),
    Entity("binary_sensor", "armed", _flag("Armed", "value_json.armed", ic="mdi:shield"), True),
    Entity(
        "sensor",
        "label",
        {
            "name": "Who",
            "stat_t": "~/state",
            "val_tpl": "{{ value_json.label or 'none' }}",
            "dev_cla": "enum",
            "ops": _LABELS,
        },
        True,
    ),
    Entity(
        "binary_sensor",
        "tamper",
        _flag("Tamper", "value_json.tamper", stat_t="~/health", dev_cla="tamper"),
    ),
    Entity(
        "binary_sensor",
        "problem",
        _flag(
            "Problem",
            "value_json.state != 'online' or value_json.fault",
            stat_t="~/health",
            dev_cla="problem",
            ent_cat="diagnostic",
            json_attr_t="~/health",
        ),
    ),
)
_DECISION_ENTITIES = (
    Entity(
        "sensor",
        "p_human",
        {
            "name": "Human",
            "stat_t": "~/decision",
            "val_tpl": "{{ (value_json.fused_p_human or 0) * 100 }}",
            "unit_of_meas": "%",
            "stat_cla": "measurement",
            "sug_dsp_prc": 0,
            "en": False,
        },
        True,
    ),
    Entity(
        "sensor",
        "range",
        {
            "name": "Range",
            "stat_t": "~/decision",
            "val_tpl": "{{ value_json.range_m }}",
            "unit_of_meas": "m",
            "dev_cla": "distance",
            "stat_cla": "measurement",
            "sug_dsp_prc": 1,
            "en": False,
        },
        True,
    ),
)
"""Disabled at first: a value every second fills Home Assistant's database."""
_COMMAND_ENTITIES = (
    Entity("button", "arm", _button("Arm", "arm", ic="mdi:shield-lock")),
    Entity("button", "disarm", _button("Disarm", "disarm", ic="mdi:shield-off")),
    Entity("button", "ack", _button("Acknowledge", "ack", ic="mdi:check")),
    Entity(
        "button",
        "calibrate",
        _button("Calibrate", "calibrate", ic="mdi:tune", ent_cat="config"),
    ),
)


def entities(options: MqttSection) -> tuple[Entity, ...]:
    """Return the entities that a sensor has with these options."""
    return (
        *_STATE_ENTITIES,
        *(_DECISION_ENTITIES if options.decisions else ()),
        *(_COMMAND_ENTITIES if options.commands else ()),
    )


def discovery(
    sensor: str, base: str, hello: Mapping[str, Any], options: MqttSection
) -> Iterator[tuple[str, str]]:
    """Yield topic and payload of everything to be retained; an empty payload removes.

    `base` is the topic above the sensor's own, `hello` the run's first record. What the chosen
    form does not use is removed first, so that a change of form or options leaves nothing behind.
    """
    prefix, form = options.discovery_prefix, options.discovery
    wanted = {e.key: e for e in entities(options)}
    device_topic = f"{prefix}/device/radard_{sensor}/config"
    about = _about(sensor, base, hello)
    if form != "device":
        yield device_topic, ""
    for entity in (*_STATE_ENTITIES, *_DECISION_ENTITIES, *_COMMAND_ENTITIES):
        topic = f"{prefix}/{entity.platform}/radard_{sensor}/{entity.key}/config"
        is_wanted = form == "components" and entity.key in wanted
        config = {**about, **_config(entity, sensor, base, options)}
        yield topic, json.dumps(config) if is_wanted else ""
    if form == "device":
        components = {
            key: {"p": entity.platform, **_config(entity, sensor, base, options)}
            for key, entity in wanted.items()
        }
        yield device_topic, json.dumps({**about, "cmps": components})


def _about(sensor: str, base: str, hello: Mapping[str, Any]) -> dict[str, Any]:
    version = str(hello.get("version", "unknown"))
    return {
        "dev": {
            "ids": [f"radard_{sensor}"],
            "name": sensor,
            "mdl": str(hello.get("device", "radar")),
            "sw": version,
        },
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
