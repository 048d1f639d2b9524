"""What the package offers beside its classes: a port or a recording, opened.

`import x2radar` has these functions; nothing is imported before one of them is asked for.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from x2radar.device.device import X2Radar
from x2radar.device.reconnect import ReconnectingRadar
from x2radar.modules.base import ModuleSettings
from x2radar.ports import parse_port
from x2radar.radars import make_radar
from x2radar.recording.about import NO_OVERRIDES, Overrides
from x2radar.recording.blocks import BlockReader

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


def open_recording(
    path: str | Path | Sequence[str | Path],
    *,
    kind: str | None = None,
    overrides: Overrides = NO_OVERRIDES,
) -> BlockReader:
    """Open a recording of any known format; return a reader of its frames, to be closed.

    Parameters
    ----------
    path : str, Path or a sequence of them
        A file, a XeThru folder, or the folder, the name or the list of an HDF5 recording's parts.
    kind : str, optional
        Name of the format (``hdf5``, ``npz`` ...), instead of looking.
    overrides : Overrides
        Rate and axis, where the recording is silent or wrong.

    Raises
    ------
    X2RadarError
        RecordingError if nothing readable is there; one line that says what.

    Examples
    --------
    Nothing in a file is trusted or executed; a NumPy archive of noise will do:

    >>> import numpy as np
    >>> rows = np.random.default_rng(1).standard_normal((180, 64)).astype(np.float32)
    >>> np.savez("noise.npz", samples=rows)
    >>> about = Overrides(frame_rate_hz=60, bin_length_m=0.05, carrier_hz=6.8e9)
    >>> with open_recording("noise.npz", overrides=about) as recording:
    ...     frames = list(recording.frames(start_s=1.0))
    >>> recording.n_frames, len(frames), frames[0].index
    (180, 120, 60)
    """
    # Late: the readers behind it are slow to import.
    from x2radar.recording import registry  # noqa: PLC0415

    return registry.open_recording(path, kind=kind, overrides=overrides)


def open_async(
    port: str, settings: ModuleSettings | None = None, *, speed: float | None = 1.0
) -> "AsyncRadar":
    """Return a radar for ``async with`` and ``async for``; arguments as of `open`.

    It opens when the block is entered. Raises X2RadarError if the port string makes no sense.
    """
    # Late: asyncio takes a while to load, and most programs do without.
    from x2radar.device.aio import AsyncRadar  # noqa: PLC0415

    return AsyncRadar(make_radar(parse_port(port), speed=speed, settings=settings))
