"""What host and module say to each other, one frozen class a message.

Fields stand in wire order. Which bytes they become is the business of `x2radar.wire.layouts` and
`x2radar.wire.codec`. What neither driver nor simulated module sends or reads is `Unknown`, with
its bytes and its name. A docstring with the word inferred marks what no document or client
settles; docs/research/hardware.md gives the reasons.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from x2radar.wire.wire_ids import PING_SEED

_FloatArray = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Message:
    """Base of all messages; one with fields of its own is a dataclass again."""


# ---------------------------------------------------------------- host to module


@dataclass(frozen=True, slots=True)
class Ping(Message):
    """Ask whether the module is ready."""

    seed: int = PING_SEED


class Reset(Message):
    """Restart the module about half a second from now."""


@dataclass(frozen=True, slots=True)
class SetMode(Message):
    """Switch between run, idle, manual and stop (`wire_ids.Mode`; STOP: X4 only)."""

    mode: int


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
    """Set the UART's rate, 115,200 at first and 4,000,000 at most; acknowledged at the old one."""

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


class X4Init(Message):
    """Initialise the driver of an X4 module's chip."""


@dataclass(frozen=True, slots=True)
class X4Set(Message):
    """Set one of the X4 driver's settings (`wire_ids.X4Setting`): a number, or two of an area."""

    setting: int
    values: tuple[float, ...]


# ---------------------------------------------------------------- module to host


@dataclass(frozen=True, slots=True)
class Pong(Message):
    """Answer to a ping (`wire_ids.PongCode`)."""

    code: int


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
class _Baseband(Message):
    counter: int
    bin_length_m: float
    sample_rate_hz: float
    carrier_hz: float
    range_offset_m: float


@dataclass(frozen=True, slots=True, eq=False)
class BasebandIq(_Baseband):
    """One frame of complex baseband as two arrays, shape (n,), float32."""

    i: _FloatArray
    q: _FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class BasebandAp(_Baseband):
    """One frame of baseband as amplitude and phase (rad), shape (n,), float32."""

    amplitude: _FloatArray
    phase: _FloatArray


class BasebandIqOld(BasebandIq):
    """The same as old X2M200 firmware sends it, as a data message of type 0x14."""


class BasebandApOld(BasebandAp):
    """The same as old X2M200 firmware sends it, as a data message of type 0x14."""


@dataclass(frozen=True, slots=True, eq=False)
class Data(Message):
    """Numbers of one type: `content_id` says what (`wire_ids.ContentId`).

    `info` is the frame counter. float32, uint8 and int32 keep their type on the wire (int32
    is inferred from replies); other arrays go as float32.
    """

    content_id: int
    info: int
    values: _FloatArray | NDArray[np.uint8] | NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Reply(Message):
    """Answer to a question: `value` is a str, or a tuple of ints or floats."""

    content_id: int
    info: int
    value: str | tuple[int, ...] | tuple[float, ...]


class ByteReply(Reply):
    """The same with one byte a number, 0 to 255."""


@dataclass(frozen=True, slots=True)
class Unknown(Message):
    """A sound packet that no table row describes, kept as it came; any bytes can be sent."""

    data: bytes
    name: str = field(default="", compare=False)  # the maker's name, where known (`wire_ids`)
