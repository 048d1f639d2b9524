"""Framing against the specification's bytes, a slow reference reader, and a bad line."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from x2radar import codec
from x2radar.errors import ProtocolError
from x2radar.framing import (
    END,
    ESC,
    LENGTH_HEADER,
    LENGTH_START,
    MAX_PACKET,
    START,
    Fault,
    LineFault,
    Packet,
    PacketDecoder,
    Packing,
    checksum,
    encode,
    escape,
    unescape,
)
from x2radar.messages import Data

VECTORS = {
    "ping": ("01 ae ea aa ee", "7d 01 ae ea aa ee 7c 7e"),
    "pong ready": ("01 ea ae ee aa", "7d 01 ea ae ee aa 7c 7e"),
    "pong not ready": ("01 aa ee ea ae", "7d 01 aa ee ea ae 7c 7e"),
    "ack": ("10", "7d 10 6d 7e"),
    "reset": ("22", "7d 22 5f 7e"),
    "booting": ("30 10 00 00 00", "7d 30 10 00 00 00 5d 7e"),
    "ready": ("30 11 00 00 00", "7d 30 11 00 00 00 5c 7e"),
    "run": ("20 01", "7d 20 01 5c 7e"),
    "idle": ("20 11", "7d 20 11 4c 7e"),
    "manual": ("20 12", "7d 20 12 4f 7e"),
    "stop": ("20 13", "7d 20 13 4e 7e"),
    "load respiration": ("21 d6 a2 23 14", "7d 21 d6 a2 23 14 1f 7e"),
    "load sleep": ("21 17 7b f1 00", "7d 21 17 7b f1 00 c1 7e"),
    "load presence": ("21 12 89 28 00", "7d 21 12 89 28 00 ef 7e"),
    "led full": ("24 02 00", "7d 24 02 00 5b 7e"),
    "led off": ("24 00 00", "7d 24 00 00 59 7e"),
    "zone 1.8-2.5": (
        "10 10 1c 0a a1 96 66 66 e6 3f 00 00 20 40",
        "7d 10 10 1c 0a a1 96 66 66 e6 3f 00 00 20 40 e5 7e",
    ),
    "zone 0.4-2.0": (
        "10 10 1c 0a a1 96 cd cc cc 3e 00 00 00 40",
        "7d 10 10 1c 0a a1 96 cd cc cc 3e 00 00 00 40 ef 7e",
    ),
    "sensitivity 9": (
        "10 10 2b 11 a5 10 09 00 00 00",
        "7d 10 10 2b 11 a5 10 09 00 00 00 fb 7e",
    ),
    "baseband off": (
        "90 71 10 00 00 00 01 00 00 00 00 00 00 00",
        "7d 90 71 10 00 00 00 01 00 00 00 00 00 00 00 8d 7e",
    ),
    "baseband iq": (
        "90 71 10 00 00 00 01 00 00 00 01 00 00 00",
        "7d 90 71 10 00 00 00 01 00 00 00 01 00 00 00 8c 7e",
    ),
    "baseband ap": (
        "90 71 10 00 00 00 01 00 00 00 02 00 00 00",
        "7d 90 71 10 00 00 00 01 00 00 00 02 00 00 00 8f 7e",
    ),
    "baud 921600": ("90 80 00 10 0e 00", "7d 90 80 00 10 0e 00 73 7e"),
    "firmware id": ("90 58 02", "7d 90 58 02 b7 7e"),
    "not recognized": ("20 01 00 00 00", "7d 20 01 00 00 00 5c 7e"),
    "command failed": ("20 21 00 00 00", "7d 20 21 00 00 00 7c 7e"),
    "x4 fps 20": ("50 10 10 00 00 00 00 00 a0 41", "7d 50 10 10 00 00 00 00 00 a0 41 cc 7e"),
}
TAIL = bytes.fromhex("7d 50 26 fe 75")

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


def read_three_ways(stream: bytes, expected: list) -> None:
    """Decode whole, byte by byte, and with the beginning of another packet behind it."""
    assert decode([stream]) == expected
    assert decode(stream[k : k + 1] for k in range(len(stream))) == expected
    decoder = PacketDecoder()
    assert decode([stream + TAIL], decoder) == expected
    assert decoder.n_buffered == len(TAIL)


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


# ---------------------------------------------------------------- the specification's bytes


@pytest.mark.parametrize(("data", "wire"), VECTORS.values(), ids=VECTORS.keys())
def test_vector_of_the_specification(data: str, wire: str) -> None:
    assert encode(bytes.fromhex(data)) == bytes.fromhex(wire)
    read_three_ways(bytes.fromhex(wire), [Packet(bytes.fromhex(data))])


def test_all_vectors_in_one_stream() -> None:
    stream = b"".join(bytes.fromhex(wire) for _, wire in VECTORS.values())
    read_three_ways(stream, [Packet(bytes.fromhex(data)) for data, _ in VECTORS.values()])


def test_length_packet_bytes() -> None:
    data = bytes.fromhex("a0 12 7d 7e 7f")
    wire = bytes.fromhex("7c 7c 7c 7c 05 00 00 00 00 a0 12 7d 7e 7f")
    assert encode(data, Packing.LENGTH) == wire
    read_three_ways(wire, [Packet(data, Packing.LENGTH)])
    read_three_ways(wire * 3, [Packet(data, Packing.LENGTH)] * 3)


@pytest.mark.parametrize("end", [b"", b"\x7e"])
def test_fast_packet_bytes_with_and_without_end_flag(end: bytes) -> None:
    data = bytes.fromhex("7d 7e 7f")
    wire = bytes.fromhex("7d 51 03 00 00 00 7d 7e 7f") + bytes([0x7D ^ 0x51 ^ 3 ^ 0x7C]) + end
    if end:
        assert encode(data, Packing.FAST) == wire
    read_three_ways(wire, [Packet(data, Packing.FAST)])
    read_three_ways(wire * 2, [Packet(data, Packing.FAST)] * 2)


# ---------------------------------------------------------------- escapes and checksums


@pytest.mark.parametrize("flag", [START, END, ESC])
@pytest.mark.parametrize("place", range(4))
def test_escape_at_every_place(flag: int, place: int) -> None:
    data = bytearray(b"\x01\x02\x04\x08")
    data[place] = flag
    wire = encode(bytes(data))
    assert bytes([ESC, flag]) in wire
    read_three_ways(wire + wire, [Packet(bytes(data))] * 2)


@pytest.mark.parametrize("flag", [START, END, ESC])
def test_escaped_checksum(flag: int) -> None:
    data = bytes([0x10, 0x10 ^ START ^ flag])
    wire = encode(data)
    assert wire == bytes([START, *data, ESC, flag, END])
    read_three_ways(wire, [Packet(data)])


def test_start_flag_as_bare_checksum() -> None:
    data = b"\x10\x10"
    read_three_ways(bytes([START, *data, START, END]), [Packet(data)])


def test_start_flag_as_bare_checksum_behind_escaped_escape() -> None:
    data = b"\x10\x6f\x7f"
    assert checksum(data) == START
    wire = b"\x7d\x10\x6f" + b"\x7f\x7f" + b"\x7d\x7e"
    read_three_ways(wire, [Packet(data)])


def test_escape_as_bare_checksum_is_read_at_the_next_start_flag() -> None:
    data = b"\x10\x12"
    wire = bytes([START, *data, ESC, END])
    assert decode([wire]) == []
    read_three_ways(wire + encode(b"\x10"), [Packet(data), Packet(b"\x10")])
    read_three_ways(wire * 2 + encode(b"\x10"), [Packet(data), Packet(data), Packet(b"\x10")])


def test_bare_checksum_of_a_packet_behind_a_lost_end_flag() -> None:
    lost = encode(b"\x01\x02\x03")[:-1]
    wire = lost + b"\x7d\x10\x10\x7d\x7e"
    assert decode([wire]) == [LineFault(Fault.LOST_BYTES, len(lost)), Packet(b"\x10\x10")]


def test_escaped_end_flag_before_7c_does_not_end_a_packet() -> None:
    # The part before the escaped end flag has 7F for a checksum.
    data = b"\x02\x7e\x7c\x01"
    read_three_ways(encode(data), [Packet(data)])


@given(st.binary(max_size=70))
def test_checksum_is_the_xor_of_all_bytes(data: bytes) -> None:
    expected = START
    for byte in data:
        expected ^= byte
    assert checksum(data) == checksum(bytearray(data)) == checksum(memoryview(data)) == expected


@given(payloads)
def test_unescape_undoes_escape(data: bytes) -> None:
    assert unescape(escape(data)) == data


# ---------------------------------------------------------------- what cannot be packed


@pytest.mark.parametrize("packing", Packing)
def test_empty_and_too_long_data_are_refused(packing: Packing) -> None:
    for data in (b"", b"\0" * MAX_PACKET):
        with pytest.raises(ProtocolError, match="bytes"):
            encode(data, packing)


def test_data_that_escapes_beyond_the_limit_are_refused() -> None:
    with pytest.raises(ProtocolError, match="131072"):
        encode(b"\x7d" * (MAX_PACKET // 2))


def test_escaped_data_that_look_like_a_fast_packet_are_refused() -> None:
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
    assert decode(wire[k : k + 5000] for k in range(0, len(wire), 5000)) == [Packet(data, packing)]


# ---------------------------------------------------------------- sound streams, any cut


@settings(max_examples=400)
@given(
    packets=st.lists(any_packet, max_size=8),
    places=st.lists(st.integers(0, 300), max_size=12),
)
@example(packets=[(b"\x02\x7e\x7c\x7c\x7c\x7c", Packing.ESCAPED)], places=[])
@example(packets=[(b"\x01", Packing.FAST), (b"\x10", Packing.ESCAPED)], places=[8])
def test_any_packets_cut_anywhere(packets: list, places: list[int]) -> None:
    stream = b"".join(encode(data, packing) for data, packing in packets)
    assert reference_read(stream) == packets
    expected = [Packet(data, packing) for data, packing in packets]
    assert decode(cut(stream, places)) == expected
    assert decode(stream[k : k + 1] for k in range(len(stream))) == expected


def test_empty_feed_changes_nothing() -> None:
    wire = encode(b"\x01\x7d\x02", Packing.FAST) + encode(b"\x7f")
    decoder = PacketDecoder()
    items = []
    for k in range(len(wire)):
        items += decoder.feed(b"") + decoder.feed(wire[k : k + 1]) + decoder.feed(b"")
    assert items == [Packet(b"\x01\x7d\x02", Packing.FAST), Packet(b"\x7f")]


@pytest.mark.parametrize("half", [encode(b"\x10\x11")[:-1], encode(b"\x01", Packing.LENGTH)[:6]])
def test_reset_forgets_half_a_packet(half: bytes) -> None:
    decoder = PacketDecoder()
    assert decoder.feed(half) == []
    assert decoder.n_buffered == len(half)
    decoder.reset()
    assert decoder.n_buffered == 0
    assert decoder.feed(encode(b"\x10")) == [Packet(b"\x10")]


def test_length_packet_is_not_held_back_and_not_counted_as_buffered() -> None:
    decoder = PacketDecoder()
    assert decoder.feed(encode(b"\x10", Packing.LENGTH)) == [Packet(b"\x10", Packing.LENGTH)]
    assert decoder.n_buffered == 0
    assert decoder.feed(LENGTH_START[:2]) == []
    assert decoder.n_buffered == 2
    assert decoder.feed(encode(b"\x11", Packing.LENGTH)[2:]) == [Packet(b"\x11", Packing.LENGTH)]


# ---------------------------------------------------------------- faults, each by name

GOOD = encode(b"\x10")
SOUND = Packet(b"\x10")


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        pytest.param(
            b"\x01\x02" + GOOD, [LineFault(Fault.JUNK, 2), SOUND], id="junk before a packet"
        ),
        pytest.param(
            GOOD + b"\x01\x7c\x7c" + GOOD,
            [SOUND, LineFault(Fault.JUNK, 3), SOUND],
            id="junk inside",
        ),
        pytest.param(
            b"\x01\x7f" + GOOD, [LineFault(Fault.JUNK, 2), SOUND], id="junk ends with an escape"
        ),
        pytest.param(
            b"\x7d\x10\x6c\x7e" + GOOD, [LineFault(Fault.CRC_ERROR, 4), SOUND], id="bad checksum"
        ),
        pytest.param(
            GOOD[:-1] + GOOD, [LineFault(Fault.LOST_BYTES, 3), SOUND], id="lost end flag"
        ),
        pytest.param(
            GOOD[:-1] + b"\x7f" + GOOD,
            [Packet(b"\x10\x6d\x7d\x10")],
            id="end flag became an escape: the joined packets' checksum is right",
        ),
        pytest.param(
            b"\x7d\x7e" + GOOD, [LineFault(Fault.INCOMPLETE_PACKET, 2), SOUND], id="nothing inside"
        ),
        pytest.param(
            b"\x7d\x7d\x7e" + GOOD,
            [LineFault(Fault.LOST_BYTES, 1), LineFault(Fault.INCOMPLETE_PACKET, 2), SOUND],
            id="flags only",
        ),
        pytest.param(
            LENGTH_START + b"\xff\xff\xff\xff\0" + GOOD,
            [LineFault(Fault.OUT_OF_BUFFER, 1), LineFault(Fault.JUNK, 8), SOUND],
            id="impossible length",
        ),
        pytest.param(
            LENGTH_START + b"\x02\0\0\0\0\x01" + GOOD + GOOD,
            [LineFault(Fault.LOST_BYTES, 1), LineFault(Fault.JUNK, 9), SOUND, SOUND],
            id="length packet that is cut short",
        ),
        pytest.param(
            b"\x7d\x51\x02\0\0\0\x01\x01\x01" + GOOD,
            [LineFault(Fault.LOST_BYTES, 9), SOUND],
            id="fast packet with a bad checksum",
        ),
        pytest.param(
            b"\x7d\x51\0\0\0\0\x01" + GOOD,
            [LineFault(Fault.LOST_BYTES, 7), SOUND],
            id="fast packet without data",
        ),
    ],
)
def test_fault(line: bytes, expected: list) -> None:
    assert decode([line]) == expected


@pytest.mark.parametrize(
    ("packing", "false_start"),
    [
        (Packing.LENGTH, b"\x7d\x01\x02"),
        (Packing.LENGTH, b"\x7d\x01\x7f"),
        (Packing.LENGTH, b"\x7d\x7d"),
        (Packing.FAST, b"\x7d\x01\x02"),
        (Packing.FAST, b"\x7d\x7d"),
    ],
)
def test_packet_behind_a_false_start(packing: Packing, false_start: bytes) -> None:
    # It holds a start and an end flag of its own, which the false start cannot tell apart.
    data = b"\xa0\x7e\x01\x7d\x02"
    items = decode([GOOD + false_start + encode(data, packing) + GOOD])
    assert [item for item in items if isinstance(item, Packet)] == [
        SOUND,
        Packet(data, packing),
        SOUND,
    ]


def test_impossible_starts_inside_a_broken_packet_are_passed_over() -> None:
    junk = b"\x7d\x51\xff\xff\xff\xff" + LENGTH_START + b"\xff\xff\xff\xff" + b"\x01\x7e"
    assert decode([b"\x7d\x01" + junk + GOOD])[-1] == SOUND


def test_packet_whose_start_flag_is_hidden_by_junk() -> None:
    hidden = encode(b"\x10\x7d\x11")
    items = decode([b"\x7d\x01\x02\x7e" + b"\x7d\x7f\x7d\x03\x7f" + hidden + GOOD])
    assert items[-2:] == [Packet(b"\x10\x7d\x11"), SOUND]


def test_length_packet_handed_out_too_early_does_not_take_the_next_one_along() -> None:
    short = encode(b"\x01\x02\x03\x04", Packing.LENGTH)[:-1]
    stream = short + GOOD + GOOD
    items = decode([stream[: len(short) + 1], stream[len(short) + 1 :]])
    assert items[0] == Packet(b"\x01\x02\x03\x7d", Packing.LENGTH)
    assert items[1].fault is Fault.LOST_BYTES
    assert items[-2:] == [SOUND, SOUND]


def test_start_flag_without_end_is_given_up_at_the_limit() -> None:
    decoder = PacketDecoder()
    items = decode([b"\x7d" + bytes(MAX_PACKET - 1)], decoder)
    assert items == []
    assert decoder.n_buffered == MAX_PACKET
    assert decode([b"\0"], decoder) == [
        LineFault(Fault.OUT_OF_BUFFER, 1),
        LineFault(Fault.JUNK, MAX_PACKET),
    ]
    assert decode([GOOD], decoder) == [SOUND]


def test_packets_behind_a_start_flag_without_end_are_found_at_the_limit() -> None:
    one = encode(b"\xa0\x12" + bytes(1000), Packing.LENGTH)
    stream = b"\x7d\x01" + one * (MAX_PACKET // len(one) + 1)
    items = decode(stream[k : k + 999] for k in range(0, len(stream), 999))
    assert [type(i) for i in items[:2]] == [LineFault, LineFault]
    assert items[2:] == [Packet(one[9:], Packing.LENGTH)] * (MAX_PACKET // len(one) + 1)


# ---------------------------------------------------------------- any corruption


FLAGS = (START, END, ESC, 0x51, 0x7C, 0)


@dataclass(frozen=True)
class Damage:
    """One thing that a line does to the bytes on it."""

    kind: str
    where: int
    value: bytes

    def apply(self, stream: bytes) -> tuple[bytes, int]:
        """Return the damaged stream, and how many packets that may cost."""
        at = self.where % (len(stream) or 1)
        if self.kind == "drop":
            return stream[:at] + stream[at + 1 :], 1
        if self.kind == "insert":
            return stream[:at] + self.value + stream[at:], 1
        # Two packets joined like this have a right checksum together: see x2radar.framing.
        joins = stream[at : at + 1] == b"\x7e" and self.value == b"\x7f"
        return stream[:at] + self.value + stream[at + 1 :], 2 if joins else 1


one_byte = st.one_of(
    st.binary(min_size=1, max_size=1), st.sampled_from(FLAGS).map(lambda b: bytes([b]))
)
some_bytes = st.one_of(
    one_byte, st.binary(max_size=30), st.lists(st.sampled_from(FLAGS), max_size=6).map(bytes)
)
places = st.integers(0, 500)
damages = st.one_of(
    st.builds(Damage, st.just("flip"), places, one_byte),
    st.builds(Damage, st.just("drop"), places, st.just(b"")),
    st.builds(Damage, st.just("insert"), places, some_bytes),
)

# Enough sound packets to end every wait for a false length.
_LONG = encode(b"\x30\x11\0\0\0" + b"\x55" * 4000)
FLUSH = _LONG * (MAX_PACKET // len(_LONG) + 2)


def n_missing(sent: list[Packet], got: list) -> int:
    """Count sent packets that did not arrive, in order (longest common subsequence)."""
    row = [0] * (len(got) + 1)
    for packet in sent:
        last = 0
        for k, item in enumerate(got):
            last, row[k + 1] = row[k + 1], last + 1 if item == packet else max(row[k], row[k + 1])
    return len(sent) - row[-1]


def read_damaged(stream: bytes, cuts: Iterable[int] = ()) -> list:
    decoder = PacketDecoder()
    items = decode(cut(stream, cuts), decoder)
    assert decoder.n_buffered <= len(stream)
    n_bytes = sum(i.n_bytes for i in items if isinstance(i, LineFault))
    assert n_bytes + decoder.n_buffered <= len(stream)
    waiting = decoder.n_buffered
    return items + (decode([FLUSH], decoder)[:100] if waiting else [])


@settings(max_examples=500)
@given(
    data=st.lists(escaped_payloads, min_size=1, max_size=8),
    marks=st.lists(damages, min_size=1, max_size=3),
    cuts=st.lists(places, max_size=6),
)
def test_damage_costs_at_most_one_escaped_packet_each(data, marks, cuts) -> None:
    sent = [Packet(d) for d in data]
    stream, allowed = b"".join(encode(d) for d in data), 0
    for mark in marks:
        stream, cost = mark.apply(stream)
        allowed += cost
    assert n_missing(sent, read_damaged(stream, cuts)) <= allowed


def test_every_single_damage_to_a_stream_costs_at_most_one_packet() -> None:
    rng = np.random.default_rng(1)
    mixed = np.concatenate([np.arange(256), np.repeat(FLAGS, 30)]).astype(np.uint8)
    data = [rng.choice(mixed, rng.integers(1, 15)).tobytes() for _ in range(14)]
    sent = [Packet(d) for d in data if d[0] != 0x51]
    stream = b"".join(encode(p.data) for p in sent)
    for at in range(len(stream)):
        values = {bytes([f]) for f in FLAGS} | {bytes([stream[at] ^ 1 << bit]) for bit in range(8)}
        marks = [Damage("drop", at, b"")]
        marks += [Damage(kind, at, value) for kind in ("flip", "insert") for value in values]
        marks += [Damage("insert", at, rng.bytes(5)), Damage("insert", at, b"\x7d\x7f")]
        for mark in marks:
            damaged, cost = mark.apply(stream)
            assert n_missing(sent, read_damaged(damaged)) <= cost, mark


@settings(max_examples=300)
@given(
    packets=st.lists(any_packet, min_size=1, max_size=8),
    marks=st.lists(damages, min_size=1, max_size=3),
    cuts=st.lists(places, max_size=6),
)
def test_any_packing_is_found_again_after_damage(packets, marks, cuts) -> None:
    before = b"".join(encode(data, packing) for data, packing in packets)
    for mark in marks:
        before, _ = mark.apply(before)
    # What follows is sound, and longer than any wait that the damage can cause.
    items = decode([*cut(before, cuts), FLUSH, GOOD])
    assert items[-1] == SOUND
    assert items.count(decode([_LONG])[0]) >= MAX_PACKET // len(_LONG)


@pytest.mark.parametrize("packing", Packing)
def test_noise_never_raises_and_the_buffer_stays_bounded(packing: Packing) -> None:
    rng = np.random.default_rng(2)
    decoder = PacketDecoder()
    for length in (1, 7, 100, 5000) * 20:
        noise = rng.choice(FLAGS, length).astype(np.uint8).tobytes() + rng.bytes(length)
        decode([noise, encode(rng.bytes(9) + b"\x01", Packing.LENGTH)], decoder)
        assert decoder.n_buffered <= MAX_PACKET
    assert decode([FLUSH, encode(b"\x10", packing), GOOD], decoder)[-2:] == [
        Packet(b"\x10", packing),
        SOUND,
    ]


@pytest.mark.parametrize(
    "pattern",
    [b"\x7d", b"\x7e", b"\x7f", b"\x7c", b"\x7d\x51", b"\x7d\x00", b"\x7f\x7d", b"\x7f\x7e\x01"],
)
def test_a_stuck_line_is_read_in_linear_time(pattern: bytes) -> None:
    decoder = PacketDecoder()
    line = pattern * (2 * MAX_PACKET // len(pattern))
    for k in range(0, len(line), 4096):
        n_items = len(decoder.feed(line[k : k + 4096]))
        assert n_items <= 4096
        assert decoder.n_buffered <= MAX_PACKET
    assert decode([b"\x7e", FLUSH], decoder)[-1] == decode([_LONG])[0]


def test_a_frame_is_copied_once_on_its_way_to_a_message():
    values = np.linspace(0, 100, 768, dtype=np.float32)
    (item,) = PacketDecoder().feed(encode(codec.encode(Data(0, 1, values))))
    message = codec.decode_response(item.data)
    assert np.shares_memory(np.frombuffer(item.data, np.uint8), message.values)
    assert not message.values.flags.writeable
    assert np.array_equal(message.values, values)
