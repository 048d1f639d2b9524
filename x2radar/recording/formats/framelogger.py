"""Flat Earth's FrameLogger: raw counters of an X2, little-endian, no index.

Layout (decoded from real files, which it consumes to the last byte)::

    u32 0xFEFE00A2, i32 iterations, pulses per step, DAC min, DAC max, DAC step,
    radar type (2: X2), f32 samples per second, i32 PGSelect, f32 offset, f32 sample delay,
    i32 samplers, frames, runs, frames per second, f64 time[frames],
    u32 counter[frames][samplers], f32 frame-rate estimate

A counter becomes the module's unit, 0 to 100, as
``(counter / (pulses * iterations) * step + min) * 100 / 8192``. The logger wrote garbage as
samples per second; 39 GS/s is assumed then and said. The offset is taken as the range of the
first sample in metres. Frames are not counted: counters are made of the times. Written samples
are exact when they came from these settings; else they move by half a count at most.
"""

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SettingsError
from x2radar.frame import SPEED_OF_LIGHT_MPS, Samples, count_by_stamps
from x2radar.modules.x2 import PULSE_GENERATORS
from x2radar.recording.about import MAX_BINS, NO_OVERRIDES, Overrides
from x2radar.recording.blocks import BlockReader
from x2radar.recording.faults import refuse

_MAGIC = 0xFEFE00A2
_ASSUMED_SAMPLE_RATE_HZ = 39e9  # a user's figure of an X2's sampler (docs/research/hardware.md)

_HEAD = struct.Struct("<I6ifi2f4i")
_X2 = 2
_DAC_LEVELS = 8192
_MAX_PULSES = 1 << 16  # of a sweep that is unknown: finer than float32 resolves


class _Sweep(NamedTuple):
    iterations: int
    pulses_per_step: int
    dac_min: int
    dac_max: int
    dac_step: int

    @property
    def is_sound(self) -> bool:
        return min(self.iterations, self.pulses_per_step, self.dac_step) > 0 and self.dac_min >= 0

    def unit(self, counter: NDArray[np.uint32]) -> NDArray[np.float32]:
        """Return raw counters in the module's unit, 0 to 100."""
        scale = self.dac_step / (self.pulses_per_step * self.iterations)
        value = (counter * scale + self.dac_min) * (100 / _DAC_LEVELS)
        return value.astype(np.float32)

    def counter(self, unit: NDArray[Any]) -> NDArray[np.float64]:
        """Return what `unit` was made of, rounded."""
        value = np.asarray(unit, np.float64) * (_DAC_LEVELS / 100) - self.dac_min
        return np.rint(value * (self.pulses_per_step * self.iterations / self.dac_step))


class Reader(BlockReader):
    """Read a FrameLogger file of an X2; its settings are named as in `RadarSettings`."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        super().__init__(path, overrides)
        with path.open("rb") as file:
            head = file.read(_HEAD.size)
        size = path.stat().st_size
        if len(head) < _HEAD.size or head[:4] != _MAGIC.to_bytes(4, "little"):
            raise refuse(path, "not a FrameLogger file")
        numbers = _HEAD.unpack(head)
        self._sweep = _Sweep(*numbers[1:6])
        radar, sample_rate_hz, pg_select, offset_m, delay_s = numbers[6:11]
        n_range, self.n_frames, _, fps = numbers[11:]
        if radar != _X2:
            raise refuse(path, f"radar type {radar}: only X2 files (type 2) are read")
        if not (0 < n_range <= MAX_BINS and self.n_frames > 0 and self._sweep.is_sound):
            raise refuse(path, f"{self.n_frames} frames of {n_range} samples: damaged")
        at = _HEAD.size + 8 * self.n_frames
        if size < at + 4 * n_range * self.n_frames:
            raise refuse(path, "cut off")
        stamps = np.fromfile(path, "<f8", self.n_frames, offset=_HEAD.size)
        self._rows = np.memmap(path, "<u4", "r", offset=at, shape=(self.n_frames, n_range))
        if (rest := size - at - 4 * n_range * self.n_frames - 4) > 0:
            self._warn(f"{rest} bytes behind the frames, which are left out")
        self._counter, rate_hz = self._rate(stamps, float(fps))
        settings = self._sweep._asdict()
        settings |= {"pulse_generator": pg_select, "sample_delay_s": delay_s}
        said = self._axis(sample_rate_hz, pg_select, offset_m)
        said |= {"frame_rate_hz": rate_hz, "settings": settings}
        self._keep(("rf", n_range), said, "FrameLogger recording of an X2")

    def read_samples(self, first: int, last: int) -> Samples:
        return self._falling(self._sweep.unit(self._rows[first:last]))

    def _axis(self, sample_rate_hz: float, pg_select: int, offset_m: float) -> dict[str, Any]:
        known = self._overrides
        if not 1e9 <= sample_rate_hz <= 1e11:
            if known.sample_rate_hz is None and known.bin_length_m is None:
                why = "is garbage; 39e9 is assumed (--sample-rate)"
                self._warn(f"{sample_rate_hz:.3g} samples per second {why}")
            sample_rate_hz = _ASSUMED_SAMPLE_RATE_HZ
        if not -10 < offset_m < 100:
            self._warn(f"an offset of {offset_m:.3g} m is garbage; 0 is assumed")
            offset_m = 0.0
        said = {
            "sample_rate_hz": sample_rate_hz,
            "bin_length_m": SPEED_OF_LIGHT_MPS / (2 * sample_rate_hz),
            "range_offset_m": offset_m,
        }
        if 0 <= pg_select < len(PULSE_GENERATORS):
            pulse = PULSE_GENERATORS[pg_select]
            said["carrier_hz"], said["bandwidth_hz"] = pulse.carrier_hz, pulse.bandwidth_hz
        return said

    def _rate(
        self, stamps: NDArray[np.float64], fps: float
    ) -> tuple[NDArray[np.uint32], float | None]:
        """Return counters and frame rate; the times' unit is the one that suits `fps`."""
        if stamps.size > 1:
            # Seconds first; other loggers of that house stamp in milliseconds or days.
            for unit_s in (1.0, 1e-3, 86_400.0):
                counted, period_s = count_by_stamps(stamps * unit_s)
                if np.isfinite(period_s) and (fps <= 0 or 0.5 < period_s * fps < 2):
                    return counted, 1 / period_s
        if fps > 0:
            self._warn(f"times without use; the nominal {fps:g} frames per second are taken")
        return np.arange(1, stamps.size + 1, dtype=np.uint32), fps if fps > 0 else None


def write(path: Path, source: BlockReader) -> list[str]:
    """Write RF `source`, in the module's unit, into a new file; return what was not kept."""
    axis = source.stream.axis
    if axis.kind != "rf":
        raise SettingsError(f"{path.name}: FrameLogger files hold RF frames, this is baseband")
    notes = ["counters are made of the times when it is read, from 1"]
    sweep = _sweep_of(source.settings)
    if sweep is None:
        sweep = _Sweep(_MAX_PULSES >> 4, 16, 0, _DAC_LEVELS - 1, 1)
        notes.append("the sweep is unknown: a fine one is written")
    pg_select, pulse = min(
        enumerate(PULSE_GENERATORS), key=lambda row: abs(row[1].carrier_hz - axis.carrier_hz)
    )
    if pulse.carrier_hz != axis.carrier_hz:
        notes.append(f"the carrier becomes {pulse.carrier_hz / 1e9:g} GHz, the nearest")
    sample_rate_hz = SPEED_OF_LIGHT_MPS / (2 * axis.bin_length_m)
    delay_s = source.settings.get("sample_delay_s", 2 * axis.range_offset_m / SPEED_OF_LIGHT_MPS)
    rate_hz = source.stream.frame_rate_hz
    worst = 0.0
    with path.open("wb") as file:
        file.write(
            _HEAD.pack(
                *(_MAGIC, *sweep, _X2, sample_rate_hz, pg_select, axis.range_offset_m),
                *(float(delay_s), axis.n_range, source.n_frames, 1, max(1, round(rate_hz))),
            )
        )
        file.write(source.lists()[1].astype("<f8").tobytes())
        for block in source.blocks():
            counter = sweep.counter(block.samples)
            if not (counter.min(initial=0) >= 0 and counter.max(initial=0) < 1 << 32):
                msg = (
                    f"{path.name}: samples outside 0 to 100, the X2's unit, cannot be raw counters"
                )
                raise SettingsError(msg)
            raw = counter.astype("<u4")
            file.write(raw.tobytes())
            worst = max(worst, float(np.abs(sweep.unit(raw) - block.samples).max(initial=0)))
        file.write(struct.pack("<f", rate_hz))
    if worst:
        notes.append(f"samples moved by up to {worst:.2g} to whole counts")
    return notes


def _sweep_of(settings: Mapping[str, Any]) -> _Sweep | None:
    try:
        sweep = _Sweep(*(int(settings[name]) for name in _Sweep._fields))
    except (KeyError, TypeError, ValueError):
        return None
    return sweep if sweep.is_sound else None
