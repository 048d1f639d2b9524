"""What a recording says about itself: the same attributes, read and written, in every format.

They are named as in `FastTimeAxis` and `StreamInfo`, with format, format_version, started_utc,
device and settings (JSON) beside them; `x2radar.recording.hdf5_reader` lists them.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from x2radar.frame import SPEED_OF_LIGHT_MPS, Kind, StreamInfo
from x2radar.modules.modules import pulse_bandwidth_hz
from x2radar.recording.faults import refuse

FORMAT = "x2radar-recording"
VERSION = 1
VERSIONS = (f"{VERSION}", f"{VERSION}.0")
SAMPLE_DTYPES: dict[str, type[np.float32 | np.complex64]] = {
    "rf": np.float32,
    "baseband": np.complex64,
}
Row = tuple[Kind, int]
"""Kind and bins of a frame."""
MAX_BINS = 1 << 14  # above these a file is damaged: ten times the bins of any module

BOUNDS = {"frame_rate_hz": (1e-3, 1e6), "bin_length_m": (1e-6, 1e3), "carrier_hz": (1.0, 1e15)}
BOUNDS |= {"range_offset_m": (-1e6, 1e6)}
"""Beyond these a file is damaged, likewise."""
NUMBERS = (*BOUNDS, "sample_rate_hz", "bandwidth_hz", "phase_sign")
ATTRIBUTES = ("format_version", *NUMBERS, "kind", "started_utc", "device", "settings", "run_id")
"""What a recording says about itself, beside its format."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Overrides:
    """What the user knows better than the file; None leaves the file's value.

    Names as in `FastTimeAxis` and `StreamInfo`. A sample rate alone also sets the bin length of
    RF frames, c / (2 fs).
    """

    frame_rate_hz: float | None = None
    bin_length_m: float | None = None
    range_offset_m: float | None = None
    carrier_hz: float | None = None
    bandwidth_hz: float | None = None
    sample_rate_hz: float | None = None

    def apply(self, stream: StreamInfo) -> StreamInfo:
        """Return `stream` with what is set here, or else the bandwidth of a known module."""
        known = {name: value for name, value in asdict(self).items() if value is not None}
        rate_hz = known.pop("frame_rate_hz", None) or stream.frame_rate_hz
        if self.sample_rate_hz and stream.axis.kind == "rf":
            known.setdefault("bin_length_m", SPEED_OF_LIGHT_MPS / (2 * self.sample_rate_hz))
        axis = replace(stream.axis, **known)
        if not axis.bandwidth_hz:
            band_hz = pulse_bandwidth_hz(axis.sample_rate_hz, axis.carrier_hz)
            axis = replace(axis, bandwidth_hz=band_hz)
        return replace(stream, axis=axis, frame_rate_hz=rate_hz)


NO_OVERRIDES = Overrides()


def option_of(name: str) -> str:
    """Return how a user gives a field of `Overrides`: --frame-rate for frame_rate_hz."""
    return "--" + name.rpartition("_")[0].replace("_", "-")


def kind_of(path: object, shape: tuple[int, ...], dtype: np.dtype[Any]) -> Row:
    """Return kind and n_range of samples; raise RecordingError if they are no frames."""
    if dtype.kind not in "ciuf":
        raise refuse(path, f"no frames: samples are {dtype}")
    if len(shape) != 2 or shape[0] < 0 or not 0 < shape[1] <= MAX_BINS:
        raise refuse(path, f"samples have the shape {shape}, not (n, n_range)")
    if shape[0] == 0:
        raise refuse(path, "no frames in it")
    return ("baseband" if dtype.kind == "c" else "rf"), shape[1]


def root_attributes(
    stream: StreamInfo, started_utc: str, device: Mapping[str, Any], settings: Mapping[str, Any]
) -> dict[str, Any]:
    """Return what a recording says about itself, JSON as text."""
    axis = asdict(stream.axis)
    del axis["n_range"]
    return {
        "format": FORMAT,
        "format_version": VERSION,
        **axis,
        "frame_rate_hz": stream.frame_rate_hz,
        "started_utc": started_utc,
        "device": json.dumps(dict(device), default=str),
        "settings": json.dumps(dict(settings), default=str),
        **({"run_id": stream.run_id} if stream.run_id else {}),
    }


def plain(value: Any) -> Any:
    """Return an array of one value as that value, and bytes as text."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.item() if value.size == 1 else value.tolist()
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def number(path: object, name: str, value: Any) -> float:
    """Return an attribute as a number, 0 if there is none; RecordingError if it is none."""
    if value is None:
        return 0.0
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise refuse(path, f"'{name}' is {value!r}, not a number")
    return number


def mapping(value: Any) -> Mapping[str, Any]:
    """Return a mapping, or one in JSON; a text in JSON is the name of a device."""
    try:
        value = json.loads(value) if isinstance(value, str) else value
    except ValueError:
        return {}
    if isinstance(value, str):
        return {"name": value}
    return value if isinstance(value, dict) else {}
