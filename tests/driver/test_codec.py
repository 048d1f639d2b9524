"""The specification's bytes of everyday messages, odd forms, and fields that do not fit."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as np_st

from tests.codec_helpers import same, values_of
from x2radar.errors import MessageError
from x2radar.wire.codec import decode_any, decode_command, decode_response, encode
from x2radar.wire.messages import (
    Ack,
    BasebandAp,
    BasebandApOld,
    BasebandIq,
    BasebandIqOld,
    ByteReply,
    Data,
    DataText,
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
    UserData,
    UserReply,
)
from x2radar.wire.messages_expert import SetAppInts, SetDebugOutput, SetOutputUncounted
from x2radar.wire.messages_status import (
    ParameterFile,
    PresenceStatus,
    RespirationStatus,
    SleepStatus,
)
from x2radar.wire.messages_x4 import X4SetDacStep, X4SetPulsesPerStep
from x2radar.wire.wire_ids import (
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


@pytest.mark.parametrize(("content_id", "cls"), [(0x0C, BasebandIqOld), (0x0D, BasebandApOld)])
def test_old_baseband_form(content_id: int, cls: type) -> None:
    head = struct.pack("<BBII", 0xA0, 0x14, content_id, 9)
    data = head + bytes.fromhex(f"{IQ_HEAD} {IQ_ARRAYS}")
    message = decode_response(data)
    assert type(message) is cls
    assert isinstance(message, (BasebandIq, BasebandAp))
    assert values_of(message)[:2] == [9, 0.03125]
    assert values_of(message)[-1].tolist() == [3, 4]
    assert encode(message) == data
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


@pytest.mark.parametrize("n", [0, 1, 2])
def test_few_elements_are_sent_and_none_without_a_count(n: int) -> None:
    values = np.arange(1, n + 1, dtype=np.float32)
    data = encode(Data(0, 7, values))
    assert len(data) == (10 if n == 0 else 14 + 4 * n)
    assert same(decode_response(data), Data(0, 7, values))


def test_error_with_a_single_byte() -> None:
    assert decode_response(b"\x20\x21") == ErrorReply(ErrorCode.COMMAND_FAILED)


def test_system_message_with_extra_bytes() -> None:
    assert decode_response(bytes.fromhex("30 11 00 00 00 01 02")) == SystemMessage(0x11)


@pytest.mark.parametrize(
    ("wire", "expected"),
    [
        (
            "11 10 01 00 00 00 02 00 00 00 02 00 00 00 07 ff 01",
            ByteReply(1, 2, (7, 255)),
        ),
        ("11 10 01 00 00 00 02 00 00 00 02 00 00 00 07 ff", ByteReply(1, 2, (7, 255))),
        ("11 11 01 00 00 00 02 00 00 00 01 00 00 00 05 00 00 00 04", Reply(1, 2, (5,))),
        ("11 13 01 00 00 00 02 00 00 00 04 00 00 00 41 42 00 00 01", Reply(1, 2, "AB")),
        ("11 13 01 00 00 00 02 00 00 00 01 00 00 00 ff 01", Reply(1, 2, "\ufffd")),
        ("11 50 01 00 00 00 02 00 00 00 ff 01", UserReply(1, 2, b"\xff\x01")),
        ("a0 50 03 00 00 00 02 00 00 00 ff", UserData(3, 2, b"\xff")),
        ("a0 13 00 00 00 00 02 00 00 00 03 00 00 00 41 42 00", DataText(0, 2, "AB")),
    ],
)
def test_forms_of_replies_and_data(wire: str, expected: Message) -> None:
    assert decode_response(bytes.fromhex(wire)) == decode_any(bytes.fromhex(wire)) == expected


def test_whole_numbers_keep_their_type() -> None:
    values = np.array([-1, 5], np.int32)
    data = bytes.fromhex("a0 11 0b 00 00 00 07 00 00 00 02 00 00 00 ff ff ff ff 05 00 00 00")
    assert encode(Data(11, 7, values)) == data
    assert same(decode_response(data), Data(11, 7, values))


def test_octets_keep_their_type() -> None:
    values = np.array([7, 255], np.uint8)
    data = bytes.fromhex("a0 10 0b 00 00 00 07 00 00 00 02 00 00 00 07 ff")
    assert encode(Data(11, 7, values)) == data
    assert same(decode_response(data), Data(11, 7, values))


@pytest.mark.parametrize("wire", ["", "77", "a0 15 01 00 00 00 02 00 00 00", "03 00", "51 01"])
def test_what_no_row_describes_is_kept(wire: str) -> None:
    data = bytes.fromhex(wire)
    assert decode_response(data) == decode_any(data) == Unknown(data)
    assert encode(Unknown(data)) == data


def test_several_output_values() -> None:
    data = struct.pack("<BBIIII", 0x90, 0x71, 0x10, 2, 1, 3)
    message = SetAppInts(0x10, np.array([1, 3], np.uint32))
    assert same(decode_command(data), message)
    assert encode(message) == data


def test_output_command_of_the_early_document() -> None:
    data = bytes.fromhex("90 71 10 00 00 00 01 00 00 00")
    assert decode_command(data) == SetOutputUncounted(0x10, 1)
    assert encode(SetOutputUncounted(0x10, 1)) == data


@pytest.mark.parametrize(
    ("wire", "expected"),
    [
        # XTAN-11 prints one byte where its text has four; a client sends four for one.
        ("50 10 11 00 00 00 14", X4SetPulsesPerStep(20)),
        ("50 10 15 00 00 00 01 00 00 00", X4SetDacStep(1)),
    ],
)
def test_other_widths_of_x4_settings(wire: str, expected: Message) -> None:
    data = bytes.fromhex(wire)
    assert decode_command(data) == decode_any(data) == expected
    assert decode_command(encode(expected)) == expected


@pytest.mark.parametrize(
    ("wire", "is_command"),
    [
        ("10", False),
        ("10 13", True),
        ("20 01", True),
        ("20 10 01", True),
        ("20 01 00 00 00", False),
        ("01 ae ea aa ee", True),
        ("01 ea ae ee aa", False),
        ("a0", False),
        ("50 20", True),
        ("50 11 10 00 00 00", True),
        ("50 10 23 00 00 00" + "00" * 20, True),
        ("50 10 00 00 00" + "00" * 44, False),
        ("50 12 00 00 00" + "00" * 44, False),
        # The X4 driver's longest setting has 14 bytes; what is longer is a profile's message.
        ("50 10 00 00 00" + "00" * 9, True),
        ("50 10 00 00 00" + "00" * 10, False),
        ("50 10", False),
        ("50 10 11", True),
        ("01 ae ea aa ee 00", True),
        ("50", False),
        ("c0 00", True),
        ("12 00", False),
        ("e0", False),
    ],
)
def test_direction_of_a_packet(wire: str, is_command: bool) -> None:
    def read(decode) -> Message | str:
        try:
            return decode(bytes.fromhex(wire))
        except MessageError as err:
            return str(err)

    one, other = read(decode_any), read(decode_command if is_command else decode_response)
    assert same(one, other) if isinstance(one, Message) else one == other


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
        ByteReply(0, 0, (256,)),
        DataText(0, 0, "\ud800"),
        UserReply(0, 0, 5),
        SetDebugOutput("text"),
        SetAppInts(0, np.array([-1])),
        SetAppInts(0, np.array([0.5])),
        ParameterFile(np.array([256]), np.zeros(1, np.uint8)),
        Data(-1, 0, np.zeros(1, np.float32)),
        Data(0, 0, np.array(["a"])),
        Data(0, 0, np.array([1e39])),
        BasebandIq(1, 1.0, 1.0, 1.0, 1.0, np.zeros(2), np.zeros(3)),
        pytest.param(Message(), id="Message"),
    ],
    ids=str,
)
def test_fields_that_do_not_fit_raise_message_error(message: Message) -> None:
    with pytest.raises(MessageError, match="does not fit the wire"):
        encode(message)


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


@pytest.mark.parametrize("head", ["a0 12", "11 12"])
@pytest.mark.parametrize("count", ["01 00", "01 00 00"])
def test_a_count_that_breaks_off_is_told_as_such(head: str, count: str) -> None:
    with pytest.raises(MessageError, match="cut short"):
        decode_response(bytes.fromhex(f"{head} 00 00 00 00 07 00 00 00 {count}"))


def test_a_count_of_one_byte_is_cut_short() -> None:
    with pytest.raises(MessageError, match="cut short"):
        decode_response(bytes.fromhex("a0 12 00 00 00 00 07 00 00 00 01"))


@pytest.mark.parametrize(
    "wire",
    ["90 71", "90 71 10 00 00 00 01 00", "90 71 10 00 00 00 00 00 00 00 01 00 00 00"],
)
def test_output_command_without_count_or_value(wire: str) -> None:
    with pytest.raises(MessageError):
        decode_command(bytes.fromhex(wire))
