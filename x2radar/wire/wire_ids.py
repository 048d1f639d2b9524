"""The numbers of the module's protocol, as one table.

Sources: XTAN-11 rev C, mcp_wrapper 1.3.1 and the module firmware's public headers. What is
a reading of ours is said so here and listed in docs/research/hardware.md.
"""

from collections.abc import Mapping
from enum import IntEnum

PING_SEED = 0xEEAAEAAE


class PongCode(IntEnum):
    """What a module answers to a ping."""

    READY = 0xAAEEAEEA
    NOT_READY = 0xAEEAEEAA
    SAFE_MODE = 0xFFEEFEEF


PONG_NAMES: Mapping[int, str] = {code: code.name.lower() for code in PongCode}  # for people


class Mode(IntEnum):
    """Argument of set mode."""

    RUN = 0x01
    NORMAL = 0x10
    IDLE = 0x11
    MANUAL = 0x12
    STOP = 0x13  # X4 only


class Led(IntEnum):
    """Argument of LED control; INHALATION is known from one client of the X2M200."""

    OFF = 0
    SIMPLE = 1
    FULL = 2
    INHALATION = 3


class Profile(IntEnum):
    """Application ids that load profile takes."""

    RESPIRATION = 0x1423A2D6
    SLEEP = 0x00F17B17
    PRESENCE = 0x00288912
    RESPIRATION_2 = 0x064E57AD
    RESPIRATION_3 = 0x47FABEBA
    RESPIRATION_4 = 0x4AC5D074
    RESPIRATION_5 = 0xA9E03260
    HEART_RATE = 0x6B5C1609
    PRESENCE_2 = 0x014D4AB8
    PRESENCE_3 = 0x114D4AB8
    HIGH_BAY = 0xD0F2862D
    DECIM = 0x9BB3A2C6
    RADAR = 0x57DABF09


class InfoItem(IntEnum):
    """Argument of system info."""

    ITEM_NUMBER = 0
    ORDER_CODE = 1
    FIRMWARE_ID = 2
    VERSION = 3
    BUILD = 4
    APP_ID_LIST = 5
    SERIAL_NUMBER = 6
    VERSION_LIST = 7
    SYSTEM_CORE_ID = 8
    BOOTLOADER = 9


class SystemCode(IntEnum):
    """Code of a system message."""

    BOOTING = 0x10
    READY = 0x11


class ErrorCode(IntEnum):
    """Code of an error reply."""

    NOT_RECOGNIZED = 0x01
    CRC_FAILED = 0x02
    BUSY = 0x03
    APP_INVALID = 0x20
    COMMAND_FAILED = 0x21
    RESTARTING = 0x22
    USER = 0xA0


class SysCfg(IntEnum):
    """References of SYSCFG_SETINT and SYSCFG_SETFLOAT.

    The codes are documented. Inferred: FPS is an integer (after ModuleConnector's
    set_fps(u32)), SAMPLE_DELAY is a float in seconds (after Radarlib).
    """

    PULSES_PER_STEP = 0x10
    ITERATIONS = 0x11
    DAC_STEP = 0x12
    DAC_MIN = 0x13
    DAC_MAX = 0x14
    SAMPLE_DELAY = 0x15
    PG_SELECT = 0x16
    MCLK_DIV = 0x17
    STAGGERED_PRF = 0x18
    DAC_AUTO = 0x19
    FPS = 0x1A
    FRAME_STITCH = 0x1B


class OutputRef(IntEnum):
    """References of APP_SETINT; BASEBAND is attested, the other is from the enum."""

    BASEBAND = 0x10
    PULSE_DOPPLER = 0x14


class BasebandOutput(IntEnum):
    """Value of `OutputRef.BASEBAND`."""

    OFF = 0
    IQ = 1
    AMPLITUDE_PHASE = 2


class DataType(IntEnum):
    """Element type of replies and data messages."""

    BYTE = 0x10
    INT = 0x11
    FLOAT = 0x12
    STRING = 0x13
    BASEBAND_OLD = 0x14


class ContentId(IntEnum):
    """Content of a data message; docs/reference/protocol.md lists the others."""

    RAW_FRAME = 0
    ENVELOPE = 4
    BASEBAND_IQ = 0x0C
    BASEBAND_AP = 0x0D


class X4Setting(IntEnum):
    """What the X4 driver's set command names.

    FPS above zero starts the stream, zero stops it. The frame's area and its offset are metres,
    the centre frequency is 3 for 7.29 and 4 for 8.748 GHz, the pulse rate 243 MHz / PRF_DIV, whose
    width of one byte is inferred; what a TX_POWER means is unknown.
    """

    FPS = 0x10
    PULSES_PER_STEP = 0x11
    ITERATIONS = 0x12
    DOWN_CONVERSION = 0x13
    FRAME_AREA = 0x14
    DAC_STEP = 0x15
    DAC_MIN = 0x16
    DAC_MAX = 0x17
    FRAME_AREA_OFFSET = 0x18
    ENABLE = 0x19
    TX_CENTRE_FREQUENCY = 0x20
    TX_POWER = 0x21
    PRF_DIV = 0x25


def _by_prefix(names: str) -> dict[bytes, str]:
    """Return names by the bytes that packets begin with: a line a first byte, then the rest."""
    found = {}
    for line in names.strip().splitlines():
        first, entries = line.split(":")
        for entry in entries.split(","):
            *rest, name = entry.split()
            found[bytes.fromhex(first + "".join(rest))] = name
    return found


COMMAND_NAMES = _by_prefix(
    """
    02: StartBootloader
    10: 10 SetAppItem, 11 GetAppItem, 12 FactoryPreset
    10: 13 StoreNoiseMap, 14 LoadNoiseMap, 16 DeleteNoiseMap
    23: SetCom
    25: 10 SetNoiseMapControl, 11 GetNoiseMapControl
    40: 10 SetPin, 20 WritePin, 21 ReadPin
    41: 10 SetOutputControl
    42: SetDebugOutput
    50: 10 X4Set, 11 X4Get, 12 X4Write, 13 X4Read
    90: SystemCommand, 10 RadlibExecute
    90: 11 SetVarInt, 12 GetVarInt, 13 SetVarFloat, 14 GetVarFloat
    90: 15 SetRegisterField, 16 GetRegisterField, 17 GetFrameFloat, 18 GetFrameRaw, 19 GetChipId
    90: 20 TimingMeasurement, 30 ResetRadarHardware, 31 SetRadarClock, 40 FramesToFlash
    90: 50 SystemTest, 55 GetVersionOld, 56 GetBuildOld, 57 GetProductOld
    90: 70 SetAppFloats, 71 SetAppInts, 74 GetProfileId
    a0: HilCommand
    b0: SetDebugLevel
    c0: BootloaderCommand
    """
)
"""What a host's packets are called that no row of `messages` describes, by how they begin."""

RESPONSE_NAMES = _by_prefix(
    """
    11: 50 UserReply
    12: HilReply
    50: AppData
    50: 10 00 00 00 PulseDoppler, 11 00 00 00 PulseDopplerBytes
    50: 12 00 00 00 NoiseMap, 13 00 00 00 NoiseMapBytes
    50: 02 01 02 20 VitalSigns, 26 fe 75 23 RespirationStatus, 6b a1 75 23 RespirationStatusExt
    50: 6c a1 75 23 SleepStatus, 23 76 ba 32 ParameterFile, aa 45 76 32 DecimStatus
    50: 02 3a 08 41 SleepStage, 00 3b 0a 61 RespirationMovingList
    50: 02 3b 0a 61 RespirationDetectionList, 1e fa 3b 72 PresenceSingle
    50: 1f fa 3b 72 PresenceMovingList, be 52 1a 99 PresenceStatus
    50: cf 31 a3 c3 NormalisedMovementList
    a0: 13 DataText, 50 UserData
    e0: BootloaderReply
    """
)
"""The same of a module's packets."""
