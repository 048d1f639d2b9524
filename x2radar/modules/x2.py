"""What the X2 module is told before it streams: frozen, checked at construction."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis
from x2radar.keys import limited, one_of
from x2radar.modules.base import ModuleSettings
from x2radar.wire.messages import Message, SetMode, SetOutput, SetSysFloat, SetSysInt
from x2radar.wire.wire_ids import BasebandOutput, Mode, OutputRef, SysCfg

_SAMPLERS = 256
DAC_TOP = 8191
PRF_HZ = 100e6
"""Samplers, 13-bit threshold DAC and pulse rate of the NVA6201, the chip of these modules."""


class PulseGenerator(NamedTuple):
    """One row of the X2's PGSelect table (NVA6201 data: protocol notes, section 5)."""

    carrier_hz: float
    bandwidth_hz: float


_CARRIERS_GHZ = (5.3, 5.4, 5.7, 6.1, 6.4, 6.8, 7.3, 7.7, 7.8, 8.2, 8.8, 9.1)
_BANDWIDTHS_GHZ = (1.75, 1.80, 1.85, 2.05, 2.15, 2.30, 2.35, 2.50, 2.50, 2.65, 3.10, 3.10)
PULSE_GENERATORS: tuple[PulseGenerator, ...] = tuple(
    PulseGenerator(fc * 1e9, bw * 1e9)
    for fc, bw in zip(_CARRIERS_GHZ, _BANDWIDTHS_GHZ, strict=True)
)

SYS_FIELDS: Mapping[SysCfg, str] = {
    SysCfg.PG_SELECT: "pulse_generator",
    SysCfg.FRAME_STITCH: "frame_stitch",
    SysCfg.DAC_MIN: "dac_min",
    SysCfg.DAC_MAX: "dac_max",
    SysCfg.DAC_STEP: "dac_step",
    SysCfg.PULSES_PER_STEP: "pulses_per_step",
    SysCfg.ITERATIONS: "iterations",
    SysCfg.FPS: "frame_rate_hz",
    SysCfg.SAMPLE_DELAY: "sample_delay_s",
}
"""What SYSCFG sets which field, in the order in which a module is told."""

OUTPUTS: Mapping[str, BasebandOutput] = {
    "rf": BasebandOutput.OFF,
    "iq": BasebandOutput.IQ,
    "ap": BasebandOutput.AMPLITUDE_PHASE,
}
"""What `output` is on the wire; amplitude or phase alone make no frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RadarSettings(ModuleSettings):
    """Settings of an X2 module in MANUAL mode; the sweep must fit into a frame."""

    frame_rate_hz: float = limited(60.0, 1, 1000, "of the whole, stitched frame", is_whole=True)
    frame_stitch: int = limited(
        3, 1, 5, "offsets joined into one frame of 256 times as many samples", is_whole=True
    )
    pulse_generator: int = limited(
        5, 0, len(PULSE_GENERATORS) - 1, "row of `PULSE_GENERATORS`; 5: 6.8 GHz", is_whole=True
    )
    sample_delay_s: float = limited(4e-9, 0, 200e-9, "of the first sample behind the pulse")
    dac_min: int = limited(0, 0, DAC_TOP, "threshold sweep, in counts", is_whole=True)
    dac_max: int = limited(DAC_TOP, 0, DAC_TOP, "the same", is_whole=True)
    dac_step: int = limited(4, 1, 1024, "the same", is_whole=True)
    pulses_per_step: int = limited(16, 1, 65535, "integrated at each threshold", is_whole=True)
    iterations: int = limited(16, 1, 65535, "sweeps summed", is_whole=True)
    sample_rate_hz: float = limited(41e9, 1e9, 100e9, "of this chip, which cannot be asked for it")
    """It differs from chip to chip, from 38 to 41 GS/s."""
    output: str = one_of("rf", tuple(OUTPUTS), "RF, or baseband: I/Q, or amplitude/phase")

    def faults_together(self) -> Iterator[str]:
        """Yield what is wrong with the sweep's limits, and with its time in a frame's."""
        if self.dac_max <= self.dac_min:
            yield f"dac_max = {self.dac_max}: must be above dac_min = {self.dac_min}"
        elif self.sweep_s * self.frame_rate_hz > 1:
            most = int(PRF_HZ / (self.frame_rate_hz * self.frame_stitch * self.n_steps))
            yield (
                f"iterations x pulses_per_step = {self.iterations * self.pulses_per_step}: "
                f"one frame would take {self.sweep_s * 1e3:.1f} ms; at "
                f"{self.frame_rate_hz:g} Hz at most {most} fit"
            )

    @classmethod
    def for_frame_rate(cls, frame_rate_hz: float, *, output: str = "rf") -> "RadarSettings":
        """Return settings that integrate as long as `frame_rate_hz` allows.

        One iteration of the usual sweep fits into a frame at 1000 Hz, 64 are the most.
        """
        most = PRF_HZ / (min(max(1, frame_rate_hz), 1000) * 3 * math.ceil((DAC_TOP + 1) / 4) * 16)
        return cls(frame_rate_hz=frame_rate_hz, iterations=min(64, int(most)), output=output)

    @classmethod
    def for_port(cls, rate_hz: float | None, kind: str | None) -> "RadarSettings":
        """Return settings for the keys of a port: 60 Hz and RF unless they say otherwise."""
        output = "iq" if kind == "baseband" else "rf"
        return cls.for_frame_rate(60.0 if rate_hz is None else rate_hz, output=output)

    def startup_commands(self) -> tuple[Message, ...]:
        """Return what a freshly reset module is told: radar settings, output, MANUAL mode."""
        values = {ref: getattr(self, name) for ref, name in SYS_FIELDS.items()}
        delay_s = values.pop(SysCfg.SAMPLE_DELAY)
        return (
            SetMode(Mode.IDLE),
            *(SetSysInt(ref, int(value)) for ref, value in values.items()),
            SetSysFloat(SysCfg.SAMPLE_DELAY, delay_s),
            SetOutput(OutputRef.BASEBAND, OUTPUTS[self.output]),
            SetMode(Mode.MANUAL),
        )

    @property
    def axis(self) -> FastTimeAxis:
        """RF samples of c / (2 fs), from c ts / 2 on; those of baseband follow in its messages."""
        pulse = PULSE_GENERATORS[self.pulse_generator]
        return FastTimeAxis(
            kind="rf" if self.output == "rf" else "baseband",
            n_range=_SAMPLERS * self.frame_stitch,
            bin_length_m=SPEED_OF_LIGHT_MPS / (2 * self.sample_rate_hz),
            range_offset_m=SPEED_OF_LIGHT_MPS * self.sample_delay_s / 2,
            carrier_hz=pulse.carrier_hz,
            bandwidth_hz=pulse.bandwidth_hz,
            sample_rate_hz=self.sample_rate_hz,
        )

    @property
    def n_steps(self) -> int:
        """Number of thresholds in one sweep."""
        return math.ceil((self.dac_max - self.dac_min + 1) / self.dac_step)

    @property
    def sweep_s(self) -> float:
        """Time of the threshold sweeps of one stitched frame, in seconds."""
        pulses = self.n_steps * self.pulses_per_step * self.iterations * self.frame_stitch
        return pulses / PRF_HZ
