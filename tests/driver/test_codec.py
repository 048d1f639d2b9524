"""Messages: whole packets byte by byte, odd forms, fields that do not fit, and any bytes at all.

The packets were computed with another implementation of the protocol.
"""

import contextlib
import struct
from dataclasses import fields, is_dataclass
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as np_st

from x2radar.errors import MessageError
from x2radar.wire import messages as msg
from x2radar.wire import wire_ids as ids
from x2radar.wire.codec import decode_any, decode_command, decode_response, encode, read_messages
from x2radar.wire.framing import Packet, PacketDecoder
from x2radar.wire.framing import encode as frame

u32 = st.integers(0, 2**32 - 1)
i32 = st.integers(-(2**31), 2**31 - 1)
u8 = st.integers(0, 255)
f32 = st.floats(width=32, allow_nan=False)
FIELD = {"I": u32, "i": i32, "B": u8, "f": f32}


def float_arrays(n: int) -> st.SearchStrategy:
    return np_st.arrays("<f4", n, elements=st.floats(width=32))


def messages_of(row: msg.Layout) -> st.SearchStrategy[msg.Message]:
    """Draw every field of a row from what its place on the wire can hold."""
    scalars = [FIELD[code] for k, code in enumerate(row.head) if k != row.count]
    arrays = st.integers(0, 20).map(lambda n: [float_arrays(n)] * row.n_arrays)
    return arrays.flatmap(lambda some: st.builds(row.cls, *scalars, *some))


def values_of(message: msg.Message) -> list:
    assert is_dataclass(message)
    return [getattr(message, field.name) for field in fields(message)]


def same(one: msg.Message, other: msg.Message) -> bool:
    """Compare with NaN equal to itself, and arrays by element and type."""
    return type(one) is type(other) and all(
        np.array_equal(a, b, equal_nan=True) and a.dtype == b.dtype
        if isinstance(a, np.ndarray)
        else a == b
        for a, b in zip(values_of(one), values_of(other), strict=True)
    )


texts = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=9)
numbers = st.lists(i32, max_size=5) | st.lists(f32, min_size=1, max_size=5)
arrays = st.integers(0, 20).flatmap(float_arrays) | np_st.arrays("u1", st.integers(0, 20))
BY_HAND: dict[type[msg.Message], st.SearchStrategy[msg.Message]] = {
    msg.SetOutput: st.builds(msg.SetOutput, u32, u32),
    msg.X4Set: st.sampled_from(list(msg.X4_FORMATS)).flatmap(
        lambda k: st.tuples(*(FIELD[c] for c in msg.X4_FORMATS[k][0])).map(partial(msg.X4Set, k))
    ),
    msg.Reply: st.builds(msg.Reply, u32, u32, texts | numbers.map(tuple)),
    msg.ByteReply: st.builds(msg.ByteReply, u32, u32, st.lists(u8, max_size=5).map(tuple)),
    msg.Data: st.builds(msg.Data, u32, u32, arrays | np_st.arrays("<i4", st.integers(1, 20))),
}
"""Messages whose shape is not in a row."""
of_commands, of_answers = (
    st.one_of([messages_of(row) for row in rows]) for rows in (msg.COMMANDS, msg.RESPONSES)
)
of_lists = BY_HAND[msg.Reply] | BY_HAND[msg.ByteReply] | BY_HAND[msg.Data]


ZONE_M = np.array([1.8, 0.4], np.float32).tolist()
PACKETS = [
    (msg.Ping(), "7d 01 ae ea aa ee 7c 7e"),
    (msg.SetMode(ids.Mode.STOP), "7d 20 13 4e 7e"),
    (msg.LoadProfile(ids.Profile.RESPIRATION), "7d 21 d6 a2 23 14 1f 7e"),
    (msg.SetLed(ids.Led.FULL), "7d 24 02 00 5b 7e"),
    (msg.SetDetectionZone(ZONE_M[0], 2.5), "7d 10 10 1c 0a a1 96 66 66 e6 3f 00 00 20 40 e5 7e"),
    (msg.X4Set(ids.X4Setting.FPS, (20.0,)), "7d 50 10 10 00 00 00 00 00 a0 41 cc 7e"),
    (msg.Pong(ids.PongCode.NOT_READY), "7d 01 aa ee ea ae 7c 7e"),
    (msg.Ack(), "7d 10 6d 7e"),
    (msg.SystemMessage(ids.SystemCode.READY), "7d 30 11 00 00 00 5c 7e"),
    (msg.ErrorReply(ids.ErrorCode.NOT_RECOGNIZED), "7d 20 01 00 00 00 5c 7e"),
]
"""Most are printed by the maker's document, a public client or a trace of a real module, too."""
TWO, HALF = "00 00 00 40", "00 00 00 3f"
SEVEN = "00 00 00 00 07 00 00 00"
BASEBAND = "90 71 10 00 00 00 01 00 00 00"
COMMAND_BYTES = [
    (msg.Reset(), "22"),
    (msg.GetMode(), "26"),
    (msg.SetMode(ids.Mode.RUN), "20 01"),
    (msg.SetMode(ids.Mode.IDLE), "20 11"),
    (msg.SetMode(ids.Mode.MANUAL), "20 12"),
    (msg.LoadProfile(ids.Profile.SLEEP), "21 17 7b f1 00"),
    (msg.LoadProfile(ids.Profile.PRESENCE), "21 12 89 28 00"),
    (msg.SetLed(ids.Led.OFF), "24 00 00"),
    (msg.SetDetectionZone(ZONE_M[1], 2.0), f"10 10 1c 0a a1 96 cd cc cc 3e {TWO}"),
    (msg.SetSensitivity(9), "10 10 2b 11 a5 10 09 00 00 00"),
    (msg.SetOutput(ids.OutputRef.BASEBAND, ids.BasebandOutput.OFF), f"{BASEBAND} 00 00 00 00"),
    (msg.SetOutput(ids.OutputRef.BASEBAND, ids.BasebandOutput.IQ), f"{BASEBAND} 01 00 00 00"),
    (msg.SetOutput(0x10, ids.BasebandOutput.AMPLITUDE_PHASE), f"{BASEBAND} 02 00 00 00"),
    (msg.SetBaudRate(921_600), "90 80 00 10 0e 00"),
    (msg.GetSystemInfo(ids.InfoItem.FIRMWARE_ID), "90 58 02"),
    (msg.SetSysInt(ids.SysCfg.FPS, 60), "90 51 1a 00 00 00 3c 00 00 00"),
    (msg.SetSysInt(ids.SysCfg.DAC_MIN, -1), "90 51 13 00 00 00 ff ff ff ff"),
    (msg.SetSysFloat(ids.SysCfg.SAMPLE_DELAY, 0.5), "90 52 15 00 00 00 00 00 00 3f"),
    (msg.X4Init(), "50 20"),
    (msg.X4Set(ids.X4Setting.PULSES_PER_STEP, (20,)), "50 10 11 00 00 00 14 00 00 00"),
    (msg.X4Set(ids.X4Setting.ITERATIONS, (64,)), "50 10 12 00 00 00 40 00 00 00"),
    (msg.X4Set(ids.X4Setting.DOWN_CONVERSION, (1,)), "50 10 13 00 00 00 01"),
    (msg.X4Set(ids.X4Setting.FRAME_AREA, (0.5, 2.0)), f"50 10 14 00 00 00 {HALF} {TWO}"),
    (msg.X4Set(ids.X4Setting.DAC_STEP, (1,)), "50 10 15 00 00 00 01"),
    (msg.X4Set(ids.X4Setting.DAC_MIN, (949,)), "50 10 16 00 00 00 b5 03 00 00"),
    (msg.X4Set(ids.X4Setting.DAC_MAX, (1100,)), "50 10 17 00 00 00 4c 04 00 00"),
    (msg.X4Set(ids.X4Setting.FRAME_AREA_OFFSET, (0.5,)), f"50 10 18 00 00 00 {HALF}"),
    (msg.X4Set(ids.X4Setting.ENABLE, (1,)), "50 10 19 00 00 00 01"),
    (msg.X4Set(ids.X4Setting.TX_CENTRE_FREQUENCY, (3,)), "50 10 20 00 00 00 03"),
    (msg.X4Set(ids.X4Setting.TX_POWER, (2,)), "50 10 21 00 00 00 02"),
    (msg.X4Set(ids.X4Setting.PRF_DIV, (16,)), "50 10 25 00 00 00 10"),
]
RESPONSE_BYTES = [
    (msg.Pong(ids.PongCode.READY), "01 ea ae ee aa"),
    (msg.SystemMessage(ids.SystemCode.BOOTING), "30 10 00 00 00"),
    (msg.ErrorReply(ids.ErrorCode.COMMAND_FAILED), "20 21 00 00 00"),
    (msg.Pong(ids.PongCode.SAFE_MODE), "01 ef fe ee ff"),
    (msg.Reply(0x58, 3, "1.0"), "11 13 58 00 00 00 03 00 00 00 03 00 00 00 31 2e 30 01"),
    (msg.Reply(0x58, 3, ""), "11 13 58 00 00 00 03 00 00 00 01"),
    (msg.Reply(1, 2, (-3,)), "11 11 01 00 00 00 02 00 00 00 01 00 00 00 fd ff ff ff"),
    (msg.Reply(1, 2, ()), "11 11 01 00 00 00 02 00 00 00"),
    (msg.Reply(1, 2, (0.5,)), "11 12 01 00 00 00 02 00 00 00 01 00 00 00 00 00 00 3f 04"),
    (msg.ByteReply(1, 2, (7, 255)), "11 10 01 00 00 00 02 00 00 00 02 00 00 00 07 ff 01"),
]
IQ_HEAD = "02 00 00 00 00 00 00 3d 00 00 20 51 00 00 c0 50 00 00 80 3e"
IQ_ARRAYS = "00 00 80 3f 00 00 00 40 00 00 40 40 00 00 80 40"


@pytest.mark.parametrize(("message", "wire"), PACKETS, ids=str)
def test_whole_packets(message: msg.Message, wire: str) -> None:
    assert frame(encode(message)) == bytes.fromhex(wire)
    (item,) = PacketDecoder().feed(bytes.fromhex(wire))
    assert isinstance(item, Packet)
    is_answer = isinstance(message, msg.Pong | msg.Ack | msg.SystemMessage | msg.ErrorReply)
    decode = decode_response if is_answer else decode_command
    assert decode(item.data) == decode_any(item.data) == message


@pytest.mark.parametrize(("message", "wire"), COMMAND_BYTES + RESPONSE_BYTES, ids=str)
def test_bytes(message: msg.Message, wire: str) -> None:
    data = bytes.fromhex(wire)
    decode = decode_command if (message, wire) in COMMAND_BYTES else decode_response
    assert encode(message) == data
    assert decode(data) == decode_any(data) == message


@pytest.mark.parametrize(
    ("cls", "begin"),
    [
        *((msg.BasebandIq, "50 0c"), (msg.BasebandAp, "50 0d")),
        *((msg.BasebandIqOld, "a0 14 0c"), (msg.BasebandApOld, "a0 14 0d")),
    ],
)
def test_baseband_bytes(cls: type, begin: str) -> None:
    pairs = np.array([[1, 2], [3, 4]], np.float32)
    expected = cls(9, 0.03125, 42949672960.0, 25769803776.0, 0.25, *pairs)
    assert isinstance(expected, msg.BasebandIq | msg.BasebandAp)
    data = bytes.fromhex(f"{begin} 00 00 00 09 00 00 00 {IQ_HEAD} {IQ_ARRAYS}")
    assert same(decode_response(data), expected)
    assert same(decode_any(data), expected)
    assert encode(expected) == data
    with pytest.raises(MessageError, match="cut short"):
        decode_response(data[:-16])


@pytest.mark.parametrize(
    ("values", "wire"),
    [
        (np.array([0.5, -2], np.float32), f"12 {SEVEN} 02 00 00 00 {HALF} 00 00 00 c0"),
        (np.array([-1, 5], np.int32), f"11 {SEVEN} 02 00 00 00 ff ff ff ff 05 00 00 00"),
        (np.array([7, 255], np.uint8), f"10 {SEVEN} 02 00 00 00 07 ff"),
        (np.array([], np.float32), f"12 {SEVEN}"),
    ],
)
def test_data_keep_their_type(values: np.ndarray, wire: str) -> None:
    data = bytes.fromhex(f"a0 {wire}")
    assert encode(msg.Data(0, 7, values)) == data
    assert same(decode_response(data), msg.Data(0, 7, values))
    if not values.size:
        assert same(decode_response(data + bytes(4)), msg.Data(0, 7, values))


@pytest.mark.parametrize(
    ("wire", "expected"),
    [
        ("11 10 01 00 00 00 02 00 00 00 02 00 00 00 07 ff", msg.ByteReply(1, 2, (7, 255))),
        ("11 11 01 00 00 00 02 00 00 00 01 00 00 00 05 00 00 00 04", msg.Reply(1, 2, (5,))),
        ("11 13 01 00 00 00 02 00 00 00 04 00 00 00 41 42 00 00 01", msg.Reply(1, 2, "AB")),
        ("11 13 01 00 00 00 02 00 00 00 01 00 00 00 ff 01", msg.Reply(1, 2, "\ufffd")),
        ("30 11 00 00 00 01 02", msg.SystemMessage(0x11)),
        # XTAN-11 prints one byte where its text has four; a client sends four for one.
        ("50 10 11 00 00 00 14", msg.X4Set(ids.X4Setting.PULSES_PER_STEP, (20,))),
        ("50 10 15 00 00 00 01 00 00 00", msg.X4Set(ids.X4Setting.DAC_STEP, (1,))),
    ],
)
def test_other_forms_of_what_is_known(wire: str, expected: msg.Message) -> None:
    decode = decode_command if isinstance(expected, msg.X4Set) else decode_response
    assert decode(bytes.fromhex(wire)) == decode_any(bytes.fromhex(wire)) == expected
    assert decode(encode(expected)) == expected


@pytest.mark.parametrize(
    "wire", ["", "77", "a0 50", "11 50", "a0 15 01 00 00 00 02 00 00 00", "03 00", "51 01"]
)
def test_what_no_row_describes_is_kept(wire: str) -> None:
    data = bytes.fromhex(wire)
    assert decode_response(data) == decode_any(data) == msg.Unknown(data)
    assert encode(msg.Unknown(data)) == data


# The X4 driver's longest setting has 14 bytes; what is longer is a profile's message.
OF_COMMANDS = ["10 13", "20 01", "20 10 01", "01 ae ea aa ee", "01 ae ea aa ee 00", "50 20"]
OF_COMMANDS += ["c0 00", "50 11 10 00 00 00", "50 10 23 00 00 00" + "00" * 20, "50 10 11"]
OF_COMMANDS += ["50 10 00 00 00" + "00" * 9]
OF_ANSWERS = ["10", "20 01 00 00 00", "01 ea ae ee aa", "a0", "50", "50 10", "12 00", "e0"]
OF_ANSWERS += ["50 10 00 00 00" + "00" * n for n in (10, 44)] + ["50 12 00 00 00" + "00" * 44]


@pytest.mark.parametrize(
    ("wire", "is_command"),
    [*((wire, True) for wire in OF_COMMANDS), *((wire, False) for wire in OF_ANSWERS)],
)
def test_direction_of_a_packet(wire: str, is_command: bool) -> None:
    def read(decode) -> msg.Message | str:
        try:
            return decode(bytes.fromhex(wire))
        except MessageError as err:
            return str(err)

    one, other = read(decode_any), read(decode_command if is_command else decode_response)
    assert same(one, other) if isinstance(one, msg.Message) else one == other


@given(np_st.arrays("f8", 3, elements=st.floats(-1e6, 1e6)))
def test_other_float_arrays_are_sent_as_float32(values: np.ndarray) -> None:
    message = decode_response(encode(msg.Data(0, 1, values)))
    assert isinstance(message, msg.Data)
    np.testing.assert_array_equal(message.values, values.astype(np.float32))


@pytest.mark.parametrize(
    "message",
    [
        *(msg.SetMode(256), msg.SetLed(-1), msg.SetOutput(1, -1), msg.ErrorReply(-1)),
        *(msg.SetSensitivity(2**32), msg.SetSysInt(1, 2**31), msg.ByteReply(0, 0, (256,))),
        *(msg.X4Set(ids.X4Setting.ITERATIONS, (-1,)), msg.X4Set(0x77, (1,))),
        msg.X4Set(ids.X4Setting.FRAME_AREA, (1.0,)),
        *(msg.SetDetectionZone(1e39, 2), msg.SetDetectionZone("near", "far")),
        *(msg.Reply(0, 0, wrong) for wrong in ("\ud800", (2**31,), 5)),
        *(msg.Data(0, 0, np.array(wrong)) for wrong in (["a"], [1e39])),
        msg.Data(-1, 0, np.zeros(1, np.float32)),
        msg.BasebandIq(1, 1.0, 1.0, 1.0, 1.0, np.zeros(2), np.zeros(3)),
        pytest.param(msg.Message(), id="Message"),
    ],
    ids=str,
)
def test_fields_that_do_not_fit_raise_message_error(message: msg.Message) -> None:
    with pytest.raises(MessageError, match="does not fit the wire"):
        encode(message)


@pytest.mark.parametrize(
    ("wire", "words"),
    [
        ("a0 12 00 00 00 00 07 00 00 00 00 00 00 00 01", "too many"),
        ("a0 12 00 00 00 00 07 00 00 00 ff ff ff ff 00", "cut short"),
        ("50 0c 00 00 00 09 00 00 00 ff ff ff ff" + "00" * 16, "cut short"),
        ("11 12 00 00 00 00 07 00 00 00 ff ff ff ff 00", "cut short"),
        ("11 12 00 00 00 00 07 00 00 00 00 00 00 00 04 04", "too many"),
        *(
            (f"{head} {'00 ' * 8} 01 00 {more}", "cut short")
            for head in ("a0 12", "11 12")
            for more in ("", "00")
        ),
    ],
)
def test_counts_and_lengths_that_lie(wire: str, words: str) -> None:
    with pytest.raises(MessageError, match=words):
        decode_response(bytes.fromhex(wire))


@pytest.mark.parametrize("n_bytes", [0, 2, 3, 5, 8])
def test_a_setting_of_an_x4_in_a_width_that_it_has_not(n_bytes: int) -> None:
    with pytest.raises(MessageError, match="X4Set of 0x11 has"):
        decode_command(bytes.fromhex("50 10 11 00 00 00") + bytes(n_bytes))


@pytest.mark.parametrize(
    "wire",
    [
        *("90 71", "90 71 10 00 00 00 01 00", BASEBAND),
        "90 71 10 00 00 00 00 00 00 00 01 00 00 00",
        "90 71 10 00 00 00 02 00 00 00 01 00 00 00 03 00 00 00",
    ],
)
def test_other_forms_of_the_output_command_are_kept(wire: str) -> None:
    message = decode_command(bytes.fromhex(wire))
    assert (message, message.name) == (msg.Unknown(bytes.fromhex(wire)), "SetAppInts")


def test_every_message_class_has_one_row_of_its_own() -> None:
    public = [each for name, each in vars(msg).items() if not name.startswith("_")]
    classes = {c for c in public if isinstance(c, type) and issubclass(c, msg.Message)}
    rows = msg.COMMANDS + msg.RESPONSES
    assert classes == {row.cls for row in rows} | set(BY_HAND) | {msg.Message, msg.Unknown}
    assert len(rows) == len({row.cls for row in rows})
    for some in (msg.COMMANDS, msg.RESPONSES):
        assert len({row.prefix for row in some}) == len(some)


@settings(max_examples=500)
@given(of_commands | BY_HAND[msg.SetOutput] | BY_HAND[msg.X4Set])
def test_round_trip_of_commands(message: msg.Message) -> None:
    read = decode_command(encode(message))
    assert same(read, message)
    # A ping with another seed cannot be told from a pong, nor HIL from DATA.
    is_plain = not isinstance(message, msg.Ping) or message == msg.Ping()
    assert not is_plain or same(decode_any(encode(message)), message)


@settings(max_examples=500)
@given(of_answers | of_lists)
def test_round_trip_of_responses(message: msg.Message) -> None:
    data = encode(message)
    read = decode_response(data)
    assert same(read, message)
    for value in values_of(read):
        assert not isinstance(value, np.ndarray) or not value.flags.writeable
    if data != encode(msg.Ping()):
        assert same(decode_any(data), message)


@pytest.mark.parametrize("names", [ids.COMMAND_NAMES, ids.RESPONSE_NAMES], ids=["to", "from"])
def test_packets_known_by_name_keep_their_bytes(names: dict[bytes, str]) -> None:
    decode = decode_command if names is ids.COMMAND_NAMES else decode_response
    for prefix, name in names.items():
        data = prefix + b"\xfe" * 13
        message = decode(data)
        assert (message, message.name) == (msg.Unknown(data), name)
        assert encode(message) == data


def lengths_of(data: bytes, rows) -> tuple[int, set[int], int]:
    """Return the prefix's length, which cuts are sound, and from where all lengths are."""
    row = max((r for r in rows if data.startswith(r.prefix)), key=lambda r: len(r.prefix))
    n = len(row.prefix)
    whole = n + struct.calcsize("<" + row.head)
    sound = set() if row.n_arrays else {whole}
    # An error of one byte.
    return n, sound | {2} if row.prefix == b"\x20" else sound, whole if row.has_rest else 1 << 30


@settings(max_examples=300)
@given(
    st.tuples(st.just(True), of_commands) | st.tuples(st.just(False), of_answers),
    st.binary(min_size=1, max_size=5),
)
def test_cut_and_over_long_packets(drawn: tuple[bool, msg.Message], more: bytes) -> None:
    is_command, message = drawn
    decode = decode_command if is_command else decode_response
    data = encode(message)
    n, sound, all_from = lengths_of(data, msg.COMMANDS if is_command else msg.RESPONSES)
    for cut in [data[:k] for k in range(n, len(data))] + [data + more]:
        if len(cut) < all_from and len(cut) not in sound:
            with pytest.raises(MessageError):
                decode(cut)
        elif len(cut) > all_from:
            assert decode(cut) == message
    for k in range(n):
        # What was cut within its prefix is at least never taken for the same message.
        with contextlib.suppress(MessageError):
            assert type(decode(data[:k])) is not type(message)


@given(of_lists, st.binary(min_size=2, max_size=5))
def test_cut_and_over_long_replies_and_data(message: msg.Message, more: bytes) -> None:
    data = encode(message)
    is_reply = data[0] == 0x11
    for k in range(1, len(data)):
        # No elements, with and without element size; or all but the element size.
        sound = {10, 11, len(data) - (data[1] != 0x11)} if is_reply else {10}
        if k not in sound:
            with pytest.raises(MessageError):
                decode_response(data[:k])
    if len(data) > 11:
        with pytest.raises(MessageError):
            decode_response(data + more)


KINDS = [bytes([first, kind]) for first in (0xA0, 0x11) for kind in range(0x10, 0x15)]
FIRST_BYTES = st.sampled_from([row.prefix for row in msg.COMMANDS + msg.RESPONSES] + KINDS)


@settings(max_examples=1000)
@given(st.one_of(st.just(b""), FIRST_BYTES), st.binary(max_size=60))
def test_any_bytes_raise_nothing_but_message_error(first: bytes, rest: bytes) -> None:
    for read in (decode_command, decode_response, decode_any):
        with contextlib.suppress(MessageError):
            message = read(first + rest)
            assert isinstance(message, msg.Message)
            assert isinstance(encode(message), bytes)


def test_messages_of_a_line_come_with_its_damage() -> None:
    ack, lies = frame(b"\x10"), frame(b"\xa0\x12\x01")
    line = ack + b"\x01\x02" + ack + lies + ack
    assert list(read_messages(PacketDecoder(), line)) == [*(msg.Ack(), None) * 2, msg.Ack()]
    assert decode_response(b"\x20\x01") == msg.ErrorReply(1)  # of two bytes in place of five
