"""Round trips of every row, cut and over-long packets, arbitrary bytes."""

import contextlib
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.codec_helpers import (
    BY_HAND,
    COMMAND_ROWS,
    RESPONSE_ROWS,
    command_messages,
    messages_of,
    response_messages,
    same,
    values_of,
)
from x2radar.errors import MessageError
from x2radar.wire import messages, messages_expert, messages_status, messages_x4
from x2radar.wire.codec import decode_any, decode_command, decode_response, encode
from x2radar.wire.layouts import ANSWERS, COMMAND_VARIANTS, COMMANDS, RESPONSE_VARIANTS, RESPONSES
from x2radar.wire.messages import Ack, Data, Message, Ping, Reply, SystemMessage
from x2radar.wire.messages_expert import HilCommand
from x2radar.wire.messages_x4 import X4Get, X4Read, X4Set, X4Write

MODULES = (messages, messages_expert, messages_status, messages_x4)
ROWS = COMMANDS + COMMAND_VARIANTS + RESPONSES + RESPONSE_VARIANTS
X4_GENERIC = (X4Get, X4Set, X4Write, X4Read)


def all_classes() -> set[type[Message]]:
    return {
        c
        for module in MODULES
        for c in vars(module).values()
        if isinstance(c, type) and issubclass(c, Message) and c.__module__ == module.__name__
    }


def test_every_message_class_has_a_row_or_a_strategy() -> None:
    rows = {messages_status.DopplerRow, messages_status.DopplerRowBytes}
    bases = {Message, messages.Opaque} | rows
    drawn = {row.cls for row in (*COMMAND_ROWS, *RESPONSE_ROWS)} | set(BY_HAND)
    assert all_classes() - bases == drawn


def test_no_two_rows_share_a_prefix() -> None:
    for rows in (COMMANDS, RESPONSES):
        assert len({row.prefix for row in rows}) == len(rows) == len({row.cls for row in rows})


def test_variants_differ_from_their_rows_in_length() -> None:
    for rows, variants in ((COMMANDS, COMMAND_VARIANTS), (RESPONSES, RESPONSE_VARIANTS)):
        for variant in variants:
            (row,) = [row for row in rows if row.prefix == variant.prefix]
            assert row.rest == variant.rest == "none"
            assert row.arrays or len(row.head) != len(variant.head) or row.head != variant.head
            assert not variant.arrays


@pytest.mark.parametrize("row", [*COMMAND_ROWS, *RESPONSE_ROWS], ids=lambda r: r.cls.__name__)
def test_a_row_fits_its_class(row) -> None:
    n = len(row.head) - len(row.counts) + len(row.arrays) + (row.rest == "kept")
    assert len(row.cls.__dataclass_fields__) == n
    assert not (row.arrays and row.rest == "kept")
    assert all(which < len(row.counts) for which, _ in row.arrays)
    assert row.answer is Ack or row in COMMANDS


def test_answers() -> None:
    assert ANSWERS[Ping] is messages.Pong
    assert ANSWERS[messages.GetSystemInfo] is Reply
    assert Ack not in ANSWERS.values()
    for row in COMMANDS:
        name = row.cls.__name__
        if name.startswith("Get") or name in {"X4Get", "X4Read", "X4ReadSpi", "ReadPin"}:
            assert row.answer in {Reply, Data}, name


# ---------------------------------------------------------------- round trips


@pytest.mark.parametrize("row", COMMAND_ROWS, ids=lambda r: r.cls.__name__)
@settings(max_examples=20)
@given(data=st.data())
def test_round_trip_of_every_command(row, data) -> None:
    message = data.draw(messages_of(row))
    assert same(decode_command(encode(message)), message)


@pytest.mark.parametrize("row", RESPONSE_ROWS, ids=lambda r: r.cls.__name__)
@settings(max_examples=20)
@given(data=st.data())
def test_round_trip_of_every_response(row, data) -> None:
    message = data.draw(messages_of(row))
    if isinstance(message, SystemMessage):
        assert decode_response(encode(message) + b"\1") == message
    assert same(decode_response(encode(message)), message)


@pytest.mark.parametrize("cls", BY_HAND, ids=lambda c: c.__name__)
@settings(max_examples=50)
@given(data=st.data())
def test_round_trip_of_messages_without_a_row(cls, data) -> None:
    message = data.draw(BY_HAND[cls])
    decode = decode_command if cls is messages.SetOutput else decode_response
    assert same(decode(encode(message)), message)


@settings(max_examples=300)
@given(command_messages)
def test_direction_of_commands(message: Message) -> None:
    # A ping with another seed cannot be told from a pong, nor HIL from DATA; settings that
    # an X4 does not have look like a profile's message.
    if isinstance(message, HilCommand) or (isinstance(message, Ping) and message != Ping()):
        return
    if isinstance(message, X4_GENERIC) and message.setting & 0xFF == 0:
        return
    assert same(decode_any(encode(message)), message)


@settings(max_examples=300)
@given(response_messages)
def test_direction_of_responses(message: Message) -> None:
    data = encode(message)
    looks_like_x4 = data[:1] == b"\x50" and data[1] in {0x10, 0x11, 0x12, 0x13}
    if data != encode(Ping()) and not (
        isinstance(message, messages_status.AppData) and looks_like_x4
    ):
        assert same(decode_any(data), message)


@given(response_messages)
def test_arrays_are_read_only(message: Message) -> None:
    for value in values_of(decode_response(encode(message))):
        assert not isinstance(value, np.ndarray) or not value.flags.writeable


# ---------------------------------------------------------------- lengths


def lengths_of(data: bytes, rows, variants) -> tuple[int, set[int], int]:
    """Return the prefix's length, what variants accept, and from where all are accepted."""
    row = max((r for r in rows if data.startswith(r.prefix)), key=lambda r: len(r.prefix))
    n = len(row.prefix)
    others = {n + struct.calcsize("<" + v.head) for v in variants if v.prefix == row.prefix}
    whole = n + struct.calcsize("<" + row.head)
    if not row.arrays:
        others.add(whole)
    return n, others, whole if row.rest != "none" else 1 << 30


@settings(max_examples=300)
@given(command_messages, st.binary(min_size=1, max_size=5))
def test_cut_and_over_long_commands(message: Message, more: bytes) -> None:
    data = encode(message)
    n, sound, all_from = lengths_of(data, COMMANDS, COMMAND_VARIANTS)
    for cut in [data[:k] for k in range(n, len(data))] + [data + more]:
        if len(cut) < all_from and len(cut) not in sound:
            with pytest.raises(MessageError):
                decode_command(cut)
    for k in range(n):
        # What was cut within its prefix is at least never taken for the same command.
        with contextlib.suppress(MessageError):
            assert type(decode_command(data[:k])) is not type(message)


@settings(max_examples=300)
@given(st.one_of([messages_of(row) for row in RESPONSE_ROWS]), st.binary(min_size=1, max_size=5))
def test_cut_and_over_long_responses(message: Message, more: bytes) -> None:
    data = encode(message)
    n, sound, all_from = lengths_of(data, RESPONSES, RESPONSE_VARIANTS)
    for cut in [data[:k] for k in range(n, len(data))] + [data + more]:
        if len(cut) < all_from and len(cut) not in sound:
            with pytest.raises(MessageError):
                decode_response(cut)
    for k in range(n):
        with contextlib.suppress(MessageError):
            assert type(decode_response(data[:k])) is not type(message)


@given(
    st.one_of([BY_HAND[cls] for cls in (Reply, messages.ByteReply, Data, messages.DataText)]),
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
    [row.prefix for row in ROWS]
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
