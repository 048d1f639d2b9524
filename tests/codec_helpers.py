"""Messages drawn from the tables, and how to compare them."""

from dataclasses import fields, is_dataclass

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as np_st

from x2radar.wire.messages import (
    COMMANDS,
    RESPONSES,
    X4_FORMATS,
    ByteReply,
    Data,
    Layout,
    Message,
    Reply,
    SetOutput,
    X4Set,
)

u32 = st.integers(0, 2**32 - 1)
i32 = st.integers(-(2**31), 2**31 - 1)
u8 = st.integers(0, 255)
f32 = st.floats(width=32, allow_nan=False)
FIELD = {"I": u32, "i": i32, "B": u8, "f": f32}


def float_arrays(n: int) -> st.SearchStrategy:
    return np_st.arrays("<f4", n, elements=st.floats(width=32))


def messages_of(row: Layout) -> st.SearchStrategy[Message]:
    """Draw every field of a row from what its place on the wire can hold."""
    scalars = [FIELD[code] for k, code in enumerate(row.head) if k != row.count]
    return st.integers(0, 20).flatmap(
        lambda n: st.builds(row.cls, *scalars, *[float_arrays(n)] * row.n_arrays)
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
    X4Set: st.sampled_from(list(X4_FORMATS)).flatmap(
        lambda k: st.builds(X4Set, st.just(k), st.tuples(*(FIELD[c] for c in X4_FORMATS[k][0])))
    ),
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
}
"""Messages whose shape is not in a row."""


command_messages = st.one_of(*map(messages_of, COMMANDS), BY_HAND[SetOutput], BY_HAND[X4Set])
response_messages = st.one_of(
    *map(messages_of, RESPONSES), *(BY_HAND[cls] for cls in (Reply, ByteReply, Data))
)
