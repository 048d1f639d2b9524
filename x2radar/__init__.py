"""Driver and simulated module for XeThru X2 ultra-wideband radars.

>>> import x2radar
>>> with x2radar.open("sim:human?seed=1") as radar:
...     frame = next(iter(radar))
>>> frame.samples.shape, frame.axis.kind
((768,), 'rf')

docs/reference/python.md shows the rest.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from x2radar.api import (
        open,  # noqa: A004 - x2radar.open reads as the file of a radar
        open_async,
        open_reconnecting,
    )
    from x2radar.arrays import read_frames, simulate
    from x2radar.device.device import RadarStats, X2Radar
    from x2radar.device.link import Deadlines
    from x2radar.device.reconnect import ReconnectingRadar, StreamEvent
    from x2radar.errors import X2RadarError
    from x2radar.frame import FastTimeAxis, Frame, StreamInfo
    from x2radar.modules.profile import ProfileSettings
    from x2radar.modules.x2 import RadarSettings
    from x2radar.modules.x4 import X4Settings
    from x2radar.recording.about import Overrides
    from x2radar.recording.blocks import BlockReader
    from x2radar.recording.registry import open_recording

_PLACES = {
    "api": ("open", "open_async", "open_reconnecting"),
    "arrays": ("read_frames", "simulate"),
    "device.device": ("RadarStats", "X2Radar"),
    "device.link": ("Deadlines",),
    "device.reconnect": ("ReconnectingRadar", "StreamEvent"),
    "errors": ("X2RadarError",),
    "frame": ("FastTimeAxis", "Frame", "StreamInfo"),
    "modules.profile": ("ProfileSettings",),
    "modules.x2": ("RadarSettings",),
    "modules.x4": ("X4Settings",),
    "recording.about": ("Overrides",),
    "recording.blocks": ("BlockReader",),
    "recording.registry": ("open_recording",),
}
"""Where the names of `__all__` are."""
__all__ = [
    "BlockReader",
    "Deadlines",
    "FastTimeAxis",
    "Frame",
    "Overrides",
    "ProfileSettings",
    "RadarSettings",
    "RadarStats",
    "ReconnectingRadar",
    "StreamEvent",
    "StreamInfo",
    "X2Radar",
    "X2RadarError",
    "X4Settings",
    "open",
    "open_async",
    "open_reconnecting",
    "open_recording",
    "read_frames",
    "simulate",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for, so that a command answers signals before numpy is loaded."""
    for place, names in _PLACES.items():
        if name in names:
            return getattr(import_module(f"x2radar.{place}"), name)
    raise AttributeError(f"module 'x2radar' has no attribute '{name}'")
