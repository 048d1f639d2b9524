"""The numbers of the module's protocol, as one table.

Sources: XTAN-11 rev C, mcp_wrapper 1.3.1 and the module firmware's public headers
(documented); names ending in a comment `inferred` are readings of ours, see
docs/hardware.md.
"""

from enum import IntEnum

PING_SEED = 0xEEAAEAAE
USER_KEY_BASEBAND_IQ = 0x0000000C
USER_KEY_BASEBAND_AP = 0x0000000D


class PongCode(IntEnum):
    """What a module answers to a ping."""

    READY = 0xAAEEAEEA
    NOT_READY = 0xAEEAEEAA
    SAFE_MODE = 0xFFEEFEEF


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
    """References of APP_SETINT; BASEBAND is attested, the rest is from the enum."""

    BASEBAND = 0x10
    STATUS = 0x11
    STATUS_EXT = 0x12
    RF = 0x13
    PULSE_DOPPLER = 0x14


class BasebandOutput(IntEnum):
    """Value of `OutputRef.BASEBAND`."""

    OFF = 0
    IQ = 1
    AMPLITUDE_PHASE = 2
    AMPLITUDE = 3
    PHASE = 4


class DataType(IntEnum):
    """Element type of replies and data messages."""

    BYTE = 0x10
    INT = 0x11
    FLOAT = 0x12
    STRING = 0x13
    BASEBAND_OLD = 0x14
    USER = 0x50


class ContentId(IntEnum):
    """Content of a data message."""

    RAW_FRAME = 0
    I = 1  # noqa: E741 - the field's own name
    Q = 2
    IQ_LEGACY = 3
    ENVELOPE = 4
    BASEBAND_IQ = 0x0C
    BASEBAND_AP = 0x0D
