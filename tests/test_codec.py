"""Messages against the specification's bytes, round trips of every row, and broken packets."""

import contextlib
import struct
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as np_st

from x2radar import framing, messages, messages_expert, messages_status
from x2radar.codec import decode_any, decode_command, decode_response, encode
from x2radar.errors import MessageError
from x2radar.layouts import COMMANDS, RESPONSES, VARIANTS, Layout
from x2radar.messages import (
    Ack,
    BasebandAp,
    BasebandIq,
    Data,
    ErrorReply,
    GetMode,
    GetSystemInfo,
    LoadProfile,
    Message,
    Ping,
    Pong,
    Reply,
    Reset,
    SetBaudRate,
    SetDetectionZone,
    SetLed,
    SetMode,
    SetOutput,
    SetSensitivity,
    SetSysFloat,
    SetSysInt,
    SystemMessage,
    Unknown,
)
from x2radar.messages_status import PresenceStatus, RespirationStatus, SleepStatus
from x2radar.wire_ids import (
    BasebandOutput,
    ErrorCode,
    InfoItem,
    Led,
    Mode,
    OutputRef,
    PongCode,
    Profile,
    SysCfg,
    SystemCode,
)

COMMAND_BYTES = [
    (Ping(), "01 ae ea aa ee"),
    (Reset(), "22"),
    (SetMode(Mode.RUN), "20 01"),
    (SetMode(Mode.IDLE), "20 11"),
    (SetMode(Mode.MANUAL), "20 12"),
    (SetMode(Mode.STOP), "20 13"),
    (GetMode(), "26"),
    (LoadProfile(Profile.RESPIRATION), "21 d6 a2 23 14"),
    (LoadProfile(Profile.SLEEP), "21 17 7b f1 00"),
    (LoadProfile(Profile.PRESENCE), "21 12 89 28 00"),
    (SetLed(Led.FULL), "24 02 00"),
    (SetLed(Led.OFF), "24 00 00"),
    (SetDetectionZone(1.7999999523162842, 2.5), "10 10 1c 0a a1 96 66 66 e6 3f 00 00 20 40"),
    (SetSensitivity(9), "10 10 2b 11 a5 10 09 00 00 00"),
    (SetBaudRate(921_600), "90 80 00 10 0e 00"),
    (GetSystemInfo(InfoItem.FIRMWARE_ID), "90 58 02"),
    (
        SetOutput(OutputRef.BASEBAND, BasebandOutput.AMPLITUDE_PHASE),
        "90 71 10 00 00 00 01 00 00 00 02 00 00 00",
    ),
    (SetSysInt(SysCfg.FPS, 60), "90 51 1a 00 00 00 3c 00 00 00"),
    (SetSysInt(SysCfg.DAC_MIN, -1), "90 51 13 00 00 00 ff ff ff ff"),
    (SetSysFloat(SysCfg.SAMPLE_DELAY, 0.5), "90 52 15 00 00 00 00 00 00 3f"),
]
RESPONSE_BYTES = [
    (Pong(PongCode.READY), "01 ea ae ee aa"),
    (Pong(PongCode.NOT_READY), "01 aa ee ea ae"),
    (Pong(PongCode.SAFE_MODE), "01 ef fe ee ff"),
    (Ack(), "10"),
    (SystemMessage(SystemCode.BOOTING), "30 10 00 00 00"),
    (SystemMessage(SystemCode.READY), "30 11 00 00 00"),
    (ErrorReply(ErrorCode.NOT_RECOGNIZED), "20 01 00 00 00"),
    (ErrorReply(ErrorCode.COMMAND_FAILED), "20 21 00 00 00"),
    (
        RespirationStatus(7, 0, 14, 1.5, -2.0, 9),
        "50 26 fe 75 23 07 00 00 00 00 00 00 00 0e 00 00 00 00 00 c0 3f 00 00 00 c0 09 00 00 00",
    ),
    (
        SleepStatus(1, 2, 12.5, 0.5, 3, 1.0, 2.0),
        "50 6c a1 75 23 01 00 00 00 02 00 00 00 00 00 48 41 00 00 00 3f 03 00 00 00"
        "00 00 80 3f 00 00 00 40",
    ),
    (
        PresenceStatus(1, 2.0, 0.5, 4),
        "50 be 52 1a 99 01 00 00 00 00 00 00 40 00 00 00 3f 04 00 00 00",
    ),
    (Reply(0x58, 3, "1.0"), "11 13 58 00 00 00 03 00 00 00 03 00 00 00 31 2e 30 01"),
    (Reply(0x58, 3, ""), "11 13 58 00 00 00 03 00 00 00 01"),
    (Reply(1, 2, (-3,)), "11 11 01 00 00 00 02 00 00 00 01 00 00 00 fd ff ff ff"),
    (Reply(1, 2, ()), "11 11 01 00 00 00 02 00 00 00"),
    (Reply(1, 2, (0.5,)), "11 12 01 00 00 00 02 00 00 00 01 00 00 00 00 00 00 3f 04"),
]
IQ_HEAD = "02 00 00 00 00 00 00 3d 00 00 20 51 00 00 c0 50 00 00 80 3e"
IQ_ARRAYS = "00 00 80 3f 00 00 00 40 00 00 40 40 00 00 80 40"

u32 = st.integers(0, 2**32 - 1)
i32 = st.integers(-(2**31), 2**31 - 1)
u8 = st.integers(0, 255)
f32 = st.floats(width=32, allow_nan=False)
FIELD = {"I": u32, "i": i32, "B": u8, "f": f32}


def float_arrays(n: int) -> st.SearchStrategy:
    return np_st.arrays("<f4", n, elements=st.floats(width=32))


def arrays_of(n: int, dtype: str) -> st.SearchStrategy:
    return float_arrays(n) if dtype == "<f4" else np_st.arrays(dtype, n)


def messages_of(row: Layout) -> st.SearchStrategy[Message]:
    """Draw every field of a row from what its place on the wire can hold."""
    scalars = [FIELD[code] for k, code in enumerate(row.head) if k not in row.counts]
    if not row.arrays:
        return st.builds(row.cls, *scalars)
    lengths = st.tuples(*(st.integers(0, 20) for _ in row.counts))
    return lengths.flatmap(
        lambda n: st.builds(row.cls, *scalars, *(arrays_of(n[k], dt) for k, dt in row.arrays))
    )


def values_of(message: Message) -> list:
    assert is_dataclass(message)
    return [getattr(message, field.name) for field in fields(message)]


def same(one: Message, other: Message) -> bool:
    """Compare with NaN equal to itself, and arrays by element and type."""
    return type(one) is type(other) and all(
        np.array_equal(a, b, equal_nan=True) and a.dtype == b.dtype
        if isinstance(a, np.ndarray)
        else a == b
        for a, b in zip(values_of(one), values_of(other), strict=True)
    )


replies = st.builds(
    Reply,
    u32,
    u32,
    st.one_of(
        st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=9),
        st.lists(i32, max_size=5).map(tuple),
        st.lists(f32, min_size=1, max_size=5).map(tuple),
    ),
)
data_messages = st.builds(
    Data,
    u32,
    u32,
    st.one_of(st.integers(0, 20).flatmap(float_arrays), np_st.arrays("u1", st.integers(0, 20))),
)
command_messages = st.one_of(
    *(messages_of(row) for row in (*COMMANDS, VARIANTS[0])), st.builds(SetOutput, u32, u32)
)
response_messages = st.one_of(
    *(messages_of(row) for row in (*RESPONSES, VARIANTS[1])),
    replies,
    data_messages,
    st.builds(ErrorReply, u32),
)


# ---------------------------------------------------------------- the specification's bytes


@pytest.mark.parametrize(("message", "wire"), COMMAND_BYTES, ids=str)
def test_command_bytes(message: Message, wire: str) -> None:
    assert encode(message) == bytes.fromhex(wire)
    assert decode_command(bytes.fromhex(wire)) == message
    assert decode_any(bytes.fromhex(wire)) == message


@pytest.mark.parametrize(("message", "wire"), RESPONSE_BYTES, ids=str)
def test_response_bytes(message: Message, wire: str) -> None:
    assert encode(message) == bytes.fromhex(wire)
    assert decode_response(bytes.fromhex(wire)) == message
    assert decode_any(bytes.fromhex(wire)) == message


@pytest.mark.parametrize(
    ("cls", "wire"),
    [
        (BasebandIq, f"50 0c 00 00 00 09 00 00 00 {IQ_HEAD} {IQ_ARRAYS}"),
        (BasebandAp, f"50 0d 00 00 00 09 00 00 00 {IQ_HEAD} {IQ_ARRAYS}"),
    ],
)
def test_baseband_bytes(cls: type, wire: str) -> None:
    expected = cls(
        9,
        0.03125,
        42949672960.0,
        25769803776.0,
        0.25,
        np.array([1, 2], np.float32),
        np.array([3, 4], np.float32),
    )
    data = bytes.fromhex(wire)
    assert len(data) == 29 + 8 * 2
    assert same(decode_response(data), expected)
    assert same(decode_any(data), expected)
    assert encode(expected) == data


@pytest.mark.parametrize(("content_id", "cls"), [(0x0C, BasebandIq), (0x0D, BasebandAp)])
def test_old_baseband_form(content_id: int, cls: type) -> None:
    head = struct.pack("<BBII", 0xA0, 0x14, content_id, 9)
    message = decode_response(head + bytes.fromhex(f"{IQ_HEAD} {IQ_ARRAYS}"))
    assert isinstance(message, cls)
    assert values_of(message)[:2] == [9, 0.03125]
    assert values_of(message)[-1].tolist() == [3, 4]
    with pytest.raises(MessageError, match="cut short"):
        decode_response(head + bytes.fromhex(IQ_HEAD))


def test_raw_frame_bytes() -> None:
    values = np.array([0.5, -2], np.float32)
    data = bytes.fromhex("a0 12 00 00 00 00 07 00 00 00 02 00 00 00 00 00 00 3f 00 00 00 c0")
    assert encode(Data(0, 7, values)) == data
    assert same(decode_response(data), Data(0, 7, values))


@pytest.mark.parametrize(
    "wire", ["a0 12 00 00 00 00 07 00 00 00", "a0 12 00 00 00 00 07 00 00 0000 00 00 00"]
)
def test_data_without_elements(wire: str) -> None:
    message = decode_response(bytes.fromhex(wire))
    assert isinstance(message, Data)
    assert message.info == 7
    assert message.values.shape == (0,)
    assert not message.values.flags.writeable


def test_error_with_a_single_byte() -> None:
    assert decode_response(b"\x20\x21") == ErrorReply(ErrorCode.COMMAND_FAILED)


def test_system_message_with_extra_bytes() -> None:
    assert decode_response(bytes.fromhex("30 11 00 00 00 01 02")) == SystemMessage(0x11)


@pytest.mark.parametrize(
    ("wire", "value"),
    [
        ("11 10 01 00 00 00 02 00 00 00 02 00 00 00 07 ff 01", (7, 255)),
        ("11 10 01 00 00 00 02 00 00 00 02 00 00 00 07 ff", (7, 255)),
        ("11 11 01 00 00 00 02 00 00 00 01 00 00 00 05 00 00 00 04", (5,)),
        ("11 13 01 00 00 00 02 00 00 00 04 00 00 00 41 42 00 00 01", "AB"),
        ("11 13 01 00 00 00 02 00 00 00 01 00 00 00 ff 01", "\ufffd"),
    ],
)
def test_reply_forms_that_only_modules_send(wire: str, value: object) -> None:
    assert decode_response(bytes.fromhex(wire)) == Reply(1, 2, value)


@pytest.mark.parametrize(
    "wire",
    [
        "",
        "c0 00",
        "a0 50 01 00 00 00 02 00 00 00 ff",
        "11 50 01 00 00 00 02 00 00 00 ff",
        "50 6b a1 75 23 00",
    ],
)
def test_what_no_row_describes_is_kept(wire: str) -> None:
    data = bytes.fromhex(wire)
    assert decode_response(data) == decode_any(data) == Unknown(data)
    assert encode(Unknown(data)) == data


def test_several_output_values_are_kept_as_unknown() -> None:
    data = struct.pack("<BBIIII", 0x90, 0x71, 0x10, 2, 1, 1)
    assert decode_command(data) == Unknown(data)


def test_every_message_class_is_in_a_table_or_tested_by_itself() -> None:
    classes = {
        c
        for module in (messages, messages_status, messages_expert)
        for c in vars(module).values()
        if isinstance(c, type) and issubclass(c, Message)
    }
    rows = {row.cls for row in COMMANDS + RESPONSES + VARIANTS}
    assert classes - rows == {Message, SetOutput, ErrorReply, Data, Reply, Unknown}


# ---------------------------------------------------------------- round trips


@settings(max_examples=300)
@given(command_messages)
def test_round_trip_of_commands(message: Message) -> None:
    data = encode(message)
    assert same(decode_command(data), message)
    if not isinstance(message, Ping) or message == Ping():
        # A ping with another seed cannot be told from a pong.
        assert same(decode_any(data), message)


@settings(max_examples=300)
@given(response_messages)
def test_round_trip_of_responses(message: Message) -> None:
    data = encode(message)
    assert same(decode_response(data), message)
    if data != encode(Ping()):
        assert same(decode_any(data), message)


@given(response_messages)
def test_arrays_are_read_only(message: Message) -> None:
    for value in values_of(decode_response(encode(message))):
        assert not isinstance(value, np.ndarray) or not value.flags.writeable


@given(np_st.arrays("f8", 3, elements=st.floats(-1e6, 1e6)))
def test_other_float_arrays_are_sent_as_float32(values: np.ndarray) -> None:
    message = decode_response(encode(Data(0, 1, values)))
    assert isinstance(message, Data)
    np.testing.assert_array_equal(message.values, values.astype(np.float32))


# ---------------------------------------------------------------- what does not fit


@pytest.mark.parametrize(
    "message",
    [
        SetMode(256),
        SetLed(-1),
        SetSensitivity(2**32),
        SetSysInt(1, 2**31),
        SetDetectionZone(1e39, 2),
        SetDetectionZone("near", "far"),
        SetOutput(1, -1),
        ErrorReply(-1),
        Reply(0, 0, "\ud800"),
        Reply(0, 0, (2**31,)),
        Reply(0, 0, 5),
        Data(-1, 0, np.zeros(1, np.float32)),
        Data(0, 0, np.array(["a"])),
        BasebandIq(1, 1.0, 1.0, 1.0, 1.0, np.zeros(2), np.zeros(3)),
        Message(),
    ],
    ids=str,
)
def test_fields_that_do_not_fit_raise_message_error(message: Message) -> None:
    with pytest.raises(MessageError, match="does not fit the wire"):
        encode(message)


SAME_PREFIX = [
    row
    for row in COMMANDS + RESPONSES
    if any(row.prefix == other.prefix for other in VARIANTS) and not row.arrays
]


@given(command_messages, st.binary(min_size=1, max_size=5))
def test_cut_and_over_long_commands(message: Message, more: bytes) -> None:
    data = encode(message)
    for k in range(prefix_length(data), len(data)):
        if not is_variant(data[:k]):
            with pytest.raises(MessageError):
                decode_command(data[:k])
    if not is_variant(data + more):
        with pytest.raises(MessageError):
            decode_command(data + more)


def prefix_length(data: bytes) -> int:
    """Return how many bytes tell which command it is."""
    if data[:2] == b"\x90\x71":
        return 2
    return max(len(row.prefix) for row in COMMANDS if data.startswith(row.prefix))


def is_variant(data: bytes) -> bool:
    """Say whether the bytes are another message of the same prefix, known by its length."""
    whole = [(row.prefix, struct.calcsize("<" + row.head)) for row in (*SAME_PREFIX, *VARIANTS)]
    return any(data.startswith(p) and len(data) == len(p) + size for p, size in whole)


@given(response_messages, st.binary(min_size=2, max_size=5))
def test_cut_and_over_long_responses(message: Message, more: bytes) -> None:
    data = encode(message)
    for k in range(5 if data[0] == 0x50 else 1, len(data)):
        if not is_whole(data, k) and not is_variant(data[:k]):
            with pytest.raises(MessageError):
                decode_response(data[:k])
    if isinstance(message, SystemMessage):
        assert decode_response(data + more) == message
    elif not has_no_elements(message) and not is_variant(data + more):
        with pytest.raises(MessageError):
            decode_response(data + more)


def is_whole(data: bytes, k: int) -> bool:
    """Say whether the first `k` bytes are a shorter message that is sound as well."""
    match data[0]:
        case 0x11:
            # No elements, with and without element size; or all but the element size.
            return k in {10, 11} or (k == len(data) - 1 and data[1] != 0x11)
        case 0xA0:
            return k == 10
        case 0x20:
            return k == 2
    return False


def has_no_elements(message: Message) -> bool:
    """Say whether bytes behind a message would be read as its count."""
    match message:
        case Data(values=values):
            return values.size == 0
        case Reply(value=value):
            return len(value) == 0
    return False


@pytest.mark.parametrize(
    "wire",
    [
        "a0 12 00 00 00 00 07 00 00 00 00 00 00 00 01",
        "a0 12 00 00 00 00 07 00 00 00 ff ff ff ff 00",
        "50 0c 00 00 00 09 00 00 00 ff ff ff ff 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00",
        "11 12 00 00 00 00 07 00 00 00 ff ff ff ff 00",
        "11 12 00 00 00 00 07 00 00 00 00 00 00 00 04 04",
        "11 12 00 00 00 00 07 00 00 00 01 00",
        "20",
        "20 01 00 00",
        "20 01 00 00 00 00",
    ],
)
def test_counts_and_lengths_that_lie(wire: str) -> None:
    with pytest.raises(MessageError):
        decode_response(bytes.fromhex(wire))


@pytest.mark.parametrize(
    "wire", ["90 71", "90 71 10 00 00 00 01 00 00 00", "90 71 10 00 00 00 00 00 00 00 01 00 00 00"]
)
def test_output_command_without_count_or_value(wire: str) -> None:
    with pytest.raises(MessageError):
        decode_command(bytes.fromhex(wire))


FIRST_BYTES = st.sampled_from(
    [row.prefix for row in COMMANDS + RESPONSES]
    + [b"\x90\x71", b"\x20"]
    + [bytes([first, kind]) for first in (0xA0, 0x11) for kind in (0x10, 0x11, 0x12, 0x13, 0x14)]
    + [struct.pack("<BBI", 0xA0, 0x14, content) for content in (0x0C, 0x0D)]
)


@settings(max_examples=500)
@given(st.one_of(st.just(b""), FIRST_BYTES), st.binary(max_size=60))
def test_any_bytes_raise_nothing_but_message_error(first: bytes, rest: bytes) -> None:
    for read in (decode_command, decode_response, decode_any):
        with contextlib.suppress(MessageError):
            assert isinstance(read(first + rest), Message)


VECTORS = {
    # command: (bytes of the whole packet, also printed by an outside source)
    "ping": (Ping(), "7d 01 ae ea aa ee 7c 7e", True),
    "reset": (Reset(), "7d 22 5f 7e", True),
    "run": (SetMode(Mode.RUN), "7d 20 01 5c 7e", True),
    "idle": (SetMode(Mode.IDLE), "7d 20 11 4c 7e", True),
    "manual": (SetMode(Mode.MANUAL), "7d 20 12 4f 7e", True),
    "stop": (SetMode(Mode.STOP), "7d 20 13 4e 7e", True),
    "load respiration": (
        LoadProfile(Profile.RESPIRATION),
        "7d 21 d6 a2 23 14 1f 7e",
        True,
    ),
    "load sleep": (LoadProfile(Profile.SLEEP), "7d 21 17 7b f1 00 c1 7e", True),
    "load presence": (LoadProfile(Profile.PRESENCE), "7d 21 12 89 28 00 ef 7e", False),
    "led full": (SetLed(Led.FULL), "7d 24 02 00 5b 7e", True),
    "led off": (SetLed(Led.OFF), "7d 24 00 00 59 7e", False),
    "zone 1.8 to 2.5": (
        SetDetectionZone(1.8, 2.5),
        "7d 10 10 1c 0a a1 96 66 66 e6 3f 00 00 20 40 e5 7e",
        True,
    ),
    "zone 0.4 to 2.0": (
        SetDetectionZone(0.4, 2.0),
        "7d 10 10 1c 0a a1 96 cd cc cc 3e 00 00 00 40 ef 7e",
        False,
    ),
    "sensitivity 9": (SetSensitivity(9), "7d 10 10 2b 11 a5 10 09 00 00 00 fb 7e", True),
    "baseband off": (
        SetOutput(OutputRef.BASEBAND, 0),
        "7d 90 71 10 00 00 00 01 00 00 00 00 00 00 00 8d 7e",
        False,
    ),
    "baseband iq": (
        SetOutput(OutputRef.BASEBAND, 1),
        "7d 90 71 10 00 00 00 01 00 00 00 01 00 00 00 8c 7e",
        False,
    ),
    "baseband ap": (
        SetOutput(OutputRef.BASEBAND, 2),
        "7d 90 71 10 00 00 00 01 00 00 00 02 00 00 00 8f 7e",
        False,
    ),
    "baud 921600": (SetBaudRate(921_600), "7d 90 80 00 10 0e 00 73 7e", False),
    "firmware id": (GetSystemInfo(InfoItem.FIRMWARE_ID), "7d 90 58 02 b7 7e", False),
    "x4 20 fps": (
        messages_expert.X4SetFrameRate(20.0),
        "7d 50 10 10 00 00 00 00 00 a0 41 cc 7e",
        True,
    ),
}


@pytest.mark.parametrize("name", VECTORS)
def test_commands_are_byte_equal_to_the_documents(name: str) -> None:
    command, wire, _ = VECTORS[name]
    assert framing.encode(encode(command)) == bytes.fromhex(wire)
    assert decode_any(encode(command)) == decode_command(encode(command))


def test_how_many_commands_an_outside_source_prints() -> None:
    # docs/hardware.md states these counts.
    assert len(VECTORS) == 20
    assert sum(outside for _, _, outside in VECTORS.values()) == 12
