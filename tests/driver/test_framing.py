"""Framing against the specification's bytes and a slow reference reader."""

from collections.abc import Iterator
from itertools import islice

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.framing_helpers import Packing, any_packet, cut, decode, encode
from x2radar.errors import ProtocolError
from x2radar.wire.framing import END, ESC, LENGTH_HEADER, MAX_PACKET, START, Packet, checksum


def reference_read(stream: bytes) -> list[tuple[bytes, Packing]]:
    """Read a faultless stream one byte at a time, with nothing but the specification."""
    line = iter(stream)
    out: list[tuple[bytes, Packing]] = []
    for byte in line:
        if byte == START:
            out.append(reference_flagged(line))
        elif byte == 0x7C:
            header = bytes(islice(line, 8))
            assert header[:3] == b"\x7c\x7c\x7c"
            n = int.from_bytes(header[3:7], "little")
            out.append((bytes(islice(line, n)), Packing.LENGTH))
        else:
            assert byte == END
            assert out[-1][1] is Packing.FAST
    return out


def reference_flagged(line: Iterator[int]) -> tuple[bytes, Packing]:
    data = bytearray()
    crc = START
    for byte in line:
        if byte == 0x51 and not data:
            n = int.from_bytes(bytes(islice(line, 4)), "little")
            body = bytes(islice(line, n))
            for value in (0x51, *n.to_bytes(4, "little"), *body, next(line)):
                crc ^= value
            assert crc == 0
            return body, Packing.FAST
        if byte == END:
            break
        assert byte != START
        value = next(line) if byte == ESC else byte
        crc ^= value
        data.append(value)
    assert crc == 0
    return bytes(data[:-1]), Packing.ESCAPED


@given(st.binary(max_size=70))
def test_checksum_is_the_xor_of_all_bytes(data: bytes) -> None:
    expected = START
    for byte in data:
        expected ^= byte
    assert checksum(data) == checksum(bytearray(data)) == checksum(memoryview(data)) == expected


def test_what_cannot_be_packed_is_refused() -> None:
    for data in (b"", b"\0" * MAX_PACKET):
        with pytest.raises(ProtocolError, match="bytes"):
            encode(data)
    with pytest.raises(ProtocolError, match="131072"):
        encode(b"\x7d" * (MAX_PACKET // 2))
    with pytest.raises(ProtocolError, match="fast packing"):
        encode(b"\x51\x01")


@pytest.mark.parametrize(
    ("data", "packing"),
    [
        (b"\x7d" * (MAX_PACKET // 2 - 2), Packing.ESCAPED),
        (b"\x7d" * (MAX_PACKET - LENGTH_HEADER), Packing.LENGTH),
        (b"\x7d" * (MAX_PACKET - 8), Packing.FAST),
    ],
)
def test_longest_packets(data: bytes, packing: Packing) -> None:
    wire = encode(data, packing)
    assert decode(wire[k : k + 5000] for k in range(0, len(wire), 5000)) == [Packet(data)]


@settings(max_examples=400)
@given(packets=st.lists(any_packet, max_size=8), places=st.lists(st.integers(0, 300), max_size=12))
@example(packets=[(b"\x02\x7e\x7c\x7c\x7c\x7c", Packing.ESCAPED)], places=[])
@example(packets=[(b"\x01", Packing.FAST), (b"\x10", Packing.ESCAPED)], places=[8])
def test_any_packets_cut_anywhere(packets: list, places: list[int]) -> None:
    stream = b"".join(encode(data, packing) for data, packing in packets)
    assert reference_read(stream) == packets
    expected = [Packet(data) for data, packing in packets]
    assert decode(cut(stream, places)) == expected
    assert decode(stream[k : k + 1] for k in range(len(stream))) == expected
