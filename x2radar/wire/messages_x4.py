"""Commands of the X4 driver, the counterpart of SYSCFG on X4 modules.

Codes come from XTAN-11 rev C and the firmware's public headers. A docstring with the word
inferred or unknown marks what no document or client settles; docs/research/hardware.md gives the
reasons. Reading settings and registers back, and setting others, is not known here: `Unknown`.
"""

from dataclasses import dataclass

from x2radar.wire.messages import Message


class X4Init(Message):
    """Initialise the X4 driver."""


@dataclass(frozen=True, slots=True)
class X4SetFrameRate(Message):
    """Frames per second; above zero starts the stream, zero stops it."""

    frame_rate_hz: float


@dataclass(frozen=True, slots=True)
class X4SetPulsesPerStep(Message):
    """Pulses at each threshold."""

    pulses: int


@dataclass(frozen=True, slots=True)
class X4SetIterations(Message):
    """Sweeps summed."""

    iterations: int


@dataclass(frozen=True, slots=True)
class X4SetDownConversion(Message):
    """1: the chip sends baseband; 0: RF."""

    enabled: int


@dataclass(frozen=True, slots=True)
class X4SetFrameArea(Message):
    """Range of the frame, in metres."""

    start_m: float
    end_m: float


@dataclass(frozen=True, slots=True)
class X4SetDacStep(Message):
    """Step of the threshold sweep, in counts."""

    step: int


@dataclass(frozen=True, slots=True)
class X4SetDacMin(Message):
    """Begin of the threshold sweep, in counts."""

    count: int


@dataclass(frozen=True, slots=True)
class X4SetDacMax(Message):
    """End of the threshold sweep, in counts."""

    count: int


@dataclass(frozen=True, slots=True)
class X4SetFrameAreaOffset(Message):
    """Range that the delay of antenna and board amounts to, in metres."""

    offset_m: float


@dataclass(frozen=True, slots=True)
class X4Enable(Message):
    """Switch the chip on or off."""

    enabled: int


@dataclass(frozen=True, slots=True)
class X4SetCentreFrequency(Message):
    """3: 7.29 GHz, 4: 8.748 GHz."""

    code: int


@dataclass(frozen=True, slots=True)
class X4SetPower(Message):
    """Transmit power; the codes' meaning is unknown."""

    code: int


@dataclass(frozen=True, slots=True)
class X4SetPrfDivider(Message):
    """Pulse rate = 243 MHz / divider (width of the field inferred: u8)."""

    divider: int
