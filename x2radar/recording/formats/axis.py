"""From attributes of a foreign file, as far as there are any, to a stream."""

import math
from collections.abc import Mapping
from typing import Any

from x2radar.frame import FastTimeAxis, StreamInfo
from x2radar.recording.blocks import Overrides, refuse

_NEEDED = {
    "frame_rate_hz": "--frame-rate",
    "bin_length_m": "--bin-length",
    "carrier_hz": "--carrier",
}
_REST = ("range_offset_m", "bandwidth_hz", "sample_rate_hz")


def stream_from(
    path: object,
    shape: tuple[str, int],
    attributes: Mapping[str, Any],
    overrides: Overrides,
    device: str,
) -> StreamInfo:
    """Return the stream that `attributes`, then `overrides`, describe; `shape` is (kind, n_range).

    Attributes are named as in `FastTimeAxis` and `StreamInfo`; None counts as missing. Raises
    RecordingError if frame rate, bin length or carrier is in neither; it names the options.
    """
    kind, n_range = shape
    numbers = {}
    for name in (*_NEEDED, *_REST):
        number = _number(path, name, attributes.get(name))
        numbers[name] = number if name in _REST else max(number, 0.0)
    axis = FastTimeAxis(
        kind="baseband" if kind == "baseband" else "rf",
        n_range=n_range,
        bin_length_m=numbers["bin_length_m"],
        range_offset_m=numbers["range_offset_m"],
        carrier_hz=numbers["carrier_hz"],
        bandwidth_hz=numbers["bandwidth_hz"],
        sample_rate_hz=numbers["sample_rate_hz"],
    )
    run_id = str(attributes.get("run_id") or "")
    stream = overrides.apply(StreamInfo(axis, numbers["frame_rate_hz"], device, run_id))
    known = {
        "frame_rate_hz": stream.frame_rate_hz,
        "bin_length_m": stream.axis.bin_length_m,
        "carrier_hz": stream.axis.carrier_hz,
    }
    missing = [option for name, option in _NEEDED.items() if not known[name] > 0]
    if missing:
        raise refuse(path, f"does not say everything; convert it with {', '.join(missing)}")
    return stream


def _number(path: object, name: str, value: Any) -> float:
    if value is None:
        return 0.0
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise refuse(path, f"'{name}' is {value!r}, not a number")
    return number
