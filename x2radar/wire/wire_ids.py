"""The numbers of the module's protocol, as one table.

Sources: XTAN-11 rev C, mcp_wrapper 1.3.1 and the module firmware's public headers. What is
a reading of ours is said so here and listed in docs/research/hardware.md.
"""

from enum import IntEnum, IntFlag

PING_SEED = 0xEEAAEAAE
BAUD_RATES = (
    *(9600, 19_200, 38_400, 115_200, 230_400, 460_800, 500_000, 576_000, 921_600),
    *(1_000_000, 2_000_000, 3_000_000, 4_000_000),
)
"""Rates that the firmware's headers allow; 115,200 is what a module starts with."""


class BootloaderKey(IntEnum):
    """Argument of start bootloader, of older and newer firmware."""

    OLD = 0xA2B95EF0
    NEW = 0xA2B96EF1


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
    REG = 0x50  # with a submode


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


class AppItem(IntEnum):
    """What application commands set and get."""

    DETECTION_ZONE = 0x96A10A1C
    DETECTION_ZONE_LIMITS = 0x96A10A1D
    SENSITIVITY = 0x10A5112B


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
    """Content of a data message; under `DataType.USER` 1, 3 and 5 mean something else."""

    RAW_FRAME = 0
    I = 1  # noqa: E741 - the field's own name
    Q = 2
    IQ_LEGACY = 3
    ENVELOPE = 4
    DOPPLER_FFT_IN = 5
    DOPPLER_FFT_OUT = 6
    PULSE_DOPPLER_MATRIX = 7
    NOISE_MAP = 8
    FRAME_STORAGE_I = 9
    FRAME_STORAGE_Q = 10
    RAW_FLASH_FRAME = 11
    BASEBAND_IQ = 0x0C
    BASEBAND_AP = 0x0D


class UserContent(IntEnum):
    """Content of a data message of type `DataType.USER`."""

    CONFIGURATION = 1
    RADAR_SETTINGS = 3
    PERFORMANCE = 5


class AppMessage(IntEnum):
    """What an application's message is, after its first byte."""

    BASEBAND_IQ = 0x0C
    BASEBAND_AP = 0x0D
    PULSE_DOPPLER = 0x10
    PULSE_DOPPLER_BYTES = 0x11
    NOISE_MAP = 0x12
    NOISE_MAP_BYTES = 0x13
    VITAL_SIGNS = 0x20020102
    RESPIRATION = 0x2375FE26
    RESPIRATION_EXT = 0x2375A16B
    SLEEP = 0x2375A16C
    PARAMETER_FILE = 0x32BA7623
    DECIM = 0x327645AA
    SLEEP_STAGE = 0x41083A02
    RESPIRATION_MOVING_LIST = 0x610A3B00
    RESPIRATION_DETECTION_LIST = 0x610A3B02
    PRESENCE_SINGLE = 0x723BFA1E
    PRESENCE_MOVING_LIST = 0x723BFA1F
    PRESENCE = 0x991A52BE
    NORMALISED_MOVEMENT_LIST = 0xC3A331CF


class RespirationState(IntEnum):
    """State of the respiration and sleep profiles."""

    BREATHING = 0
    MOVEMENT = 1
    MOVEMENT_TRACKING = 2
    NO_MOVEMENT = 3
    INITIALISING = 4
    ERROR = 5
    UNKNOWN = 6
    HEART_RATE = 7


class PresenceState(IntEnum):
    """State of the X4's presence profile; the X2M300's is 0 or 1."""

    NONE = 0
    PRESENCE = 1
    INITIALISING = 2
    UNKNOWN = 3


class NoiseMapControl(IntFlag):
    """Bits of noise map control."""

    USE_STORED = 1
    ADAPTIVE = 2
    INITIALISE_ON_RESET = 4


class DebugLevel(IntEnum):
    """Argument of debug level."""

    NONE = 0
    ERROR = 1
    WARNING = 2
    INFO = 3
    DEBUG = 4


class X4Setting(IntEnum):
    """What the X4 driver's set, get, write and read name."""

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
    SPI_REGISTER = 0x22
    PIF_REGISTER = 0x23
    XIF_REGISTER = 0x24
    PRF_DIV = 0x25
    FRAME_BIN_COUNT = 0x26
