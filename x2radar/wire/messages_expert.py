"""Commands beyond the everyday ones: radar level, noise map, pins, generic ones.

Codes come from the firmware's public headers. A docstring with the word inferred or unknown
marks a payload that no document or client settles; docs/research/hardware.md gives the reasons.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.wire.messages import FloatArray, Message, Opaque


@dataclass(frozen=True, slots=True)
class StartBootloader(Message):
    """Restart into the bootloader; `wire_ids.BootloaderKey` guards against accidents."""

    key: int


@dataclass(frozen=True, slots=True)
class SetSubmode(Message):
    """Set mode with a submode byte (modes NORMAL and REG; legacy)."""

    mode: int
    submode: int


class GetDetectionZoneLimits(Message):
    """Ask for the limits of the detection zone (X4)."""


class GetDetectionZone(Message):
    """Ask for the detection zone (X4)."""


class GetSensitivity(Message):
    """Ask for the sensitivity (X4)."""


class FactoryPreset(Message):
    """Go back to factory settings (X4)."""


class StoreNoiseMap(Message):
    """Store the noise map (X4)."""


class LoadNoiseMap(Message):
    """Load the stored noise map (X4)."""


class DeleteNoiseMap(Message):
    """Delete the stored noise map (X4)."""


@dataclass(frozen=True, slots=True)
class SetNoiseMapControl(Message):
    """Set how the noise map is used (`wire_ids.NoiseMapControl`)."""

    control: int


class GetNoiseMapControl(Message):
    """Ask for the noise map's control bits."""


@dataclass(frozen=True, slots=True)
class SetOutputControl(Message):
    """Switch an output the X4 way: data id and control (0 off, 1 on)."""

    feature: int
    control: int


@dataclass(frozen=True, slots=True)
class SetDebugLevel(Message):
    """Choose how much the module tells (`wire_ids.DebugLevel`)."""

    level: int


@dataclass(frozen=True, slots=True)
class SystemTest(Message):
    """Run one of the module's own tests, 0x10 to 0x1F.

    0x10 reset count, 0x11 external RAM, 0x12 external flash, 0x13 power supply. The answer
    is 0 for passed, 1 for failed, 2 for not implemented.
    """

    code: int


class GetVersionOld(Message):
    """Ask for the version, as old firmware has it (a text as answer is inferred)."""


class GetBuildOld(Message):
    """Ask for the build, as old firmware has it (a text as answer is inferred)."""


class GetProductOld(Message):
    """Ask for the product, as old firmware has it (a text as answer is inferred)."""


@dataclass(frozen=True, slots=True, eq=False)
class SetAppFloats(Message):
    """APP_SETFLOAT: floats for a reference."""

    ref: int
    values: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class SetAppInts(Message):
    """APP_SETINT with other than one value, uint32; `SetOutput` is the one with one."""

    ref: int
    values: NDArray[np.uint32]


@dataclass(frozen=True, slots=True)
class SetOutputUncounted(Message):
    """APP_SETINT as an early document prints it, without a count; modules refuse it."""

    ref: int
    value: int


class RadlibExecute(Opaque):
    """Run a Radarlib action; which payload names it is unknown."""


@dataclass(frozen=True, slots=True)
class SetVarInt(Message):
    """Set a Radarlib integer variable (widths inferred: u32)."""

    variable: int
    value: int


@dataclass(frozen=True, slots=True)
class GetVarInt(Message):
    """Ask for a Radarlib integer variable (width inferred: u32)."""

    variable: int


@dataclass(frozen=True, slots=True)
class SetVarFloat(Message):
    """Set a Radarlib float variable (width of its number inferred: u32)."""

    variable: int
    value: float


@dataclass(frozen=True, slots=True)
class GetVarFloat(Message):
    """Ask for a Radarlib float variable (width inferred: u32)."""

    variable: int


@dataclass(frozen=True, slots=True)
class SetRegisterField(Message):
    """Write a register field of the chip by its id (widths inferred: u32)."""

    field_id: int
    value: int


@dataclass(frozen=True, slots=True)
class GetRegisterField(Message):
    """Read a register field of the chip by its id (width inferred: u32)."""

    field_id: int


class GetFrameFloat(Message):
    """Take one normalised frame (inferred: no payload, DATA as answer)."""


class GetFrameRaw(Message):
    """Take one frame of raw counters (inferred: no payload, DATA as answer)."""


class GetChipId(Message):
    """Ask for the chip's id (inferred: no payload, a reply as answer)."""


class TimingMeasurement(Message):
    """Measure the chip's sampling rate; takes about a minute (inferred: no payload)."""


class ResetRadarHardware(Message):
    """Reset the radar chip (inferred: no payload)."""


class SetRadarClock(Opaque):
    """Switch the radar chip's clock; the payload is unknown."""


class FramesToFlash(Opaque):
    """Store frames in the module's flash; the payload is unknown."""


@dataclass(frozen=True, slots=True)
class SetPin(Message):
    """Set up an I/O pin (width of the fields inferred: u32)."""

    pin: int
    setup: int
    feature: int


@dataclass(frozen=True, slots=True)
class WritePin(Message):
    """Set an I/O pin's value (width of the fields inferred: u32)."""

    pin: int
    value: int


@dataclass(frozen=True, slots=True)
class ReadPin(Message):
    """Ask for an I/O pin's value (width of the field inferred: u32)."""

    pin: int


# ---------------------------------------------------------------- whatever else there is


class GetProfileId(Message):
    """Ask which profile is loaded (X4; inferred: no payload, a reply as answer)."""


@dataclass(frozen=True, slots=True)
class SetAppItem(Message):
    """Set any item of the profile (`wire_ids.AppItem`): the value's bytes."""

    item_id: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class GetAppItem(Message):
    """Ask for any item of the profile (`wire_ids.AppItem`)."""

    item_id: int


@dataclass(frozen=True, slots=True)
class SystemCommand(Message):
    """Any command that begins with 90: flash, files, injected frames, debug data."""

    sub: int
    payload: bytes


class SetCom(Opaque):
    """MOD_SETCOM; the payload is unknown."""


class SetDebugOutput(Opaque):
    """DEBUG_OUTPUT; the payload is unknown."""


class HilCommand(Opaque):
    """HIL, hardware in the loop; the payload is unknown."""


class HilReply(Opaque):
    """Answer to `HilCommand`; the payload is unknown."""


@dataclass(frozen=True, slots=True)
class BootloaderCommand(Message):
    """A command to the bootloader: 0 device info, 0x10 write page, 0x20 start application.

    Write page's payload is the page as big-endian u16, 00 and 512 bytes.
    """

    code: int
    payload: bytes


class BootloaderReply(Opaque):
    """The bootloader did what it was told; a payload is unknown."""
