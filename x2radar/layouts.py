"""The tables: which bytes every message is.

Both directions, in the order of the module's documents. A row is all that a message of
fixed fields and counted arrays needs; `x2radar.codec` reads them. Sources: XTAN-11 rev C, the
firmware's public headers, public clients; what is inferred stands in docs/hardware.md.
"""

from dataclasses import dataclass

from x2radar.messages import (
    Ack,
    BasebandAp,
    BasebandIq,
    GetMode,
    GetSystemInfo,
    LoadProfile,
    Message,
    Ping,
    Pong,
    Reset,
    SetBaudRate,
    SetDetectionZone,
    SetLed,
    SetMode,
    SetSensitivity,
    SetSysFloat,
    SetSysInt,
    SystemMessage,
)
from x2radar.messages_expert import (
    DeleteNoiseMap,
    FactoryPreset,
    GetBuildOld,
    GetChipId,
    GetDetectionZone,
    GetDetectionZoneLimits,
    GetFrameFloat,
    GetFrameRaw,
    GetNoiseMapControl,
    GetProductOld,
    GetRegisterField,
    GetSensitivity,
    GetVarFloat,
    GetVarInt,
    GetVersionOld,
    LoadNoiseMap,
    RadlibExecute,
    ReadPin,
    ResetRadarHardware,
    SetAppFloats,
    SetDebugLevel,
    SetNoiseMapControl,
    SetOutputControl,
    SetPin,
    SetRegisterField,
    SetSubmode,
    SetVarFloat,
    SetVarInt,
    StartBootloader,
    StoreNoiseMap,
    SystemTest,
    TimingMeasurement,
    WritePin,
    X4Enable,
    X4Get,
    X4Init,
    X4SetCentreFrequency,
    X4SetDacMax,
    X4SetDacMin,
    X4SetDacStep,
    X4SetDownConversion,
    X4SetFrameArea,
    X4SetFrameAreaOffset,
    X4SetFrameRate,
    X4SetIterations,
    X4SetPower,
    X4SetPrfDivider,
    X4SetPulsesPerStep,
)
from x2radar.messages_status import (
    NoiseMap,
    NoiseMapBytes,
    NormalisedMovementList,
    ParameterFile,
    PresenceMovingList,
    PresenceSingle,
    PresenceStatus,
    PresenceStatusShort,
    PulseDoppler,
    PulseDopplerBytes,
    RespirationDetectionList,
    RespirationMovingList,
    RespirationStatus,
    SleepStage,
    SleepStatus,
    VitalSigns,
)


@dataclass(frozen=True, slots=True)
class Layout:
    """How one message lies in a packet.

    Attributes
    ----------
    cls : type
        The message class; its fields come in wire order, arrays last.
    prefix : bytes
        First bytes of the packet.
    head : str
        Struct format (little-endian) of the fixed fields and counts.
    counts : tuple of int
        Positions within `head` that hold array lengths and are no fields.
    arrays : tuple of (int, str)
        For each array: which of `counts` rules it, and its dtype.
    tail : bool
        Further bytes may follow and are ignored.
    """

    cls: type[Message]
    prefix: bytes
    head: str = ""
    counts: tuple[int, ...] = ()
    arrays: tuple[tuple[int, str], ...] = ()
    tail: bool = False


_IQ_HEAD = "IIffff"
_TWO_FLOATS = ((0, "<f4"), (0, "<f4"))


def _app(message_id: int) -> bytes:
    return b"\x50" + message_id.to_bytes(4, "little")


def _app_query(item_id: int) -> bytes:
    return b"\x10\x11" + item_id.to_bytes(4, "little")


def _x4_set(setting: int) -> bytes:
    return b"\x50\x10" + setting.to_bytes(4, "little")


def _app_command(item_id: int) -> bytes:
    return b"\x10\x10" + item_id.to_bytes(4, "little")


COMMANDS: tuple[Layout, ...] = (
    Layout(Ping, b"\x01", "I"),
    Layout(Reset, b"\x22"),
    Layout(SetMode, b"\x20", "B"),
    Layout(GetMode, b"\x26"),
    Layout(LoadProfile, b"\x21", "I"),
    Layout(SetLed, b"\x24", "BB"),
    Layout(SetDetectionZone, _app_command(0x96A10A1C), "ff"),
    Layout(SetSensitivity, _app_command(0x10A5112B), "I"),
    Layout(SetBaudRate, b"\x90\x80", "I"),
    Layout(GetSystemInfo, b"\x90\x58", "B"),
    Layout(SetSysInt, b"\x90\x51", "Ii"),
    Layout(SetSysFloat, b"\x90\x52", "If"),
    Layout(StartBootloader, b"\x02", "I"),
    Layout(GetDetectionZoneLimits, _app_query(0x96A10A1D)),
    Layout(GetDetectionZone, _app_query(0x96A10A1C)),
    Layout(GetSensitivity, _app_query(0x10A5112B)),
    Layout(FactoryPreset, b"\x10\x12"),
    Layout(StoreNoiseMap, b"\x10\x13"),
    Layout(LoadNoiseMap, b"\x10\x14"),
    Layout(DeleteNoiseMap, b"\x10\x16"),
    Layout(SetNoiseMapControl, b"\x25\x10", "I"),
    Layout(GetNoiseMapControl, b"\x25\x11"),
    Layout(SetOutputControl, b"\x41\x10", "II"),
    Layout(SetDebugLevel, b"\xb0", "B"),
    Layout(SystemTest, b"\x90\x50", "B"),
    Layout(GetVersionOld, b"\x90\x55"),
    Layout(GetBuildOld, b"\x90\x56"),
    Layout(GetProductOld, b"\x90\x57"),
    Layout(SetAppFloats, b"\x90\x70", "II", (1,), ((0, "<f4"),)),
    Layout(RadlibExecute, b"\x90\x10", "I"),
    Layout(SetVarInt, b"\x90\x11", "II"),
    Layout(GetVarInt, b"\x90\x12", "I"),
    Layout(SetVarFloat, b"\x90\x13", "If"),
    Layout(GetVarFloat, b"\x90\x14", "I"),
    Layout(SetRegisterField, b"\x90\x15", "II"),
    Layout(GetRegisterField, b"\x90\x16", "I"),
    Layout(GetFrameFloat, b"\x90\x17"),
    Layout(GetFrameRaw, b"\x90\x18"),
    Layout(GetChipId, b"\x90\x19"),
    Layout(TimingMeasurement, b"\x90\x20"),
    Layout(ResetRadarHardware, b"\x90\x30"),
    Layout(SetPin, b"\x40\x10", "III"),
    Layout(WritePin, b"\x40\x20", "II"),
    Layout(ReadPin, b"\x40\x21", "I"),
    Layout(X4Init, b"\x50\x20"),
    Layout(X4SetFrameRate, _x4_set(0x10), "f"),
    Layout(X4SetPulsesPerStep, _x4_set(0x11), "I"),
    Layout(X4SetIterations, _x4_set(0x12), "I"),
    Layout(X4SetDownConversion, _x4_set(0x13), "B"),
    Layout(X4SetFrameArea, _x4_set(0x14), "ff"),
    Layout(X4SetDacStep, _x4_set(0x15), "B"),
    Layout(X4SetDacMin, _x4_set(0x16), "I"),
    Layout(X4SetDacMax, _x4_set(0x17), "I"),
    Layout(X4SetFrameAreaOffset, _x4_set(0x18), "f"),
    Layout(X4Enable, _x4_set(0x19), "B"),
    Layout(X4SetCentreFrequency, _x4_set(0x20), "B"),
    Layout(X4SetPower, _x4_set(0x21), "B"),
    Layout(X4SetPrfDivider, _x4_set(0x25), "B"),
    Layout(X4Get, b"\x50\x11", "I"),
)
"""What a host sends. `SetOutput` carries its count in the middle and stands in `encode`."""

RESPONSES: tuple[Layout, ...] = (
    Layout(Pong, b"\x01", "I"),
    Layout(Ack, b"\x10"),
    Layout(SystemMessage, b"\x30", "I", tail=True),
    Layout(RespirationStatus, _app(0x2375FE26), "IIIffI"),
    Layout(SleepStatus, _app(0x2375A16C), "IIffIff"),
    Layout(PresenceStatus, _app(0x991A52BE), "IffI"),
    Layout(PresenceSingle, _app(0x723BFA1E), "IIfBI"),
    Layout(
        PresenceMovingList,
        _app(0x723BFA1F),
        "IIII",
        (2, 3),
        ((0, "<f4"), (0, "<f4"), (1, "<f4"), (1, "<f4"), (1, "<f4")),
    ),
    Layout(RespirationMovingList, _app(0x610A3B00), "II", (1,), _TWO_FLOATS),
    Layout(RespirationDetectionList, _app(0x610A3B02), "II", (1,), (*_TWO_FLOATS, (0, "<f4"))),
    Layout(NormalisedMovementList, _app(0xC3A331CF), "IffI", (3,), _TWO_FLOATS),
    Layout(VitalSigns, _app(0x20020102), "IIffffffffff"),
    Layout(SleepStage, _app(0x41083A02), "II"),
    Layout(PulseDoppler, _app(0x10), "IIIIIIfffff", (4,), ((0, "<f4"),)),
    Layout(NoiseMap, _app(0x12), "IIIIIIfffff", (4,), ((0, "<f4"),)),
    Layout(PulseDopplerBytes, _app(0x11), "IIIIIIfffffff", (4,), ((0, "u1"),)),
    Layout(NoiseMapBytes, _app(0x13), "IIIIIIfffffff", (4,), ((0, "u1"),)),
    Layout(ParameterFile, _app(0x32BA7623), "II", (0, 1), ((0, "u1"), (1, "u1"))),
    Layout(BasebandIq, _app(0x0C), _IQ_HEAD, (1,), _TWO_FLOATS),
    Layout(BasebandAp, _app(0x0D), _IQ_HEAD, (1,), _TWO_FLOATS),
)
"""What a module sends, but for REPLY, DATA and ERROR, which have shapes of their own."""

VARIANTS: tuple[Layout, ...] = (
    Layout(SetSubmode, b"\x20", "BB"),
    Layout(PresenceStatusShort, _app(0x991A52BE), "BffI"),
)
"""Other readings of a prefix above, known by their length alone."""
