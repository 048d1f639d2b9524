"""What host and module say to each other, one frozen class a message.

Fields stand in wire order. Which bytes they become is `x2radar.codec`'s business.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.wire_ids import PING_SEED

FloatArray = NDArray[np.float32]
ByteArray = NDArray[np.uint8]


class Message:
    """Base of everything that a packet can say."""

    __slots__ = ()


# ---------------------------------------------------------------- host to module


@dataclass(frozen=True, slots=True)
class Ping(Message):
    """Ask whether the module is ready."""

    seed: int = PING_SEED


@dataclass(frozen=True, slots=True)
class Reset(Message):
    """Restart the module about half a second from now."""


@dataclass(frozen=True, slots=True)
class SetMode(Message):
    """Switch between run, idle, manual and stop (`wire_ids.Mode`)."""

    mode: int


@dataclass(frozen=True, slots=True)
class GetMode(Message):
    """Ask for the mode (newer firmware)."""


@dataclass(frozen=True, slots=True)
class LoadProfile(Message):
    """Load an application (`wire_ids.Profile`)."""

    app_id: int


@dataclass(frozen=True, slots=True)
class SetLed(Message):
    """Set the LED (`wire_ids.Led`)."""

    mode: int
    reserved: int = 0


@dataclass(frozen=True, slots=True)
class SetDetectionZone(Message):
    """Set the profile's detection zone, in metres."""

    start_m: float
    end_m: float


@dataclass(frozen=True, slots=True)
class SetSensitivity(Message):
    """Set the profile's sensitivity, 0 to 9."""

    level: int


@dataclass(frozen=True, slots=True)
class SetBaudRate(Message):
    """Set the UART's rate; acknowledged at the old rate."""

    baud: int


@dataclass(frozen=True, slots=True)
class GetSystemInfo(Message):
    """Ask for one item of `wire_ids.InfoItem`."""

    item: int


@dataclass(frozen=True, slots=True)
class SetOutput(Message):
    """APP_SETINT with one value: switch an output (`wire_ids.OutputRef`)."""

    ref: int
    value: int
    count: int = 1


@dataclass(frozen=True, slots=True)
class SetSysInt(Message):
    """SYSCFG_SETINT (`wire_ids.SysCfg`)."""

    ref: int
    value: int


@dataclass(frozen=True, slots=True)
class SetSysFloat(Message):
    """SYSCFG_SETFLOAT (`wire_ids.SysCfg`)."""

    ref: int
    value: float


# ---------------------------------------------------------------- module to host


@dataclass(frozen=True, slots=True)
class Pong(Message):
    """Answer to a ping (`wire_ids.PongCode`)."""

    code: int


@dataclass(frozen=True, slots=True)
class Ack(Message):
    """The last command was taken."""


@dataclass(frozen=True, slots=True)
class ErrorReply(Message):
    """The last command was refused (`wire_ids.ErrorCode`)."""

    code: int


@dataclass(frozen=True, slots=True)
class SystemMessage(Message):
    """The module boots or is ready (`wire_ids.SystemCode`)."""

    code: int


@dataclass(frozen=True, slots=True, eq=False)
class BasebandIq(Message):
    """One frame of complex baseband as two arrays, shape (n,), float32."""

    counter: int
    bin_length_m: float
    sample_rate_hz: float
    carrier_hz: float
    range_offset_m: float
    i: FloatArray
    q: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class BasebandAp(Message):
    """One frame of baseband as amplitude and phase (rad), shape (n,), float32."""

    counter: int
    bin_length_m: float
    sample_rate_hz: float
    carrier_hz: float
    range_offset_m: float
    amplitude: FloatArray
    phase: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Data(Message):
    """Data of one type: `content_id` says what, `info` is the frame counter."""

    content_id: int
    info: int
    values: FloatArray | ByteArray


@dataclass(frozen=True, slots=True)
class Reply(Message):
    """Answer to a question: `value` is a str, or a tuple of ints or floats."""

    content_id: int
    info: int
    value: str | tuple[int, ...] | tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Unknown(Message):
    """A sound packet that no table row describes, kept as it came."""

    data: bytes
