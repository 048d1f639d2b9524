"""Driver and simulated module for XeThru X2 ultra-wideband radars.

>>> import x2radar
>>> with x2radar.open("sim:human?seed=1") as radar:
...     frame = next(radar.frames())
>>> frame.samples.shape, frame.axis.kind
((768,), 'rf')
"""

from x2radar.device import Deadlines, X2Radar
from x2radar.errors import X2RadarError
from x2radar.frame import FastTimeAxis, Frame, StreamInfo
from x2radar.ports import make_radar, parse_port
from x2radar.settings import RadarSettings
from x2radar.settings_x4 import ModuleSettings, X4Settings

__all__ = [
    "Deadlines",
    "FastTimeAxis",
    "Frame",
    "RadarSettings",
    "StreamInfo",
    "X2Radar",
    "X2RadarError",
    "X4Settings",
    "open",
]


def open(  # noqa: A001 - x2radar.open reads as the file of a radar
    port: str, settings: ModuleSettings | None = None, *, speed: float | None = 1.0
) -> X2Radar:
    """Open a radar and start its stream.

    Parameters
    ----------
    port : str
        ``/dev/ttyACM0``, a pyserial URL, or ``sim:SCENE?seed=1``.
    settings : RadarSettings or X4Settings, optional
        What to configure; otherwise what the port string asks for.
    speed : float or None
        For ``sim:``, scene seconds per real second; None is as fast as it is read.

    Returns
    -------
    X2Radar
        Streaming; a context manager.

    Raises
    ------
    X2RadarError
        If the port cannot be opened or the module does not obey.
    """
    radar = make_radar(parse_port(port), speed=speed, settings=settings)
    radar.open()
    return radar
