"""The tables: which bytes every message is.

Both directions, in the order of the module's documents. A row is all that a message of
fixed fields and counted arrays needs; `x2radar.wire.codec` reads them. Sources: XTAN-11 rev C, the
firmware's public headers, public clients; what is inferred stands in docs/research/hardware.md.
"""

from dataclasses import dataclass
from typing import Literal

from x2radar.wire import messages as core
from x2radar.wire import messages_expert as expert
from x2radar.wire import messages_status as status
from x2radar.wire import messages_x4 as x4
from x2radar.wire.messages import Ack, Data, Message, Pong, Reply
from x2radar.wire.wire_ids import AppItem, AppMessage, ContentId, DataType, X4Setting


@dataclass(frozen=True, slots=True)
class Layout:
    """How one message lies in a packet."""

    cls: type[Message]
    """The message class; its fields come in wire order, arrays last."""
    prefix: bytes
    head: str = ""
    """Struct format (little-endian) of the fixed fields and counts."""
    counts: tuple[int, ...] = ()
    """Positions within `head` that hold array lengths and are no fields."""
    arrays: tuple[tuple[int, str], ...] = ()
    """For each array: which of `counts` rules it, and its dtype."""
    rest: Literal["none", "ignored", "kept"] = "none"
    """What further bytes are: a fault, nothing, or the message's last field, as bytes."""
    answer: type[Message] = Ack
    """What a module answers a command with, unless it refuses."""


_FLOATS = ((0, "<f4"),)
_TWO_FLOATS = _FLOATS * 2
_BYTES = ((0, "u1"),)
# What several messages have behind their prefix: head, counts and arrays of `Layout`.
_BASEBAND = ("IIffff", (1,), _TWO_FLOATS)
_TWO_LISTS = ("II", (1,), _TWO_FLOATS)
_THREE_LISTS = ("II", (1,), _FLOATS * 3)
_DOPPLER = ("IIIIIIfffff", (4,), _FLOATS)
_DOPPLER_BYTES = ("IIIIIIfffffff", (4,), _BYTES)


def _u32(value: int) -> bytes:
    return value.to_bytes(4, "little")


def _app(message_id: AppMessage) -> bytes:
    return b"\x50" + _u32(message_id)


def _old_baseband(content_id: ContentId) -> bytes:
    return bytes([0xA0, DataType.BASEBAND_OLD]) + _u32(content_id)


def _set_item(item_id: AppItem) -> bytes:
    return b"\x10\x10" + _u32(item_id)


def _get_item(item_id: AppItem) -> bytes:
    return b"\x10\x11" + _u32(item_id)


def _x4_set(setting: X4Setting) -> bytes:
    return b"\x50\x10" + _u32(setting)


_SPI = _u32(X4Setting.SPI_REGISTER)

COMMANDS: tuple[Layout, ...] = (
    # Every module.
    Layout(core.Ping, b"\x01", "I", answer=Pong),
    Layout(expert.StartBootloader, b"\x02", "I"),
    Layout(core.SetMode, b"\x20", "B"),
    Layout(core.LoadProfile, b"\x21", "I"),
    Layout(core.Reset, b"\x22"),
    Layout(expert.SetCom, b"\x23", rest="kept"),
    Layout(core.SetLed, b"\x24", "BB"),
    Layout(expert.SetNoiseMapControl, b"\x25\x10", "I"),
    Layout(expert.GetNoiseMapControl, b"\x25\x11", answer=Reply),
    Layout(core.GetMode, b"\x26", answer=Reply),
    Layout(expert.SetPin, b"\x40\x10", "III"),
    Layout(expert.WritePin, b"\x40\x20", "II"),
    Layout(expert.ReadPin, b"\x40\x21", "I", answer=Reply),
    Layout(expert.SetOutputControl, b"\x41\x10", "II"),
    Layout(expert.SetDebugOutput, b"\x42", rest="kept"),
    Layout(expert.HilCommand, b"\xa0", rest="kept", answer=expert.HilReply),
    Layout(expert.SetDebugLevel, b"\xb0", "B"),
    Layout(expert.BootloaderCommand, b"\xc0", "B", rest="kept", answer=expert.BootloaderReply),
    # Profiles.
    Layout(core.SetDetectionZone, _set_item(AppItem.DETECTION_ZONE), "ff"),
    Layout(core.SetSensitivity, _set_item(AppItem.SENSITIVITY), "I"),
    Layout(expert.SetAppItem, b"\x10\x10", "I", rest="kept"),
    Layout(expert.GetDetectionZone, _get_item(AppItem.DETECTION_ZONE), answer=Reply),
    Layout(expert.GetDetectionZoneLimits, _get_item(AppItem.DETECTION_ZONE_LIMITS), answer=Reply),
    Layout(expert.GetSensitivity, _get_item(AppItem.SENSITIVITY), answer=Reply),
    Layout(expert.GetAppItem, b"\x10\x11", "I", answer=Reply),
    Layout(expert.FactoryPreset, b"\x10\x12"),
    Layout(expert.StoreNoiseMap, b"\x10\x13"),
    Layout(expert.LoadNoiseMap, b"\x10\x14"),
    Layout(expert.DeleteNoiseMap, b"\x10\x16"),
    # Radar level and system.
    Layout(expert.RadlibExecute, b"\x90\x10", rest="kept"),
    Layout(expert.SetVarInt, b"\x90\x11", "II"),
    Layout(expert.GetVarInt, b"\x90\x12", "I", answer=Reply),
    Layout(expert.SetVarFloat, b"\x90\x13", "If"),
    Layout(expert.GetVarFloat, b"\x90\x14", "I", answer=Reply),
    Layout(expert.SetRegisterField, b"\x90\x15", "II"),
    Layout(expert.GetRegisterField, b"\x90\x16", "I", answer=Reply),
    Layout(expert.GetFrameFloat, b"\x90\x17", answer=Data),
    Layout(expert.GetFrameRaw, b"\x90\x18", answer=Data),
    Layout(expert.GetChipId, b"\x90\x19", answer=Reply),
    Layout(expert.TimingMeasurement, b"\x90\x20"),
    Layout(expert.ResetRadarHardware, b"\x90\x30"),
    Layout(expert.SetRadarClock, b"\x90\x31", rest="kept"),
    Layout(expert.FramesToFlash, b"\x90\x40", rest="kept"),
    Layout(expert.SystemTest, b"\x90\x50", "B", answer=Reply),
    Layout(core.SetSysInt, b"\x90\x51", "Ii"),
    Layout(core.SetSysFloat, b"\x90\x52", "If"),
    Layout(expert.GetVersionOld, b"\x90\x55", answer=Reply),
    Layout(expert.GetBuildOld, b"\x90\x56", answer=Reply),
    Layout(expert.GetProductOld, b"\x90\x57", answer=Reply),
    Layout(core.GetSystemInfo, b"\x90\x58", "B", answer=Reply),
    Layout(expert.SetAppFloats, b"\x90\x70", "II", (1,), _FLOATS),
    Layout(expert.SetAppInts, b"\x90\x71", "II", (1,), ((0, "<u4"),)),
    Layout(expert.GetProfileId, b"\x90\x74", answer=Reply),
    Layout(core.SetBaudRate, b"\x90\x80", "I"),
    Layout(expert.SystemCommand, b"\x90", "B", rest="kept"),
    # X4 driver.
    Layout(x4.X4Init, b"\x50\x20"),
    Layout(x4.X4SetFrameRate, _x4_set(X4Setting.FPS), "f"),
    Layout(x4.X4SetPulsesPerStep, _x4_set(X4Setting.PULSES_PER_STEP), "I"),
    Layout(x4.X4SetIterations, _x4_set(X4Setting.ITERATIONS), "I"),
    Layout(x4.X4SetDownConversion, _x4_set(X4Setting.DOWN_CONVERSION), "B"),
    Layout(x4.X4SetFrameArea, _x4_set(X4Setting.FRAME_AREA), "ff"),
    Layout(x4.X4SetDacStep, _x4_set(X4Setting.DAC_STEP), "B"),
    Layout(x4.X4SetDacMin, _x4_set(X4Setting.DAC_MIN), "I"),
    Layout(x4.X4SetDacMax, _x4_set(X4Setting.DAC_MAX), "I"),
    Layout(x4.X4SetFrameAreaOffset, _x4_set(X4Setting.FRAME_AREA_OFFSET), "f"),
    Layout(x4.X4Enable, _x4_set(X4Setting.ENABLE), "B"),
    Layout(x4.X4SetCentreFrequency, _x4_set(X4Setting.TX_CENTRE_FREQUENCY), "B"),
    Layout(x4.X4SetPower, _x4_set(X4Setting.TX_POWER), "B"),
    Layout(x4.X4SetPrfDivider, _x4_set(X4Setting.PRF_DIV), "B"),
    Layout(x4.X4Set, b"\x50\x10", "I", rest="kept"),
    Layout(x4.X4Get, b"\x50\x11", "I", answer=Reply),
    Layout(x4.X4WriteSpi, b"\x50\x12" + _SPI, "BB"),
    Layout(x4.X4Write, b"\x50\x12", "I", rest="kept"),
    Layout(x4.X4ReadSpi, b"\x50\x13" + _SPI, "BI", answer=Reply),
    Layout(x4.X4Read, b"\x50\x13", "I", rest="kept", answer=Reply),
)
"""What a host sends. `SetOutput` carries its count in the middle and stands in `encode`."""

RESPONSES: tuple[Layout, ...] = (
    Layout(Pong, b"\x01", "I"),
    Layout(Ack, b"\x10"),
    Layout(core.UserReply, bytes([0x11, DataType.USER]), "II", rest="kept"),
    Layout(expert.HilReply, b"\x12", rest="kept"),
    Layout(core.ErrorReply, b"\x20", "I"),
    Layout(core.SystemMessage, b"\x30", "I", rest="ignored"),
    Layout(core.BasebandIqOld, _old_baseband(ContentId.BASEBAND_IQ), *_BASEBAND),
    Layout(core.BasebandApOld, _old_baseband(ContentId.BASEBAND_AP), *_BASEBAND),
    Layout(core.UserData, bytes([0xA0, DataType.USER]), "II", rest="kept"),
    Layout(expert.BootloaderReply, b"\xe0", rest="kept"),
    # Profiles.
    Layout(status.RespirationStatus, _app(AppMessage.RESPIRATION), "IIIffI"),
    Layout(status.RespirationStatusExt, _app(AppMessage.RESPIRATION_EXT), rest="kept"),
    Layout(status.SleepStatus, _app(AppMessage.SLEEP), "IIffIff"),
    Layout(status.PresenceStatus, _app(AppMessage.PRESENCE), "IffI"),
    Layout(status.PresenceSingle, _app(AppMessage.PRESENCE_SINGLE), "IIfBI"),
    Layout(
        status.PresenceMovingList,
        _app(AppMessage.PRESENCE_MOVING_LIST),
        "IIII",
        (2, 3),
        (*_TWO_FLOATS, *((1, "<f4"),) * 3),
    ),
    Layout(status.RespirationMovingList, _app(AppMessage.RESPIRATION_MOVING_LIST), *_TWO_LISTS),
    Layout(
        status.RespirationDetectionList, _app(AppMessage.RESPIRATION_DETECTION_LIST), *_THREE_LISTS
    ),
    Layout(
        status.NormalisedMovementList,
        _app(AppMessage.NORMALISED_MOVEMENT_LIST),
        "IffI",
        (3,),
        _TWO_FLOATS,
    ),
    Layout(status.VitalSigns, _app(AppMessage.VITAL_SIGNS), "II" + "f" * 10),
    Layout(status.SleepStage, _app(AppMessage.SLEEP_STAGE), "II"),
    Layout(core.BasebandIq, _app(AppMessage.BASEBAND_IQ), *_BASEBAND),
    Layout(core.BasebandAp, _app(AppMessage.BASEBAND_AP), *_BASEBAND),
    Layout(status.PulseDoppler, _app(AppMessage.PULSE_DOPPLER), *_DOPPLER),
    Layout(status.NoiseMap, _app(AppMessage.NOISE_MAP), *_DOPPLER),
    Layout(status.PulseDopplerBytes, _app(AppMessage.PULSE_DOPPLER_BYTES), *_DOPPLER_BYTES),
    Layout(status.NoiseMapBytes, _app(AppMessage.NOISE_MAP_BYTES), *_DOPPLER_BYTES),
    Layout(
        status.ParameterFile, _app(AppMessage.PARAMETER_FILE), "II", (0, 1), (*_BYTES, (1, "u1"))
    ),
    Layout(status.DecimStatus, _app(AppMessage.DECIM), rest="kept"),
    Layout(status.AppData, b"\x50", "I", rest="kept"),
)
"""What a module sends, but for REPLY and DATA, which have shapes of their own."""

COMMAND_VARIANTS: tuple[Layout, ...] = (
    Layout(expert.SetSubmode, b"\x20", "BB"),
    Layout(expert.SetOutputUncounted, b"\x90\x71", "II"),
    Layout(x4.X4SetPulsesPerStep, _x4_set(X4Setting.PULSES_PER_STEP), "B"),
    Layout(x4.X4SetDacStep, _x4_set(X4Setting.DAC_STEP), "I"),
)
"""Other readings of a prefix above, known by their length alone.

A class of its own can be sent in this form; one that has a row above is only read.
"""

RESPONSE_VARIANTS: tuple[Layout, ...] = (
    Layout(core.ErrorReply, b"\x20", "B"),
    Layout(status.PresenceStatusShort, _app(AppMessage.PRESENCE), "BffI"),
)
"""The same for what a module sends."""

ANSWERS: dict[type[Message], type[Message]] = {
    row.cls: row.answer for row in COMMANDS if row.answer is not Ack
}
"""What answers a command, where it is not ACK."""
