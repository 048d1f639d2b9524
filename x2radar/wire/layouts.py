"""The tables: which bytes every message is.

Both directions, in the order of the module's documents. A row is all that a message of
fixed fields and counted arrays needs; `x2radar.wire.codec` reads them. Sources: XTAN-11 rev C, the
firmware's public headers, public clients; what is inferred stands in docs/research/hardware.md.
"""

from dataclasses import dataclass

from x2radar.wire import messages as core
from x2radar.wire.messages import Ack, Message, Pong, Reply
from x2radar.wire.wire_ids import AppItem, ContentId, DataType, X4Setting


@dataclass(frozen=True, slots=True)
class Layout:
    """How one message lies in a packet."""

    cls: type[Message]  # the message class; its fields come in wire order, arrays last
    prefix: bytes
    head: str = ""  # struct format (little-endian) of the fixed fields and the count
    count: int | None = None  # position within `head` of the arrays' length, which is no field
    n_arrays: int = 0  # arrays of float32 behind the head, all of that length
    has_rest: bool = False  # further bytes may follow, and mean nothing
    answer: type[Message] = Ack  # what a module answers a command with, unless it refuses


def _u32(value: int) -> bytes:
    return value.to_bytes(4, "little")


def _baseband(cls: type[Message], prefix: bytes, content_id: ContentId) -> Layout:
    return Layout(cls, prefix + _u32(content_id), "IIffff", count=1, n_arrays=2)


def _set_item(item_id: AppItem) -> bytes:
    return b"\x10\x10" + _u32(item_id)


_OLD = bytes([0xA0, DataType.BASEBAND_OLD])

COMMANDS: tuple[Layout, ...] = (
    # Every module.
    Layout(core.Ping, b"\x01", "I", answer=Pong),
    Layout(core.SetMode, b"\x20", "B"),
    Layout(core.LoadProfile, b"\x21", "I"),
    Layout(core.Reset, b"\x22"),
    Layout(core.SetLed, b"\x24", "BB"),
    Layout(core.GetMode, b"\x26", answer=Reply),
    # Profiles.
    Layout(core.SetDetectionZone, _set_item(AppItem.DETECTION_ZONE), "ff"),
    Layout(core.SetSensitivity, _set_item(AppItem.SENSITIVITY), "I"),
    # Radar level and system.
    Layout(core.SetSysInt, b"\x90\x51", "Ii"),
    Layout(core.SetSysFloat, b"\x90\x52", "If"),
    Layout(core.GetSystemInfo, b"\x90\x58", "B", answer=Reply),
    Layout(core.SetBaudRate, b"\x90\x80", "I"),
    # X4 driver.
    Layout(core.X4Init, b"\x50\x20"),
)
"""What a host sends, but for `SetOutput` and `X4Set`, which stand in `codec`."""

RESPONSES: tuple[Layout, ...] = (
    Layout(Pong, b"\x01", "I"),
    Layout(Ack, b"\x10"),
    Layout(core.ErrorReply, b"\x20", "I"),
    Layout(core.SystemMessage, b"\x30", "I", has_rest=True),
    _baseband(core.BasebandIqOld, _OLD, ContentId.BASEBAND_IQ),
    _baseband(core.BasebandApOld, _OLD, ContentId.BASEBAND_AP),
    _baseband(core.BasebandIq, b"\x50", ContentId.BASEBAND_IQ),
    _baseband(core.BasebandAp, b"\x50", ContentId.BASEBAND_AP),
)
"""What a module sends, but for REPLY and DATA, which have shapes of their own."""

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

ANSWERS: dict[type[Message], type[Message]] = {
    row.cls: row.answer for row in COMMANDS if row.answer is not Ack
}
"""What answers a command, where it is not ACK."""
