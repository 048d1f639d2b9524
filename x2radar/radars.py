"""A parsed port becomes a radar: a serial port, a URL of pyserial's, or a simulated module."""

import re
from collections.abc import Callable

from x2radar.device.device import X2Radar
from x2radar.device.discovery import find_module
from x2radar.device.link import Deadlines
from x2radar.device.transport import SerialTransport, Transport
from x2radar.errors import SettingsError
from x2radar.modules.base import ModuleSettings, SettingsChooser
from x2radar.modules.modules import MODULES, module_for
from x2radar.ports import Port
from x2radar.sim.module.faults import parse_faults
from x2radar.sim.module.firmware import FIRMWARES
from x2radar.sim.module.host import connect as connect_sim
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import load_scene
from x2radar.sim.scene.stage import check_swath

_KINDS = ("rf", "baseband")
_SIM_DEVICE = "x2raw"
_PATIENT = Deadlines(reply_s=60.0, ready_s=300.0, usb_gone_s=60.0, stall_s=300.0)
"""For a simulated module that waits for its reader: its thread is late, never silent."""


def make_radar(
    port: Port, *, speed: float | None = 1.0, settings: ModuleSettings | None = None
) -> X2Radar:
    """Return the radar that a port names, not opened yet; SettingsError or SceneError."""
    if port.kind == "replay":
        msg = f"port 'replay:{port.target}': a recording is no radar that can be opened"
        raise SettingsError(msg)
    port.check_keys()
    wanted = settings or port_settings(port)
    connect = _connector(port, speed, wanted)
    run_id = port.options.get("run", "")
    if "run" in port.options and not re.fullmatch(r"[A-Za-z0-9._-]{1,64}", run_id):
        msg = f"port key 'run': '{run_id}' must be 1 to 64 letters, digits, '.', '_' or '-'"
        raise SettingsError(msg)
    is_paced_by_reader = port.kind == "sim" and speed != 1.0 and "fault" not in port.options
    deadlines = _PATIENT if is_paced_by_reader else None
    name = f"{'sim' if port.kind == 'sim' else 'serial'}:{port.target}"
    return X2Radar(connect, wanted, deadlines=deadlines, name=name, run_id=run_id)


def port_settings(port: Port) -> ModuleSettings | SettingsChooser:
    """Return the settings that a port's keys ask for, by order code for device=auto."""
    is_sim = port.kind == "sim"
    known = tuple(MODULES) if is_sim else ("auto", *MODULES)
    device = port.options.get("device", _SIM_DEVICE if is_sim else "auto")
    if device not in known:
        raise SettingsError(f"port key 'device': '{device}'; known are {', '.join(known)}")
    kind = port.options.get("kind")
    if kind not in {None, *_KINDS}:
        raise SettingsError(f"port key 'kind': '{kind}'; known are {', '.join(_KINDS)}")
    rate_hz = port.number("rate", 0.0) if "rate" in port.options else None
    if device != "auto":
        return MODULES[device].settings.for_port(rate_hz, kind)
    # All of them, so that what makes no sense is said before a port is opened.
    rows = [row for row in MODULES.values() if row.order_codes]
    by_device = {row.device: row.settings.for_port(rate_hz, kind) for row in rows}
    return lambda order_code: by_device[module_for(order_code).device]


def _connector(
    port: Port, speed: float | None, settings: ModuleSettings | SettingsChooser
) -> Callable[[], Transport]:
    if port.kind == "auto":
        # Asked at every connection: a module that was unplugged may come back elsewhere.
        return lambda: SerialTransport(find_module())
    if port.kind == "live":
        return lambda: SerialTransport(port.target)
    text = port.options.get("seed", "0")
    # Not as a float, which takes large seeds for their neighbours.
    if not re.fullmatch(r"[0-9]{1,20}", text):
        raise SettingsError(f"port key 'seed': '{text}' must be a whole number from 0 up")
    seed, scene = int(text), load_scene(port.target)
    if not callable(settings):
        range_m = settings.axis.range_m
        check_swath(scene, float(range_m[0]), float(range_m[-1]))
    faults = parse_faults(port.options["fault"]) if "fault" in port.options else None
    firmware = FIRMWARES[port.options.get("device", _SIM_DEVICE)]
    return lambda: connect_sim(
        lambda: SimulatedModule(scene, seed, faults, firmware=firmware()), speed
    )
