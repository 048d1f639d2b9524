"""What the package offers beside its classes: a port, opened; frames as one array."""

from collections.abc import Callable, Iterable
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from x2radar.device.device import X2Radar
from x2radar.device.reconnect import ReconnectingRadar
from x2radar.errors import RecordingError, SettingsError
from x2radar.frame import Frame, Samples, StreamInfo
from x2radar.modules.base import ModuleSettings
from x2radar.ports import named_port, parse_port
from x2radar.radars import make_radar
from x2radar.recording.about import SAMPLE_DTYPES
from x2radar.recording.registry import open_recording

if TYPE_CHECKING:
    from x2radar.device.aio import AsyncRadar


Watch = Callable[[int, int], object]
_LONGEST_S = 3600.0  # an hour of an X2's RF frames is 0.7 GB


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


def simulate(
    scene: str | Path,
    *,
    duration_s: float = 10.0,
    seed: int = 0,
    frame_rate_hz: float = 60.0,
    kind: str = "baseband",
    device: str = "x2raw",
) -> tuple[Samples, StreamInfo]:
    """Return the frames that a simulated module sends of a scene.

    Parameters
    ----------
    scene : str or Path
        Name of a built-in scene (``x2radar scenes`` lists them) or a YAML file.
    duration_s : float
        Seconds, up to an hour; scenes repeat.
    seed : int
        The same seed gives the same frames.
    frame_rate_hz : float
        Frames per second.
    kind : {'baseband', 'rf'}
        Complex baseband, or RF samples.
    device : str
        The module: ``x2raw``, ``x2m200`` or ``x4m03``.

    Returns
    -------
    samples : ndarray, shape (n, n_range), complex64 (baseband) or float32 (RF)
        Frames in order, in the module's own unit.
    stream : StreamInfo
        Axis and rate.

    Raises
    ------
    X2RadarError
        If there is no such scene, or a setting is none of the module's.

    Examples
    --------
    >>> samples, stream = simulate("human", duration_s=2, seed=1)
    >>> samples.shape, samples.dtype.name, stream.frame_rate_hz
    ((120, 768), 'complex64', 60.0)
    >>> round(float(stream.axis.range_m[-1]), 2)
    3.4
    """
    keys = f"seed={seed}&rate={frame_rate_hz!r}&kind={kind}&device={device}"
    return sent_by(f"{named_port('sim', scene)}?{keys}", duration_s, lambda _k, _n: None)


def sent_by(port: str, duration_s: float, watch: Watch) -> tuple[Samples, StreamInfo]:
    """Return what a port sends in `duration_s`, as fast as it does; `watch` gets k of n frames."""
    with make_radar(parse_port(port), speed=None) as radar:
        frames = radar.frames()
        first = next(frames)
        assert radar.stream is not None  # noqa: S101 - known with the first frame
        n = _frames_in(duration_s, radar.stream.frame_rate_hz)
        return _stacked(chain([first], frames), radar.stream, n, watch), radar.stream


def read_frames(
    path: str | Path, *, start_s: float = 0.0, duration_s: float | None = None
) -> tuple[Samples, StreamInfo]:
    """Return the frames of a recording of any known format.

    Parameters
    ----------
    path : str or Path
        As `x2radar.open_recording` takes it.
    start_s : float
        Seconds of the recording that are left out at its beginning.
    duration_s : float, optional
        Seconds to read, up to an hour; all of it otherwise. It ends where the module restarted.

    Returns
    -------
    samples : ndarray, shape (n, n_range), complex64 or float32
        A row a frame period; the rows of lost frames are NaN.
    stream : StreamInfo
        Axis and rate.

    Raises
    ------
    X2RadarError
        If the recording cannot be read, or has no frame there.

    Examples
    --------
    >>> import numpy as np
    >>> rows = np.ones((100, 8), np.complex64)
    >>> np.savez("ones.npz", samples=rows, frame_rate_hz=50.0, bin_length_m=0.05,
    ...          carrier_hz=7.29e9, counter=np.r_[1:61, 63:103])
    >>> samples, stream = read_frames("ones.npz", start_s=1.0)
    >>> samples.shape, np.flatnonzero(np.isnan(samples[:, 0])).tolist()
    ((52, 8), [10, 11])
    """
    with open_recording(path) as recording:
        stream = recording.stream
        n = _frames_in(_LONGEST_S if duration_s is None else duration_s, stream.frame_rate_hz)
        samples = _stacked(recording.frames(start_s), stream, n)
    if not len(samples):
        raise RecordingError(f"{path}: no frame at or behind {start_s:g} s")
    return samples, stream


def _frames_in(duration_s: float, frame_rate_hz: float) -> int:
    if not 0 < duration_s <= _LONGEST_S:
        msg = f"duration_s {duration_s:g}: must be above 0 and at most {_LONGEST_S:g}"
        raise SettingsError(msg)
    return max(1, round(duration_s * frame_rate_hz))


def _stacked(
    frames: Iterable[Frame], stream: StreamInfo, n: int, watch: Watch = lambda _k, _n: None
) -> Samples:
    """Return at most `n` rows of one run; NaN where a frame is missing."""
    rows: list[Frame] = []
    for frame in frames:
        if rows and (frame.restarted or frame.index - rows[0].index >= n):
            break
        rows.append(frame)
        watch(frame.index - rows[0].index + 1, n)
        if frame.index - rows[0].index == n - 1:
            break
    n_rows = rows[-1].index - rows[0].index + 1 if rows else 0
    dtype = SAMPLE_DTYPES[stream.axis.kind]
    made: NDArray[Any] = np.full((n_rows, stream.axis.n_range), np.nan, dtype)
    for frame in rows:
        made[frame.index - rows[0].index] = frame.samples
    return made
