"""Messages drawn from the tables, and how to compare them."""

from dataclasses import fields, is_dataclass

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as np_st

from x2radar.wire.layouts import COMMAND_VARIANTS, COMMANDS, RESPONSE_VARIANTS, RESPONSES, Layout
from x2radar.wire.messages import (
    ByteReply,
    Data,
    DataText,
    Message,
    Reply,
    SetOutput,
    Unknown,
)
from x2radar.wire.messages_expert import GetAppItem, SetAppInts, SetAppItem, SystemCommand
from x2radar.wire.messages_status import AppData
from x2radar.wire.messages_x4 import X4Read, X4Set, X4Write

u32 = st.integers(0, 2**32 - 1)
i32 = st.integers(-(2**31), 2**31 - 1)
u8 = st.integers(0, 255)
f32 = st.floats(width=32, allow_nan=False)
FIELD = {"I": u32, "i": i32, "B": u8, "f": f32}
GENERIC = (AppData, GetAppItem, SetAppItem, SystemCommand, X4Set, X4Write, X4Read)
"""Classes that say with their first field what they are; some values have rows of their own."""


def float_arrays(n: int) -> st.SearchStrategy:
    return np_st.arrays("<f4", n, elements=st.floats(width=32))


def arrays_of(n: int, dtype: str) -> st.SearchStrategy:
    return float_arrays(n) if dtype == "<f4" else np_st.arrays(dtype, n)


def own_prefixes(row: Layout) -> set[int]:
    """Return the first fields of a generic row for which there is a row of its own."""
    size = 1 if row.head[0] == "B" else 4
    rows = RESPONSES if row in RESPONSES else COMMANDS
    at = len(row.prefix)
    return {
        int.from_bytes(other.prefix[at : at + size], "little")
        for other in rows
        if other.prefix.startswith(row.prefix) and len(other.prefix) == at + size
    }


def messages_of(row: Layout) -> st.SearchStrategy[Message]:
    """Draw every field of a row from what its place on the wire can hold."""
    scalars = [FIELD[code] for k, code in enumerate(row.head) if k not in row.counts]
    if row.cls in GENERIC:
        taken = own_prefixes(row)
        scalars[0] = scalars[0].filter(lambda value: value not in taken)
    rest = [st.binary(max_size=20)] if row.rest == "kept" else []
    if not row.arrays:
        return st.builds(row.cls, *scalars, *rest)
    # One value makes the everyday class, none another command's length.
    lengths = st.tuples(*(st.integers(2 if row.cls is SetAppInts else 0, 20) for _ in row.counts))
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


texts = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=9)
BY_HAND: dict[type[Message], st.SearchStrategy[Message]] = {
    SetOutput: st.builds(SetOutput, u32, u32),
    Reply: st.builds(
        Reply,
        u32,
        u32,
        st.one_of(
            texts,
            st.lists(i32, max_size=5).map(tuple),
            st.lists(f32, min_size=1, max_size=5).map(tuple),
        ),
    ),
    ByteReply: st.builds(ByteReply, u32, u32, st.lists(u8, max_size=5).map(tuple)),
    Data: st.builds(
        Data,
        u32,
        u32,
        st.one_of(
            st.integers(0, 20).flatmap(float_arrays),
            np_st.arrays("u1", st.integers(0, 20)),
            np_st.arrays("<i4", st.integers(1, 20)),
        ),
    ),
    DataText: st.builds(DataText, u32, u32, texts),
    Unknown: st.just(Unknown(b"\x77\x01")),
}
"""Messages whose shape is not in a row."""


def sent_form(row: Layout) -> bool:
    """Say whether a variant has a class of its own, so that it can be sent too."""
    return row.cls not in {other.cls for other in COMMANDS + RESPONSES}


COMMAND_ROWS = (*COMMANDS, *filter(sent_form, COMMAND_VARIANTS))
RESPONSE_ROWS = (*RESPONSES, *filter(sent_form, RESPONSE_VARIANTS))
command_messages = st.one_of(*map(messages_of, COMMAND_ROWS), BY_HAND[SetOutput])
response_messages = st.one_of(
    *map(messages_of, RESPONSE_ROWS),
    *(BY_HAND[cls] for cls in (Reply, ByteReply, Data, DataText)),
)
