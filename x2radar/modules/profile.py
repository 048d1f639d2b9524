"""What an X2M200 or X2M300 is told before one of its profiles streams baseband.

A profile runs at a fixed 20 Hz, where Doppler holds 0.2 m/s at most: enough to breathe, not for
gait (`RadarSettings`). Facts from XTAN-11 rev C and clients of real modules
(docs/research/hardware.md).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from x2radar.errors import SettingsError
from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis
from x2radar.keys import limited, one_of
from x2radar.modules.base import ModuleSettings
from x2radar.modules.x2 import OUTPUTS, PULSE_GENERATORS
from x2radar.wire import messages as msg
from x2radar.wire.wire_ids import Led, Mode, OutputRef, Profile

_FRAME_RATE_HZ = 20.0
"""XTAN-11; measured 19.99."""

SAMPLE_RATE_HZ = 39e9
_DECIMATION = 10
_PULSE = PULSE_GENERATORS[6]
"""A user's figures of a real module, and the inferred pulse (docs/research/hardware.md)."""


PROFILES = {
    "respiration": (Profile.RESPIRATION, (0.5, 1.2)),
    "sleep": (Profile.SLEEP, (0.4, 2.0)),
    "presence": (Profile.PRESENCE, (0.5, 3.3)),
}
"""The profiles of these modules: id, and the zone that clients give it, in metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileSettings(ModuleSettings):
    """Settings of a module that runs a profile and sends its baseband besides."""

    profile: str = one_of("sleep", tuple(PROFILES), "row of `PROFILES`; presence is the X2M300's")
    zone_start_m: float = limited(0.4, 0.1, 10, "detection zone, which the module rounds")
    zone_end_m: float = limited(2.0, 0.1, 10, "the same")
    sensitivity: int = limited(9, 0, 9, "of the profile's own detection", is_whole=True)
    output: str = one_of("iq", ("iq", "ap"), "baseband as I/Q or amplitude/phase messages")
    led: int = limited(Led.OFF, 0, 3, "row of `wire_ids.Led`", is_whole=True)

    def faults_together(self) -> Iterator[str]:
        """Yield what is wrong with the zone's two ends together."""
        if self.zone_end_m <= self.zone_start_m:
            start = f"zone_start_m = {self.zone_start_m:g}"
            yield f"zone_end_m = {self.zone_end_m:g}: must be above {start}"

    @classmethod
    def for_port(cls, rate_hz: float | None, kind: str | None) -> "ProfileSettings":
        """Return settings for a port's keys; a profile has one rate and sends baseband only."""
        if rate_hz not in {None, _FRAME_RATE_HZ}:
            msg = f"port key 'rate': {rate_hz:g}; the profiles of an X2M200 run at 20 only"
            raise SettingsError(msg)
        if kind not in {None, "baseband"}:
            raise SettingsError("port key 'kind': the profiles of an X2M200 send baseband only")
        return cls()

    def startup_commands(self) -> tuple[msg.Message, ...]:
        """Return what a freshly reset module is told, in the order of clients of real modules."""
        return (
            msg.SetMode(Mode.IDLE),
            msg.LoadProfile(PROFILES[self.profile][0]),
            msg.SetLed(self.led),
            msg.SetDetectionZone(self.zone_start_m, self.zone_end_m),
            msg.SetSensitivity(self.sensitivity),
            msg.SetOutput(OutputRef.BASEBAND, OUTPUTS[self.output]),
            msg.SetMode(Mode.RUN),
        )

    @property
    def frame_rate_hz(self) -> float:
        """Frames per second, which the profile fixes."""
        return _FRAME_RATE_HZ

    @property
    def axis(self) -> FastTimeAxis:
        """Bins of ten RF samples: the zone and 0.4 m behind it; pulse and length are inferred."""
        bin_length_m = _DECIMATION * SPEED_OF_LIGHT_MPS / (2 * SAMPLE_RATE_HZ)
        return FastTimeAxis(
            kind="baseband",
            n_range=round((self.zone_end_m - self.zone_start_m + 0.4) / bin_length_m),
            bin_length_m=bin_length_m,
            range_offset_m=self.zone_start_m,
            carrier_hz=_PULSE.carrier_hz,
            bandwidth_hz=_PULSE.bandwidth_hz,
            sample_rate_hz=SAMPLE_RATE_HZ,
        )
