"""What the package offers beside its classes: a port, opened."""

from typing import TYPE_CHECKING

from x2radar.device.device import X2Radar
from x2radar.device.reconnect import ReconnectingRadar
from x2radar.modules.base import ModuleSettings
from x2radar.ports import parse_port
from x2radar.radars import make_radar

if TYPE_CHECKING:
    from x2radar.device.aio import AsyncRadar


def open(  # noqa: A001 - x2radar.open reads as the file of a radar
    port: str, settings: ModuleSettings | None = None, *, speed: float | None = 1.0
) -> X2Radar:
    """Open a radar and start its stream; return it, an iterable of frames to be closed.

    Parameters
    ----------
    port : str
        ``/dev/ttyACM0``, a pyserial URL, ``auto``, or ``sim:SCENE?seed=1``.
    settings : ModuleSettings, optional
        What to configure; otherwise what the port string asks for.
    speed : float or None
        For ``sim:``, scene seconds per real second; None is as fast as it is read.

    Raises
    ------
    X2RadarError
        If the port cannot be opened or the module does not obey.
    """
    radar = make_radar(parse_port(port), speed=speed, settings=settings)
    radar.open()
    return radar


def open_reconnecting(
    port: str,
    settings: ModuleSettings | None = None,
    *,
    speed: float | None = 1.0,
    wait: bool = False,
) -> ReconnectingRadar:
    """Return a radar that is opened again whenever it was lost; arguments as of `open`.

    It opens when its first item or frame is asked for; `wait` waits for a device that is absent
    at first, instead of raising. Raises X2RadarError if the port string makes no sense.
    """
    return ReconnectingRadar(
        make_radar(parse_port(port), speed=speed, settings=settings), wait=wait
    )


def open_async(
    port: str, settings: ModuleSettings | None = None, *, speed: float | None = 1.0
) -> "AsyncRadar":
    """Return a radar for ``async with`` and ``async for``; arguments as of `open`.

    It opens when the block is entered. Raises X2RadarError if the port string makes no sense.
    """
    # Late: asyncio takes a while to load, and most programs do without.
    from x2radar.device.aio import AsyncRadar  # noqa: PLC0415

    return AsyncRadar(make_radar(parse_port(port), speed=speed, settings=settings))
