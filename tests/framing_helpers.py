"""Payloads of any kind, and streams cut anywhere."""

from collections.abc import Iterable, Iterator
from enum import Enum

from hypothesis import strategies as st

from x2radar.wire import framing
from x2radar.wire.framing import END, ESC, FAST, LENGTH_START, START, PacketDecoder, checksum


class Packing(Enum):
    """How a packet is framed on the wire; a host sends escaped ones alone."""

    ESCAPED = "escaped"
    LENGTH = "length"
    FAST = "fast"


def encode(data: bytes, packing: Packing = Packing.ESCAPED) -> bytes:
    """A packet as a module sends it; of a fast one, the data behind the 51 byte."""
    length = len(data).to_bytes(4, "little")
    if packing is Packing.ESCAPED:
        return framing.encode(data)
    if packing is Packing.LENGTH:
        return LENGTH_START + length + b"\x00" + data
    body = bytes([FAST]) + length + data
    return bytes([START]) + body + bytes([checksum(body), END])


payloads = st.one_of(
    st.binary(min_size=1, max_size=40),
    st.lists(st.sampled_from([0x7C, START, END, ESC, 0x51, 0, 2, 3]), min_size=1, max_size=24).map(
        bytes
    ),
)
escaped_payloads = payloads.filter(lambda data: data[0] != 0x51)
packings = st.sampled_from(Packing)
any_packet = st.tuples(payloads, packings).filter(
    lambda p: p[1] is not Packing.ESCAPED or p[0][0] != 0x51
)


def cut(stream: bytes, places: Iterable[int]) -> Iterator[bytes]:
    """Cut a stream at any places, in any order, also beyond its end."""
    last = 0
    for place in sorted({min(p, len(stream)) for p in places} | {len(stream)}):
        yield stream[last:place]
        last = place


def decode(pieces: Iterable[bytes], decoder: PacketDecoder | None = None) -> list:
    decoder = decoder or PacketDecoder()
    return [item for piece in pieces for item in decoder.feed(piece)]
