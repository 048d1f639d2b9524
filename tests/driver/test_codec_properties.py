"""What holds for any message: round trips, cut and over-long packets, any bytes."""

import contextlib
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.codec_helpers import (
    BY_HAND,
    command_messages,
    messages_of,
    response_messages,
    same,
    values_of,
)
from x2radar.errors import MessageError
from x2radar.wire import messages
from x2radar.wire.codec import decode_any, decode_command, decode_response, encode
from x2radar.wire.messages import COMMANDS, RESPONSES, Data, Message, Ping, Reply, Unknown
from x2radar.wire.wire_ids import COMMAND_NAMES, RESPONSE_NAMES


@settings(max_examples=500)
@given(command_messages)
def test_round_trip_of_commands(message: Message) -> None:
    read = decode_command(encode(message))
    assert same(read, message)
    # A ping with another seed cannot be told from a pong, nor HIL from DATA.
    is_plain = not isinstance(message, Ping) or message == Ping()
    assert not is_plain or same(decode_any(encode(message)), message)


@settings(max_examples=500)
@given(response_messages)
def test_round_trip_of_responses(message: Message) -> None:
    data = encode(message)
    read = decode_response(data)
    assert same(read, message)
    for value in values_of(read):
        assert not isinstance(value, np.ndarray) or not value.flags.writeable
    if data != encode(Ping()):
        assert same(decode_any(data), message)


@pytest.mark.parametrize("names", [COMMAND_NAMES, RESPONSE_NAMES], ids=["commands", "responses"])
def test_packets_known_by_name_keep_their_bytes(names: dict[bytes, str]) -> None:
    decode = decode_command if names is COMMAND_NAMES else decode_response
    for prefix, name in names.items():
        data = prefix + b"\xfe" * 13
        message = decode(data)
        assert (message, message.name) == (Unknown(data), name)
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
    st.one_of(
        st.tuples(st.just(True), st.one_of([messages_of(row) for row in COMMANDS])),
        st.tuples(st.just(False), st.one_of([messages_of(row) for row in RESPONSES])),
    ),
    st.binary(min_size=1, max_size=5),
)
def test_cut_and_over_long_packets(drawn: tuple[bool, Message], more: bytes) -> None:
    is_command, message = drawn
    decode = decode_command if is_command else decode_response
    data = encode(message)
    n, sound, all_from = lengths_of(data, COMMANDS if is_command else RESPONSES)
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


@given(
    st.one_of([BY_HAND[cls] for cls in (Reply, messages.ByteReply, Data)]),
    st.binary(min_size=2, max_size=5),
)
def test_cut_and_over_long_replies_and_data(message: Message, more: bytes) -> None:
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


FIRST_BYTES = st.sampled_from(
    [row.prefix for row in COMMANDS + RESPONSES]
    + [bytes([first, kind]) for first in (0xA0, 0x11) for kind in (0x10, 0x11, 0x12, 0x13, 0x14)]
)


@settings(max_examples=1000)
@given(st.one_of(st.just(b""), FIRST_BYTES), st.binary(max_size=60))
def test_any_bytes_raise_nothing_but_message_error(first: bytes, rest: bytes) -> None:
    for read in (decode_command, decode_response, decode_any):
        with contextlib.suppress(MessageError):
            message = read(first + rest)
            assert isinstance(message, Message)
            assert isinstance(encode(message), bytes)
