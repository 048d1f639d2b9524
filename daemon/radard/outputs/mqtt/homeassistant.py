"""Home Assistant's MQTT discovery: which entities a sensor has, in both forms.

`device`: one retained message for the whole device (Home Assistant from 2024.11).
`components`: one for every entity; older versions and openHAB understand only these. Keys are
the abbreviated ones of Home Assistant's documentation of MQTT discovery.

The alarm is a `motion` sensor, because alarm panels take motion for an intruder; any other
movement is `occupancy`, which they ignore. The same panel that arms from other places is an
`alarm_control_panel`. `exp_aft` makes an entity unavailable when a daemon
that hangs keeps its connection but sends no state.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from radard.alarm.sensitivity import SENSITIVITIES
from radard.alarm.sensor_state import SensorState
from radard.config.sink_table import KINDS, PHASES, MqttSection


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
_PICTURE = Entity(
    "image", "picture", {"name": "Last alarm", "img_t": "~/picture", "cont_type": "image/png"}
)
_EVENT = Entity(
    "event",
    "event",
    {
        "name": "Event",
        "stat_t": "~/event",
        "evt_typ": [f"{kind}_{phase}" for kind in KINDS for phase in PHASES],
        "val_tpl": (
            "{{ {'event_type': value_json.kind ~ '_' ~ value_json.phase, 'id': value_json.id, "
            "'reason': value_json.reason, 'test': value_json.test | default(false)} | to_json }}"
        ),
    },
)
_PANEL = Entity(
    "alarm_control_panel",
    "panel",
    {
        "name": "Panel",
        "stat_t": "~/state",
        "val_tpl": "{{ value_json.panel }}",
        "cmd_t": "~/command/panel",
        "sup_feat": ["arm_home", "arm_away"],
        "cod_arm_req": False,
        "cod_dis_req": False,
    },
)
_SENSITIVITY = Entity(
    "select",
    "sensitivity",
    {
        "name": "Sensitivity",
        "stat_t": "~/state",
        "val_tpl": "{{ value_json.sensitivity }}",
        "cmd_t": "~/command/sensitivity",
        "ops": list(SENSITIVITIES["fused"]),
        "ent_cat": "config",
        "ic": "mdi:tune-vertical",
    },
)
_DISARM = _button("disarm", "Disarm", ic="mdi:shield-off")
_COMMAND_ENTITIES = (
    _PANEL,
    _SENSITIVITY,
    _button("arm", "Arm", ic="mdi:shield-lock"),
    _DISARM,
    _button("ack", "Acknowledge", ic="mdi:check"),
    _button("calibrate", "Calibrate", ic="mdi:tune", ent_cat="config"),
)
PANEL_COMMANDS = {"ARM_AWAY": "arm", "ARM_HOME": "arm-home", "DISARM": "disarm"}
"""Commands by what Home Assistant's panel sends."""
CodeForm = Literal["digits", "text"] | None
"""What a code that disarming takes is made of; None without one."""
_CODES = {"digits": "REMOTE_CODE", "text": "REMOTE_CODE_TEXT"}
"""By which Home Assistant asks for a code and hands it on; it is checked here, not published."""
_WITH_CODE = {
    "cod_dis_req": True,
    "cmd_tpl": "{{ {'action': action, 'code': code} | to_json }}",
}


_ENTITIES = (*_STATE_ENTITIES, _EVENT, _PICTURE, *_DECISION_ENTITIES, *_COMMAND_ENTITIES)


def entities(
    options: MqttSection, *, takes_commands: bool, code_form: CodeForm = None
) -> tuple[Entity, ...]:
    """Return the entities that a sensor has with these options."""
    commands: tuple[Entity, ...] = _COMMAND_ENTITIES if takes_commands else ()
    if code_form:
        # A button asks for no code.
        commands = tuple(each for each in commands if each is not _DISARM)
    return (
        *_STATE_ENTITIES,
        _EVENT,
        *((_PICTURE,) if options.picture else ()),
        *(_DECISION_ENTITIES if options.decisions else ()),
        *commands,
    )


def panel_state(panel: SensorState | None, *, is_armed: bool, is_on: bool) -> str:
    """Return a panel's state as Home Assistant calls it.

    `panel` is that of `radard.outputs.base.Host`, None where it is not known yet; `is_on` says
    that an alarm is.
    """
    state = panel.panel if panel is not None else ("armed" if is_armed else "disarmed")
    if is_on or state == "alarm":
        return "triggered"
    if state == "armed":
        return f"armed_{panel.mode if panel is not None else 'away'}"
    return {"exit": "arming", "entry": "pending"}.get(str(state), "disarmed")


def panel_command(payload: bytes) -> tuple[str, str]:
    """Return the command that Home Assistant's panel sends, and the code with it.

    Raises ValueError if it is none.
    """
    text, code = payload.decode(), ""
    if text.startswith("{"):
        try:
            raw = json.loads(text)
        except RecursionError as err:
            msg = "a panel's command is nested too deeply"
            raise ValueError(msg) from err
        text, code = str(raw.get("action")), str(raw.get("code") or "")
    if text not in PANEL_COMMANDS:
        msg = f"a panel's command is one of {', '.join(PANEL_COMMANDS)}"
        raise ValueError(msg)
    return PANEL_COMMANDS[text], code


def discovery(
    sensor: str,
    base: str,
    hello: Mapping[str, Any],
    options: MqttSection,
    *,
    takes_commands: bool,
    code_form: CodeForm = None,
) -> Iterator[tuple[str, str]]:
    """Yield topic and payload of everything to be retained; an empty payload removes.

    `base` is the topic above the sensor's own, `hello` the run's first record. What the chosen
    form does not use is removed first, so that a change of form or options leaves nothing behind.
    """
    prefix, form = options.discovery_prefix, options.discovery
    wanted = {
        e.key: e for e in entities(options, takes_commands=takes_commands, code_form=code_form)
    }
    device_topic = f"{prefix}/device/radard_{sensor}/config"
    about = _about(sensor, base, hello, options)
    if form != "device":
        yield device_topic, ""
    for entity in _ENTITIES:
        topic = f"{prefix}/{entity.platform}/radard_{sensor}/{entity.key}/config"
        is_wanted = form == "components" and entity.key in wanted
        config = {**about, **_config(entity, sensor, base, options, code_form)}
        yield topic, json.dumps(config) if is_wanted else ""
    if form == "device":
        # With its platform alone, an entity that there once was is removed.
        components = {
            entity.key: {
                "p": entity.platform,
                **(
                    _config(entity, sensor, base, options, code_form)
                    if entity.key in wanted
                    else {}
                ),
            }
            for entity in _ENTITIES
        }
        yield device_topic, json.dumps({**about, "cmps": components})


def _about(
    sensor: str, base: str, hello: Mapping[str, Any], options: MqttSection
) -> dict[str, Any]:
    version, module = str(hello.get("version", "unknown")), hello.get("module")
    device = {"ids": [f"radard_{sensor}"], "name": sensor, "sw": version}
    mark = next((mark for mark in ("simulated", "replayed") if hello.get(mark)), None)
    if module:
        # All the modules that the driver knows are of one maker.
        device |= {"mf": "Novelda", "mdl": f"{module} ({mark})" if mark else str(module)}
    elif mark:
        device["mdl"] = mark
    if options.dashboard_url:
        device["cu"] = options.dashboard_url
    return {
        "dev": device,
        "o": {"name": "radard", "sw": version},
        "avty_t": f"{base}/availability",
        "qos": 1,
    }


def _config(
    entity: Entity, sensor: str, base: str, options: MqttSection, code_form: CodeForm
) -> dict[str, Any]:
    config = {
        key: value.replace("~/", f"{base}/", 1) if key.endswith("_t") else value
        for key, value in entity.config.items()
    }
    config["uniq_id"] = f"radard_{sensor}_{entity.key}"
    if entity is _PANEL and code_form:
        config |= {**_WITH_CODE, "code": _CODES[code_form]}
    if entity.expires:
        config["exp_aft"] = round(options.expire_after_s)
    return config
