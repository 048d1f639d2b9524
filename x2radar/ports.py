"""A port string becomes a radar: serial ports, pyserial URLs and ``sim:`` scenes.

``/dev/ttyACM0``, ``socket://host:port``, ``auto`` (the only port that answers) or
``sim:SCENE?key=value&key=value``. Values are percent-encoded. Keys of ``sim:`` are seed (0),
rate (60, frames per second), kind (rf or baseband), device, fault (kind:value, see
`x2radar.sim.module.faults`) and run (the run's id, instead of one that no other run has); of
serial ports: rate, kind and device. A device is a row of
`x2radar.modules.modules.MODULES`, or auto: what the module calls itself decides.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from urllib.parse import parse_qsl, unquote

from x2radar.device.device import Deadlines, X2Radar
from x2radar.device.discovery import find_module
from x2radar.device.transport import SerialTransport, Transport
from x2radar.errors import SettingsError
from x2radar.modules.base import ModuleSettings, SettingsChooser
from x2radar.modules.modules import MODULES, module_for
from x2radar.sim.module.faults import parse_faults
from x2radar.sim.module.firmware import FIRMWARES
from x2radar.sim.module.host import connect as connect_sim
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import load_scene
from x2radar.sim.scene.stage import check_swath

_KINDS = ("rf", "baseband")
_SIM_DEVICE = "x2raw"
_PATIENT = Deadlines(reply_s=60.0, ready_s=300.0, usb_gone_s=60.0, stall_s=300.0)
"""For a simulated module without faults that runs as fast as it is read: it is never silent, only
its thread is late, as among a hundred others; a reset would make that worse. Chosen."""
SIM_KEYS = frozenset({"seed", "rate", "kind", "fault", "device", "run"})
SERIAL_KEYS = frozenset({"rate", "kind", "device"})
PORT_FORMS = (
    "auto (the only port that answers), /dev/ttyACM0 or any pyserial URL "
    f"[?{'=, '.join(sorted(SERIAL_KEYS))}=], sim:SCENE [?{'=, '.join(sorted(SIM_KEYS))}=]"
)
"""What a port may be and which keys it takes, for help; keys are joined by &."""


@dataclass(frozen=True, slots=True)
class PortSpec:
    """A port string, taken apart."""

    scheme: str
    """'sim', 'replay' or 'serial' (also pyserial URLs)."""
    target: str
    """Scene, file, device path or URL."""
    options: Mapping[str, str] = field(default_factory=dict)
    """The keys behind the question mark."""


def parse_port(text: str) -> PortSpec:
    """Take a port string apart.

    Raises SettingsError if a key is given twice or without a value, or nothing stands before them.
    """
    target, _, query = text.partition("?")
    if not target:
        msg = f"port '{text}': no port in front of '?'" if text else "port '': no port given"
        raise SettingsError(msg)
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query))
    except ValueError as err:
        msg = f"port '{text}': behind '?' come key=value pairs joined by '&'"
        raise SettingsError(msg) from err
    options = dict(pairs)
    if len(options) != len(pairs):
        msg = f"port '{text}': a key is given twice"
        raise SettingsError(msg)
    for scheme in ("sim", "replay"):
        if target.startswith(scheme + ":"):
            rest = unquote(target[len(scheme) + 1 :])
            if not rest:
                msg = f"port '{text}': nothing behind '{scheme}:'"
                raise SettingsError(msg)
            return PortSpec(scheme, rest, options)
    return PortSpec("serial", target, options)


def check_options(spec: PortSpec, known: frozenset[str]) -> None:
    """Raise SettingsError if `spec` has a key that is not in `known`."""
    for key in spec.options:
        if key not in known:
            msg = f"port key '{key}': unknown; known are {', '.join(sorted(known))}"
            raise SettingsError(msg)


def number_option(spec: PortSpec, key: str, default: float) -> float:
    """Return a numeric option; raise SettingsError if it is no number."""
    text = spec.options.get(key)
    if text is None:
        return default
    try:
        return float(text)
    except ValueError as err:
        msg = f"port key '{key}': '{text}' is not a number"
        raise SettingsError(msg) from err


def make_radar(
    spec: PortSpec,
    *,
    speed: float | None = 1.0,
    settings: ModuleSettings | None = None,
) -> X2Radar:
    """Return the radar that a port string, 'sim' or 'serial', names, not opened yet.

    Parameters
    ----------
    spec : PortSpec
        From `parse_port`.
    speed : float or None
        For ``sim:``, scene seconds per real second; None is as fast as it is read.
    settings : ModuleSettings, optional
        Instead of those that device, rate and kind ask for.

    Raises
    ------
    SettingsError, SceneError
        If the string names something unknown or impossible.
    """
    if spec.scheme == "replay":
        msg = f"port 'replay:{spec.target}': a recording is no radar that can be opened"
        raise SettingsError(msg)
    check_options(spec, SIM_KEYS if spec.scheme == "sim" else SERIAL_KEYS)
    chosen = settings or port_settings(spec)
    connect = _connector(spec, speed, chosen)
    run_id = spec.options.get("run", "")
    if "run" in spec.options and not re.fullmatch(r"[A-Za-z0-9._-]{1,64}", run_id):
        msg = f"port key 'run': '{run_id}' must be 1 to 64 letters, digits, '.', '_' or '-'"
        raise SettingsError(msg)
    is_paced_by_reader = spec.scheme == "sim" and speed is None and "fault" not in spec.options
    return X2Radar(
        connect,
        chosen,
        deadlines=_PATIENT if is_paced_by_reader else None,
        name=f"{spec.scheme}:{spec.target}",
        run_id=run_id,
    )


def port_settings(spec: PortSpec) -> ModuleSettings | SettingsChooser:
    """Return the settings that the keys of a port string, 'sim' or 'serial', ask for.

    For device=auto that is what gives them for the module's order code. Raises SettingsError if
    a key's value makes no sense.
    """
    is_sim = spec.scheme == "sim"
    known = tuple(MODULES) if is_sim else ("auto", *MODULES)
    device = spec.options.get("device", _SIM_DEVICE if is_sim else "auto")
    if device not in known:
        msg = f"port key 'device': '{device}'; known are {', '.join(known)}"
        raise SettingsError(msg)
    kind = spec.options.get("kind")
    if kind not in {None, *_KINDS}:
        msg = f"port key 'kind': '{kind}'; known are {', '.join(_KINDS)}"
        raise SettingsError(msg)
    rate_hz = number_option(spec, "rate", 0.0) if "rate" in spec.options else None
    if device != "auto":
        return MODULES[device].settings.for_port(rate_hz, kind)
    # All of them, so that what makes no sense is said before a port is opened.
    rows = [row for row in MODULES.values() if row.order_codes]
    chosen = {row.device: row.settings.for_port(rate_hz, kind) for row in rows}
    return lambda order_code: chosen[module_for(order_code).device]


def _connector(
    spec: PortSpec, speed: float | None, settings: ModuleSettings | SettingsChooser
) -> Callable[[], Transport]:
    if spec.scheme == "serial":
        if spec.target == "auto":
            # Asked at every connection: a module that was unplugged may come back elsewhere.
            return lambda: SerialTransport(find_module())
        return lambda: SerialTransport(spec.target)
    text = spec.options.get("seed", "0")
    # Not as a float, which takes large seeds for their neighbours.
    if not re.fullmatch(r"[0-9]{1,20}", text):
        msg = f"port key 'seed': '{text}' must be a whole number from 0 up"
        raise SettingsError(msg)
    seed, scene = int(text), load_scene(spec.target)
    if not callable(settings):
        range_m = settings.axis.range_m
        check_swath(scene, float(range_m[0]), float(range_m[-1]))
    faults = parse_faults(spec.options["fault"]) if "fault" in spec.options else None
    firmware = FIRMWARES[spec.options.get("device", _SIM_DEVICE)]
    return lambda: connect_sim(
        lambda: SimulatedModule(scene, seed, faults, firmware=firmware()), speed
    )
