"""Settings of any module: which class they are, from a mapping, from a module's own name."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from x2radar.settings.profile import ProfileSettings
from x2radar.settings.x2 import RadarSettings
from x2radar.settings.x4 import X4Settings

ModuleSettings = RadarSettings | X4Settings | ProfileSettings
"""Settings of any module that the device class can stream from."""

SettingsChooser = Callable[[str], ModuleSettings]
"""Gives the settings for a module by its order code, which is empty when it tells none."""

_CLASSES: tuple[type[ModuleSettings], ...] = (RadarSettings, X4Settings, ProfileSettings)


def settings_from_mapping(known: Mapping[str, Any]) -> ModuleSettings:
    """Return the settings that a recording or capture names.

    Parameters
    ----------
    known : mapping
        As `dataclasses.asdict` gives it; names of later versions are left out.

    Returns
    -------
    RadarSettings, X4Settings or ProfileSettings
        The class that most of the names belong to; RadarSettings for none.

    Raises
    ------
    SettingsError
        If a value is out of range.
    """
    fields = {cls: {f.name for f in dataclasses.fields(cls)} & known.keys() for cls in _CLASSES}
    cls = max(_CLASSES, key=lambda c: len(fields[c]))
    return cls(**{name: known[name] for name in fields[cls]})


def is_x4(order_code: str) -> bool:
    """Say whether a module's order code names one with an X4 chip."""
    return order_code.strip().upper().startswith(("X4", "XEP"))
