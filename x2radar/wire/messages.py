"""What host and module say to each other, one frozen class a message, with its bytes.

Fields stand in wire order. A row is all that a message of fixed fields and counted arrays needs;
`x2radar.wire.codec` reads it. What neither driver nor simulated module sends or reads is
`Unknown`, with its bytes and its name. Sources: XTAN-11 rev C, the firmware's public headers,
public clients; what is inferred stands in docs/research/hardware.md.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import NDArray

from x2radar.wire.wire_ids import PING_SEED, X4Setting

_T = TypeVar("_T")
_FloatArray = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Message:
    """Base of all messages; one with fields of its own is a dataclass again."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How one message lies in a packet."""

    cls: type[Message]  # the message class; its fields come in wire order, arrays last
    prefix: bytes
    head: str = ""  # struct format (little-endian) of the fixed fields and the count
    count: int | None = None  # position within `head` of the arrays' length, which is no field
    n_arrays: int = 0  # arrays of float32 behind the head, all of that length
    has_rest: bool = False  # further bytes may follow, and mean nothing
    answer: type[Message] | None = None  # what a module answers a command with, if not by ACK


COMMANDS: list[Layout] = []
"""What a host sends, but for `SetOutput` and `X4Set`, which stand in `codec`."""
RESPONSES: list[Layout] = []
"""What a module sends, but for REPLY and DATA, which have shapes of their own."""


@dataclass_transform(frozen_default=True)
def _row(
    rows: list[Layout], prefix: str, head: str = "", *, eq: bool = True, **more: Any
) -> Callable[[type[_T]], type[_T]]:
    def add(cls: type[_T]) -> type[_T]:
        made: Any = dataclass(frozen=True, slots=True, eq=eq)(cls)
        rows.append(Layout(made, bytes.fromhex(prefix), head, **more))
        return made  # type: ignore[no-any-return]

    return add


@_row(RESPONSES, "01", "I")
class Pong(Message):
    """Answer to a ping (`wire_ids.PongCode`)."""

    code: int


@_row(RESPONSES, "10")
class Ack(Message):
    """The last command was taken."""


@_row(RESPONSES, "20", "I")
class ErrorReply(Message):
    """The last command was refused (`wire_ids.ErrorCode`)."""

    code: int


@_row(RESPONSES, "30", "I", has_rest=True)
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


_ARRAYS: dict[str, Any] = {"head": "IIffff", "count": 1, "n_arrays": 2, "eq": False}


@_row(RESPONSES, "50 0c 00 00 00", **_ARRAYS)
class BasebandIq(_Baseband):
    """One frame of complex baseband as two arrays, shape (n,), float32."""

    i: _FloatArray
    q: _FloatArray


@_row(RESPONSES, "50 0d 00 00 00", **_ARRAYS)
class BasebandAp(_Baseband):
    """One frame of baseband as amplitude and phase (rad), shape (n,), float32."""

    amplitude: _FloatArray
    phase: _FloatArray


@_row(RESPONSES, "a0 14 0c 00 00 00", **_ARRAYS)
class BasebandIqOld(BasebandIq):
    """The same as old X2M200 firmware sends it, as a data message of type 0x14."""


@_row(RESPONSES, "a0 14 0d 00 00 00", **_ARRAYS)
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


@_row(COMMANDS, "01", "I", answer=Pong)
class Ping(Message):
    """Ask whether the module is ready."""

    seed: int = PING_SEED


@_row(COMMANDS, "20", "B")
class SetMode(Message):
    """Switch between run, idle, manual and stop (`wire_ids.Mode`; STOP: X4 only)."""

    mode: int


@_row(COMMANDS, "21", "I")
class LoadProfile(Message):
    """Load an application (`wire_ids.Profile`)."""

    app_id: int


@_row(COMMANDS, "22")
class Reset(Message):
    """Restart the module about half a second from now."""


@_row(COMMANDS, "24", "BB")
class SetLed(Message):
    """Set the LED (`wire_ids.Led`)."""

    mode: int
    reserved: int = 0


@_row(COMMANDS, "26", answer=Reply)
class GetMode(Message):
    """Ask for the mode (newer firmware)."""


@_row(COMMANDS, "10 10 1c 0a a1 96", "ff")
class SetDetectionZone(Message):
    """Set the profile's detection zone, in metres."""

    start_m: float
    end_m: float


@_row(COMMANDS, "10 10 2b 11 a5 10", "I")
class SetSensitivity(Message):
    """Set the profile's sensitivity, 0 to 9."""

    level: int


@dataclass(frozen=True, slots=True)
class SetOutput(Message):
    """APP_SETINT with one value: switch an output (`wire_ids.OutputRef`)."""

    ref: int
    value: int


@_row(COMMANDS, "90 51", "Ii")
class SetSysInt(Message):
    """SYSCFG_SETINT (`wire_ids.SysCfg`)."""

    ref: int
    value: int


@_row(COMMANDS, "90 52", "If")
class SetSysFloat(Message):
    """SYSCFG_SETFLOAT (`wire_ids.SysCfg`)."""

    ref: int
    value: float


@_row(COMMANDS, "90 58", "B", answer=Reply)
class GetSystemInfo(Message):
    """Ask for one item of `wire_ids.InfoItem`."""

    item: int


@_row(COMMANDS, "90 80", "I")
class SetBaudRate(Message):
    """Set the UART's rate, 115,200 at first and 4,000,000 at most; acknowledged at the old one."""

    baud: int


@_row(COMMANDS, "50 20")
class X4Init(Message):
    """Initialise the driver of an X4 module's chip."""


@dataclass(frozen=True, slots=True)
class X4Set(Message):
    """Set one of the X4 driver's settings (`wire_ids.X4Setting`): a number, or two of an area."""

    setting: int
    values: tuple[float, ...]


X4_FORMATS: dict[int, tuple[str, ...]] = {
    X4Setting.FPS: ("f",),
    X4Setting.PULSES_PER_STEP: ("I", "B"),
    X4Setting.ITERATIONS: ("I",),
    X4Setting.DOWN_CONVERSION: ("B",),
    X4Setting.FRAME_AREA: ("ff",),
    X4Setting.DAC_STEP: ("B", "I"),
    X4Setting.DAC_MIN: ("I",),
    X4Setting.DAC_MAX: ("I",),
    X4Setting.FRAME_AREA_OFFSET: ("f",),
    X4Setting.ENABLE: ("B",),
    X4Setting.TX_CENTRE_FREQUENCY: ("B",),
    X4Setting.TX_POWER: ("B",),
    X4Setting.PRF_DIV: ("B",),
}
"""What the values of `X4Set` are, as struct formats; a second width is read, never sent."""
ANSWERS = {row.cls: row.answer for row in COMMANDS if row.answer}
"""What answers a command, where it is not ACK."""
