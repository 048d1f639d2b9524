"""The modules that the driver knows: one row each.

A new module is a row, a file like `x2` with its settings and start-up commands, and the firmware
that simulates it, in `x2radar.sim.module.firmware`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from x2radar.modules.base import ModuleSettings
from x2radar.modules.profile import ProfileSettings
from x2radar.modules.x2 import PULSE_GENERATORS, RadarSettings
from x2radar.modules.x4 import PULSES, SAMPLE_RATE_HZ, X4Settings

_NEAR = 0.01  # sampler and carrier are known to 1 %; pulses of a module lie farther apart


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleRow:
    """What the driver knows of one kind of module; a row of `MODULES`."""

    device: str  # as the key `device` of a port string names it
    name: str  # for people, as its maker writes it
    settings: type[ModuleSettings]  # its settings, with fast-time axis and start-up commands
    order_codes: tuple[str, ...] = ()
    """How the order codes of such modules begin, in capitals: that is how `device=auto` knows
    them. "" takes what no other row does; without any, the module must be named."""
    samplers_hz: tuple[float, float] = (0.0, 0.0)
    """Slowest and fastest RF sampler of such modules, in hertz; of modules that share a chip, one
    states it."""
    pulses: tuple[tuple[float, float], ...] = ()
    """Carriers of its pulses and their bandwidths at -10 dB, in hertz."""
    bundle: str = ""  # the daemon's model bundle for this module alone


MODULES: Mapping[str, ModuleRow] = {
    row.device: row
    for row in (
        ModuleRow(
            device="x2raw",
            name="X2",
            settings=RadarSettings,
            order_codes=("",),
            # The NVA6201, from chip to chip (protocol notes, section 5).
            samplers_hz=(38e9, 41e9),
            pulses=PULSE_GENERATORS,
        ),
        ModuleRow(device="x2m200", name="X2M200", settings=ProfileSettings),
        ModuleRow(
            device="x4m03",
            name="X4M03",
            settings=X4Settings,
            order_codes=("X4", "XEP"),
            samplers_hz=(SAMPLE_RATE_HZ, SAMPLE_RATE_HZ),
            pulses=tuple(PULSES.values()),
            bundle="x4m03",
        ),
    )
}


def module_for(order_code: str) -> ModuleRow:
    """Return the row with the longest prefix of a module's order code."""
    code = order_code.strip().upper()
    prefixes = {prefix: row for row in MODULES.values() for prefix in row.order_codes}
    return prefixes[max(filter(code.startswith, prefixes), key=len)]


def pulse_bandwidth_hz(sample_rate_hz: float, carrier_hz: float) -> float:
    """Return the bandwidth at -10 dB, in hertz, of the pulse with this sampler and carrier.

    0 if no module in `MODULES` has both. For recordings that name these and not their bandwidth.

    >>> pulse_bandwidth_hz(41e9, 6.8e9) / 1e9
    2.3
    """
    near = [
        (abs(carrier_hz / own_hz - 1), width_hz)
        for row in MODULES.values()
        if (1 - _NEAR) * row.samplers_hz[0] <= sample_rate_hz <= (1 + _NEAR) * row.samplers_hz[1]
        for own_hz, width_hz in row.pulses
    ]
    off, found_hz = min(near, default=(1.0, 0.0))
    return found_hz if off <= _NEAR else 0.0


def module_of(settings: ModuleSettings) -> ModuleRow:
    """Return the row of a module that is told these settings."""
    return next(row for row in MODULES.values() if type(settings) is row.settings)


def settings_from_mapping(known: Mapping[str, Any]) -> ModuleSettings:
    """Return the settings that a recording or capture names; SettingsError if impossible."""
    classes = [row.settings for row in MODULES.values()]
    cls = max(classes, key=lambda c: len(c.__dataclass_fields__.keys() & known.keys()))
    return cls(**{name: known[name] for name in cls.__dataclass_fields__ if name in known})
