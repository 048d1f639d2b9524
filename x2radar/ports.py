"""A port string becomes a radar: serial ports, pyserial URLs and ``sim:`` scenes.

``/dev/ttyACM0``, ``socket://host:port``, ``auto`` (the only port that answers) or
``sim:SCENE?key=value&key=value``. Values are percent-encoded. Keys of ``sim:`` are seed (0),
rate (60, frames per second), kind (rf or baseband) and fault (kind:value, see
`x2radar.sim.faults`); of serial ports: rate, kind and device (x2raw or x4m03).
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from urllib.parse import parse_qsl, unquote

from x2radar.device import X2Radar
from x2radar.discovery import find_module
from x2radar.errors import SettingsError
from x2radar.settings import RadarSettings
from x2radar.settings_x4 import ModuleSettings, X4Settings
from x2radar.sim.faults import parse_faults
from x2radar.sim.host import connect
from x2radar.sim.module import SimulatedModule
from x2radar.sim.scene import load_scene
from x2radar.transport import SerialTransport, Transport

_KINDS = {"rf": "rf", "baseband": "iq"}
SIM_KEYS = frozenset({"seed", "rate", "kind", "fault"})
SERIAL_KEYS = frozenset({"rate", "kind", "device"})
DEVICES = ("x2raw", "x4m03")


@dataclass(frozen=True, slots=True)
class PortSpec:
    """A port string, taken apart.

    Attributes
    ----------
    scheme : str
        'sim', 'replay' or 'serial' (also pyserial URLs).
    target : str
        Scene, file, device path or URL.
    options : mapping of str to str
        The keys behind the question mark.
    """

    scheme: str
    target: str
    options: Mapping[str, str] = field(default_factory=dict)


def parse_port(text: str) -> PortSpec:
    """Take a port string apart.

    Raises
    ------
    SettingsError
        If a key is given twice or without a value, or nothing stands before the keys.
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
    spec: PortSpec, *, speed: float | None = 1.0, settings: ModuleSettings | None = None
) -> X2Radar:
    """Return the radar that a port string names, not opened yet.

    Parameters
    ----------
    spec : PortSpec
        From `parse_port`; 'sim' or 'serial'.
    speed : float or None
        For ``sim:``, scene seconds per real second; None is as fast as it is read.
    settings : RadarSettings or X4Settings, optional
        Instead of those that rate and kind ask for.

    Returns
    -------
    X2Radar
        Call `open`, or use it as a context manager.

    Raises
    ------
    SettingsError, SceneError
        If the string names something unknown or impossible.
    """
    if spec.scheme == "replay":
        msg = f"port 'replay:{spec.target}': a recording is no radar that can be opened"
        raise SettingsError(msg)
    check_options(spec, SIM_KEYS if spec.scheme == "sim" else SERIAL_KEYS)
    if settings is None:
        kind = spec.options.get("kind", "rf")
        if kind not in _KINDS:
            msg = f"port key 'kind': '{kind}'; known are {', '.join(_KINDS)}"
            raise SettingsError(msg)
        rate_hz = number_option(spec, "rate", 60.0)
        settings = _settings(spec, rate_hz, kind)
    return X2Radar(_connector(spec, speed), settings, name=f"{spec.scheme}:{spec.target}")


def _settings(spec: PortSpec, rate_hz: float, kind: str) -> ModuleSettings:
    device = spec.options.get("device", "x2raw")
    if device not in DEVICES:
        msg = f"port key 'device': '{device}'; known are {', '.join(DEVICES)}"
        raise SettingsError(msg)
    if device == "x4m03":
        # An X4 mixes down by itself; its RF frames must be asked for.
        is_baseband = spec.options.get("kind", "baseband") == "baseband"
        return X4Settings.for_frame_rate(rate_hz, is_baseband=is_baseband)
    return RadarSettings.for_frame_rate(rate_hz, output=_KINDS[kind])


def _connector(spec: PortSpec, speed: float | None) -> Callable[[], Transport]:
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
    faults = parse_faults(spec.options["fault"]) if "fault" in spec.options else None
    return lambda: connect(lambda: SimulatedModule(scene, seed, faults), speed)
