"""Run by the Python of a Home Assistant, not by ours: a core that talks MQTT, told what to do.

Usage: ``python home_assistant_probe.py CONFIG_FOLDER BROKER_PORT``. It reads lines of JSON and
answers each with one: ``{"states": true}`` with all states; ``{"version": true}`` with year and
month of its release; ``{"picture": "image.x"}`` with an image, in base64; ``{"call":
["domain.service", {...}]}`` calls a service; ``{"blueprint": PATH, "input": {...}}`` makes an
automation of a blueprint.
"""

import asyncio
import base64
import inspect
import json
import sys
from pathlib import Path

LATER = {"discovery_keys": {}, "subentries_data": ()}
"""What entries need besides in later releases."""


async def started(folder, port):
    """Start a core with MQTT and nothing that needs the world."""
    from homeassistant import bootstrap, config_entries, core, loader
    from homeassistant.setup import async_setup_component

    try:
        from homeassistant.core_config import async_process_ha_core_config
    except ImportError:  # before 2024.11
        from homeassistant.config import async_process_ha_core_config

    hass = core.HomeAssistant(folder)
    hass.config.skip_pip = True
    hass.config_entries = config_entries.ConfigEntries(hass, {})
    loader.async_setup(hass)
    await bootstrap.async_load_base_functionality(hass)
    await async_process_ha_core_config(
        hass, {"name": "test", "time_zone": "UTC", "external_url": "http://127.0.0.1:8123"}
    )
    for name in ("homeassistant", "persistent_notification"):
        assert await async_setup_component(hass, name, {})
    known = inspect.signature(config_entries.ConfigEntry).parameters
    entry = config_entries.ConfigEntry(
        version=1,
        minor_version=1,
        domain="mqtt",
        title="broker",
        data={"broker": "127.0.0.1", "port": port, "discovery": True},
        source=config_entries.SOURCE_USER,
        options={},
        unique_id=None,
        **{name: empty for name, empty in LATER.items() if name in known},
    )
    await hass.config_entries.async_add(entry)
    await hass.async_start()
    return hass


async def answer(hass, wanted):
    """Return the answer to one line."""
    if "states" in wanted:
        found = hass.states.async_all()
        return {each.entity_id: {"state": each.state, **_plain(each.attributes)} for each in found}
    if "calls" in wanted:
        return hass.data.get("probe_calls", [])
    if "version" in wanted:
        from homeassistant.const import MAJOR_VERSION, MINOR_VERSION

        return [MAJOR_VERSION, MINOR_VERSION]
    if "picture" in wanted:
        entity = hass.data["image"].get_entity(wanted["picture"])
        return base64.b64encode(await entity.async_image() or b"").decode()
    if "blueprint" in wanted:
        return await automated(hass, wanted["blueprint"], wanted["input"])
    if "device" in wanted:
        from homeassistant.helpers import device_registry

        found = device_registry.async_get(hass).async_get_device({("mqtt", wanted["device"])})
        names = ("manufacturer", "model", "sw_version", "configuration_url")
        return {name: getattr(found, name) for name in names}
    service, data = wanted["call"]
    await hass.services.async_call(*service.split("."), data, blocking=True)
    return "called"


async def automated(hass, path, given):
    """Make an automation of a blueprint, with a notify service that only remembers."""
    from homeassistant.setup import async_setup_component

    calls = hass.data.setdefault("probe_calls", [])

    async def remember(call):
        calls.append(_plain(call.data))

    hass.services.async_register("notify", "phone", remember)
    folder = Path(hass.config.path("blueprints/automation/radard"))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / Path(path).name).write_text(Path(path).read_text())
    used = {"path": f"radard/{Path(path).name}", "input": given}
    automation = {"alias": "picture", "use_blueprint": used}
    return await async_setup_component(hass, "automation", {"automation": [automation]})


def _plain(attributes):
    return json.loads(json.dumps(dict(attributes), default=str))


async def main():
    """Answer lines until there are no more."""
    hass = await started(sys.argv[1], int(sys.argv[2]))
    loop = asyncio.get_running_loop()
    while line := await loop.run_in_executor(None, sys.stdin.readline):
        wanted = json.loads(line)
        try:
            sys.stdout.write(json.dumps({"ok": await answer(hass, wanted)}) + "\n")
        except Exception as err:  # noqa: BLE001 - told to the test
            sys.stdout.write(json.dumps({"error": repr(err)}) + "\n")
        sys.stdout.flush()
    await hass.async_stop(force=True)


asyncio.run(main())
