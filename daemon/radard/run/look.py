"""What `radard top` shows of a sensor: state, last records, outputs, and where something moved."""

from dataclasses import asdict
from typing import Any

import numpy as np

from radard.run.sensor import Sensor
from radard.stream.ring import FrameRing

_COLUMN_S = 0.25  # a ring holds some seventeen of them
_MAX_ROWS = 16  # of range: a third of a screen
_STEP_DB = 4.0  # from one level to the next; noise alone stays within the first
_MAX_LEVEL = 4


def look(sensor: Sensor) -> dict[str, Any]:
    """Return what holds at this moment, as JSON has it; for any thread."""
    state, ring = sensor.panel(), sensor.ring()
    return {
        "status": asdict(sensor.health.status),
        "panel": None if state is None else state.as_record(sensor.mark()),
        "records": sensor.recent,
        "outputs": [{"name": sink.name, **asdict(sink.state)} for sink in sensor.sinks()],
        "picture": None if ring is None else range_time(ring),
    }


def range_time(ring: FrameRing) -> dict[str, Any]:
    """Return where something moved: columns of digits 0 to 4, near to far, in steps of 4 dB."""
    recent, range_m = ring.recent(), ring.axis.range_m
    begin = recent.end_frame - len(recent.frames)
    stride = max(1, round(_COLUMN_S * ring.frame_rate_hz))
    first = -(-begin // stride)
    n = max(0, recent.end_frame // stride - first)
    told = {"first": first, "column_s": stride / ring.frame_rate_hz, "columns": []}
    told["range_m"] = [float(range_m[0]), float(range_m[-1])]
    if not n:
        return told
    moving = recent.frames - recent.frames.mean(axis=0)
    at = first * stride - begin
    power = (np.abs(moving[at : at + n * stride]) ** 2).reshape(n, stride, -1).mean(axis=1)
    n_rows = min(_MAX_ROWS, power.shape[1])
    rows = np.maximum.reduceat(power, np.arange(n_rows) * power.shape[1] // n_rows, axis=1)
    over_db = 10 * np.log10(np.maximum(rows, 1e-300) / max(float(np.median(power)), 1e-300))
    levels = np.clip(over_db // _STEP_DB, 0, _MAX_LEVEL).astype(int)
    return {**told, "columns": ["".join(map(str, column)) for column in levels.tolist()]}
