"""Driver and simulated module for XeThru X2 ultra-wideband radars.

>>> import x2radar
>>> with x2radar.open("sim:human?seed=1") as radar:
...     frame = next(iter(radar))
>>> frame.samples.shape, frame.axis.kind
((768,), 'rf')

docs/reference/python.md shows the rest.
"""

from importlib import import_module

TYPE_CHECKING = False  # as typing has it, which takes longer to load than a signal should wait
if TYPE_CHECKING:
    from typing import Any

    from x2radar.api import open as open  # noqa: A004 - x2radar.open reads as the file of a radar
    from x2radar.api import open_async as open_async
    from x2radar.api import open_reconnecting as open_reconnecting
    from x2radar.api import read_frames as read_frames
    from x2radar.api import simulate as simulate
    from x2radar.device.device import RadarStats as RadarStats
    from x2radar.device.device import X2Radar as X2Radar
    from x2radar.device.link import Deadlines as Deadlines
    from x2radar.device.reconnect import ReconnectingRadar as ReconnectingRadar
    from x2radar.device.reconnect import StreamEvent as StreamEvent
    from x2radar.errors import X2RadarError as X2RadarError
    from x2radar.frame import FastTimeAxis as FastTimeAxis
    from x2radar.frame import Frame as Frame
    from x2radar.frame import StreamInfo as StreamInfo
    from x2radar.modules.profile import ProfileSettings as ProfileSettings
    from x2radar.modules.x2 import RadarSettings as RadarSettings
    from x2radar.modules.x4 import X4Settings as X4Settings
    from x2radar.recording.about import Overrides as Overrides
    from x2radar.recording.blocks import BlockReader as BlockReader
    from x2radar.recording.registry import open_recording as open_recording

_PLACES = {
    "api": ("open", "open_async", "open_reconnecting", "read_frames", "simulate"),
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
"""The names that are offered here, by module."""
__all__ = sorted(name for names in _PLACES.values() for name in names)  # noqa: PLE0605 - above


def __getattr__(name: str) -> "Any":
    """Import what is asked for, so that a command answers signals before numpy is loaded."""
    for place, names in _PLACES.items():
        if name in names:
            return getattr(import_module(f"x2radar.{place}"), name)
    raise AttributeError(f"module 'x2radar' has no attribute '{name}'")
