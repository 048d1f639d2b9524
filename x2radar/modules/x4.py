"""What an X4 module (X4M03, XEP firmware) is told before it streams.

The same protocol and the same device class as for the X2, other commands. The formula of the
highest frame rate follows the X4 user guide (XTAN-13); limits that no document gives are
inferred (docs/research/hardware.md). A module rounds frame rate and area to its own grid.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis, Kind
from x2radar.keys import Key, limited, one_of
from x2radar.modules.base import ModuleSettings
from x2radar.wire.messages import Message, SetMode, X4Init, X4Set
from x2radar.wire.wire_ids import Mode, X4Setting

SAMPLE_RATE_HZ = 23.328e9
_BASEBAND_STEP = 8
_PRF_SOURCE_HZ = 243e6
_DUTY = 0.95
"""Sampler, decimation, pulse source and share of a frame that the sweep may take (XTAN-13)."""

_DEFAULT_ITERATIONS = 64
"""Two thirds of what 60 Hz has room for."""

PULSES = {3: (7.29e9, 1.4e9), 4: (8.748e9, 1.5e9)}
"""Centre frequency and bandwidth at -10 dB, in hertz, by the driver's code."""
_SPAN_M = 1536 * SPEED_OF_LIGHT_MPS / (2 * SAMPLE_RATE_HZ)
"""The chip's 1536 samples, in metres."""

X4_FIELDS: Mapping[int, tuple[str, ...]] = {
    X4Setting.DOWN_CONVERSION: ("is_baseband",),
    X4Setting.TX_CENTRE_FREQUENCY: ("centre_frequency",),
    X4Setting.PRF_DIV: ("prf_divider",),
    X4Setting.ITERATIONS: ("iterations",),
    X4Setting.PULSES_PER_STEP: ("pulses_per_step",),
    X4Setting.DAC_STEP: ("dac_step",),
    X4Setting.DAC_MIN: ("dac_min",),
    X4Setting.DAC_MAX: ("dac_max",),
    X4Setting.FRAME_AREA_OFFSET: ("area_offset_m",),
    X4Setting.FRAME_AREA: ("area_start_m", "area_end_m"),
}
"""Which setting is which fields, in the order in which a module is told."""

_LOWEST_HZ = 0.01  # no document gives one; a frame every 100 s is of no use


@dataclass(frozen=True, slots=True, kw_only=True)
class X4Settings(ModuleSettings):
    """Settings of an X4 module that streams frames itself; the sweep must fit into a frame."""

    frame_rate_hz: float = limited(60.0, _LOWEST_HZ, 1000, "frames per second")
    area_start_m: float = limited(0.4, -1, 10, "range of the frame's begin")
    area_end_m: float = limited(5.0, -1, 20, "its end: at most the chip's 1536 samples behind")
    area_offset_m: float = limited(0.18, -1, 1, "range of the antenna's own delay")
    is_baseband: bool = one_of(True, (True, False), "mix down, keep every eighth sample; else RF")
    centre_frequency: int = one_of(3, tuple(PULSES), "3: 7.29 GHz, 4: 8.748 GHz")
    dac_min: int = limited(949, 0, 2047, "threshold sweep, in counts of 11 bits", is_whole=True)
    dac_max: int = limited(1100, 0, 2047, "the same", is_whole=True)
    dac_step: int = limited(1, 1, 255, "the same; the step's code is inferred", is_whole=True)
    pulses_per_step: int = limited(16, 1, 65535, "integrated at each threshold", is_whole=True)
    iterations: int = limited(_DEFAULT_ITERATIONS, 1, 255, "sweeps summed", is_whole=True)
    prf_divider: int = limited(16, 6, 255, "pulse rate = 243 MHz / divider", is_whole=True)

    def faults_together(self) -> Iterator[str]:
        """Yield what is wrong with area, sweep and frame rate together."""
        span_m = self.area_end_m - self.area_start_m
        if not 0 < span_m <= _SPAN_M:
            yield (
                f"area_end_m = {self.area_end_m:g}: must be above area_start_m, at most "
                f"{_SPAN_M:.2f} m behind it"
            )
        if self.dac_max <= self.dac_min:
            yield f"dac_max = {self.dac_max}: must be above dac_min = {self.dac_min}"
        elif self.frame_rate_hz > self.highest_frame_rate_hz:
            yield (
                f"frame_rate_hz = {self.frame_rate_hz:g}: iterations and pulses_per_step allow "
                f"{self.highest_frame_rate_hz:.1f}"
            )

    @classmethod
    def for_frame_rate(cls, frame_rate_hz: float, *, is_baseband: bool = True) -> "X4Settings":
        """Return settings that integrate as long as `frame_rate_hz` allows.

        Fewer iterations, then fewer pulses, where the sweep would not fit into a frame.
        """
        if Key(_LOWEST_HZ, 1000).fault(frame_rate_hz):
            return cls(frame_rate_hz=frame_rate_hz)
        most, slow = 0, cls(frame_rate_hz=_LOWEST_HZ, is_baseband=is_baseband, iterations=1)
        for pulses in (16, 8, 4):
            slow = replace(slow, pulses_per_step=pulses)
            most = int(slow.highest_frame_rate_hz / frame_rate_hz)
            if most >= 16:
                break
        most = min(_DEFAULT_ITERATIONS, most)
        return replace(slow, frame_rate_hz=frame_rate_hz, iterations=most)

    @classmethod
    def for_port(cls, rate_hz: float | None, kind: str | None) -> "X4Settings":
        """Return settings for the keys of a port: 60 Hz and baseband unless they say otherwise."""
        rate_hz = 60.0 if rate_hz is None else rate_hz
        return cls.for_frame_rate(rate_hz, is_baseband=kind != "rf")

    def startup_commands(self) -> tuple[Message, ...]:
        """Return what a freshly reset module is told; the frame rate, last, starts the stream."""
        told = (X4Set(k, tuple(getattr(self, f) for f in names)) for k, names in X4_FIELDS.items())
        return (
            SetMode(Mode.STOP),
            SetMode(Mode.MANUAL),
            X4Init(),
            *told,
            X4Set(X4Setting.FPS, (self.frame_rate_hz,)),
        )

    @property
    def highest_frame_rate_hz(self) -> float:
        """PRF D / (iterations pps (dac_max - dac_min + 1)), in hertz (XTAN-13).

        The guide's formula has no `dac_step`: a coarser sweep may allow more.
        """
        sweep = self.iterations * self.pulses_per_step * (self.dac_max - self.dac_min + 1)
        return _PRF_SOURCE_HZ / self.prf_divider * _DUTY / sweep

    @property
    def axis(self) -> FastTimeAxis:
        """Bins of 6.4 mm (RF) or 51.4 mm; both ends of the area have one (inferred)."""
        step = _BASEBAND_STEP if self.is_baseband else 1
        bin_length_m = step * SPEED_OF_LIGHT_MPS / (2 * SAMPLE_RATE_HZ)
        carrier_hz, bandwidth_hz = PULSES[self.centre_frequency]
        return FastTimeAxis(
            kind=self.raw_kind,
            n_range=int((self.area_end_m - self.area_start_m) / bin_length_m) + 1,
            bin_length_m=bin_length_m,
            range_offset_m=self.area_start_m,
            carrier_hz=carrier_hz,
            bandwidth_hz=bandwidth_hz,
            sample_rate_hz=SAMPLE_RATE_HZ,
        )

    @property
    def raw_kind(self) -> Kind:
        """What frames hold: RF, or half of them I and half Q; an X4 sends all of them raw."""
        return "baseband" if self.is_baseband else "rf"
