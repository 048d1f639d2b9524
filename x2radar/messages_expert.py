"""Commands beyond the everyday ones: radar level, noise map, pins, X4 driver.

Names and codes come from the firmware's public headers; payloads of the radar level
commands are partly inferred (docs/hardware.md).
"""

from dataclasses import dataclass

from x2radar.messages import FloatArray, Message


@dataclass(frozen=True, slots=True)
class StartBootloader(Message):
    """Restart into the bootloader; the key guards against accidents (`wire_ids`)."""

    key: int


@dataclass(frozen=True, slots=True)
class SetSubmode(Message):
    """Set mode with a submode byte (modes NORMAL and REG; legacy)."""

    mode: int
    submode: int


@dataclass(frozen=True, slots=True)
class GetDetectionZoneLimits(Message):
    """Ask for the limits of the detection zone (X4)."""


@dataclass(frozen=True, slots=True)
class GetDetectionZone(Message):
    """Ask for the detection zone (X4)."""


@dataclass(frozen=True, slots=True)
class GetSensitivity(Message):
    """Ask for the sensitivity (X4)."""


@dataclass(frozen=True, slots=True)
class FactoryPreset(Message):
    """Go back to factory settings (X4)."""


@dataclass(frozen=True, slots=True)
class StoreNoiseMap(Message):
    """Store the noise map (X4)."""


@dataclass(frozen=True, slots=True)
class LoadNoiseMap(Message):
    """Load the stored noise map (X4)."""


@dataclass(frozen=True, slots=True)
class DeleteNoiseMap(Message):
    """Delete the stored noise map (X4)."""


@dataclass(frozen=True, slots=True)
class SetNoiseMapControl(Message):
    """Bits: 1 use stored, 2 adaptive, 4 initialise on reset."""

    control: int


@dataclass(frozen=True, slots=True)
class GetNoiseMapControl(Message):
    """Ask for the noise map's control bits."""


@dataclass(frozen=True, slots=True)
class SetOutputControl(Message):
    """Switch an output the X4 way: data id and control (0 off, 1 on)."""

    feature: int
    control: int


@dataclass(frozen=True, slots=True)
class SetDebugLevel(Message):
    """0 none, 1 error, 2 warning, 3 info, 4 debug."""

    level: int


@dataclass(frozen=True, slots=True)
class SystemTest(Message):
    """Run one of the module's own tests, 0x10 to 0x1F."""

    code: int


@dataclass(frozen=True, slots=True)
class GetVersionOld(Message):
    """Ask for the version, as old firmware has it."""


@dataclass(frozen=True, slots=True)
class GetBuildOld(Message):
    """Ask for the build, as old firmware has it."""


@dataclass(frozen=True, slots=True)
class GetProductOld(Message):
    """Ask for the product, as old firmware has it."""


@dataclass(frozen=True, slots=True, eq=False)
class SetAppFloats(Message):
    """APP_SETFLOAT: floats for a reference."""

    ref: int
    values: FloatArray


@dataclass(frozen=True, slots=True)
class RadlibExecute(Message):
    """Run a Radarlib action (payload inferred: u32 id)."""

    action: int


@dataclass(frozen=True, slots=True)
class SetVarInt(Message):
    """Set a Radarlib integer variable."""

    variable: int
    value: int


@dataclass(frozen=True, slots=True)
class GetVarInt(Message):
    """Ask for a Radarlib integer variable."""

    variable: int


@dataclass(frozen=True, slots=True)
class SetVarFloat(Message):
    """Set a Radarlib float variable."""

    variable: int
    value: float


@dataclass(frozen=True, slots=True)
class GetVarFloat(Message):
    """Ask for a Radarlib float variable."""

    variable: int


@dataclass(frozen=True, slots=True)
class SetRegisterField(Message):
    """Write a register field of the chip by its field id."""

    field_id: int
    value: int


@dataclass(frozen=True, slots=True)
class GetRegisterField(Message):
    """Read a register field of the chip by its field id."""

    field_id: int


@dataclass(frozen=True, slots=True)
class GetFrameFloat(Message):
    """Take one normalised frame (payload inferred: none)."""


@dataclass(frozen=True, slots=True)
class GetFrameRaw(Message):
    """Take one frame of raw counters (payload inferred: none)."""


@dataclass(frozen=True, slots=True)
class GetChipId(Message):
    """Ask for the chip's id."""


@dataclass(frozen=True, slots=True)
class TimingMeasurement(Message):
    """Measure the chip's sampling rate; takes about a minute."""


@dataclass(frozen=True, slots=True)
class ResetRadarHardware(Message):
    """Reset the radar chip."""


@dataclass(frozen=True, slots=True)
class SetPin(Message):
    """Set up an I/O pin."""

    pin: int
    setup: int
    feature: int


@dataclass(frozen=True, slots=True)
class WritePin(Message):
    """Set an I/O pin's value."""

    pin: int
    value: int


@dataclass(frozen=True, slots=True)
class ReadPin(Message):
    """Ask for an I/O pin's value."""

    pin: int


@dataclass(frozen=True, slots=True)
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
    """Range of the antenna's own delay, in metres."""

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
    """Transmit power code."""

    code: int


@dataclass(frozen=True, slots=True)
class X4SetPrfDivider(Message):
    """Pulse rate = 243 MHz / divider."""

    divider: int


@dataclass(frozen=True, slots=True)
class X4Get(Message):
    """Ask for one of the X4 driver's settings by its id."""

    setting: int
