"""Framing: packets cut anywhere are read again; what a bad line loses, is told and may cost."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from x2radar.errors import ProtocolError
from x2radar.wire import codec, framing
from x2radar.wire.framing import LENGTH_START, MAX_PACKET, Fault, LineFault, Packet, PacketDecoder
from x2radar.wire.messages import Data

FLAGS = (0x7D, 0x7E, 0x7F, 0x51, 0x7C, 0)


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
    body = b"\x51" + length + data
    return b"\x7d" + body + bytes([framing.checksum(body), 0x7E])


many_flags = st.lists(st.sampled_from((*FLAGS, 2, 3)), min_size=1, max_size=24)
payloads = st.binary(min_size=1, max_size=40) | many_flags.map(bytes)
escaped_payloads = payloads.filter(lambda data: data[0] != 0x51)
any_packet = st.tuples(escaped_payloads, st.sampled_from(Packing)) | st.tuples(
    payloads, st.sampled_from((Packing.LENGTH, Packing.FAST))
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


@given(st.binary(max_size=70))
def test_checksum_is_the_xor_of_all_bytes(data: bytes) -> None:
    expected = 0x7D
    for byte in data:
        expected ^= byte
    for kind in (bytes, bytearray, memoryview):
        assert framing.checksum(kind(data)) == expected


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
        (b"\x7d" * (MAX_PACKET - framing.LENGTH_HEADER), Packing.LENGTH),
        (b"\x7d" * (MAX_PACKET - 7), Packing.FAST),
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
    expected = [Packet(data) for data, packing in packets]
    assert decode(cut(stream, places)) == expected
    assert decode(stream[k : k + 1] for k in range(len(stream))) == expected


GOOD = encode(b"\x10")
SOUND = Packet(b"\x10")


def test_a_length_packet_is_cut_short_where_the_next_ones_are_there() -> None:
    at_once = decode([LENGTH_START + b"\x02\0\0\0\0\x01" + GOOD + GOOD])
    assert at_once == [LineFault(Fault.LOST_BYTES, 1), LineFault(Fault.JUNK, 9), SOUND, SOUND]


def test_start_flag_without_end_is_given_up_at_the_limit() -> None:
    decoder = PacketDecoder()
    items = decode([b"\x7d" + bytes(MAX_PACKET - 1)], decoder)
    assert items == []
    assert decoder.n_buffered == MAX_PACKET
    told = [LineFault(Fault.OUT_OF_BUFFER, 1), LineFault(Fault.JUNK, MAX_PACKET)]
    assert decode([b"\0"], decoder) == told
    assert decode([GOOD], decoder) == [SOUND]


def test_packets_behind_a_start_flag_without_end_are_found_at_the_limit() -> None:
    one = encode(b"\xa0\x12" + bytes(1000), Packing.LENGTH)
    stream = b"\x7d\x01" + one * (MAX_PACKET // len(one) + 1)
    items = decode(stream[k : k + 999] for k in range(0, len(stream), 999))
    assert [type(i) for i in items[:2]] == [LineFault, LineFault]
    assert items[2:] == [Packet(one[9:])] * (MAX_PACKET // len(one) + 1)


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
        # Two packets joined like this have a right checksum together: see x2radar.wire.framing.
        joins = stream[at : at + 1] == b"\x7e" and self.value == b"\x7f"
        return stream[:at] + self.value + stream[at + 1 :], 2 if joins else 1


flags = st.sampled_from(FLAGS)
one_byte = st.binary(min_size=1, max_size=1) | flags.map(lambda b: bytes([b]))
some_bytes = one_byte | st.binary(max_size=30) | st.lists(flags, max_size=6).map(bytes)
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


@settings(max_examples=300)
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


@settings(max_examples=150)
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
    assert decode([FLUSH, encode(b"\x10", packing), GOOD], decoder)[-2:] == [SOUND, SOUND]


@pytest.mark.parametrize(
    "pattern",
    [b"\x7d", b"\x7e", b"\x7f", b"\x7c", b"\x7d\x51", b"\x7d\x00", b"\x7f\x7d", b"\x7f\x7e\x01"],
)
def test_a_stuck_line_is_read_in_linear_time(pattern: bytes) -> None:
    decoder = PacketDecoder()
    line = pattern * (MAX_PACKET * 5 // 4 // len(pattern))
    for k in range(0, len(line), 4096):
        n_items = len(decoder.feed(line[k : k + 4096]))
        assert n_items <= 4096
        assert decoder.n_buffered <= MAX_PACKET
    assert decode([b"\x7e", FLUSH], decoder)[-1] == decode([_LONG])[0]


def test_a_frame_is_copied_once_on_its_way_to_a_message():
    values = np.linspace(0, 100, 768, dtype=np.float32)
    (item,) = PacketDecoder().feed(encode(codec.encode(Data(0, 1, values))))
    message = codec.decode_response(item.data)
    assert item.data.readonly
    assert np.shares_memory(np.frombuffer(item.data, np.uint8), message.values)
    assert not message.values.flags.writeable
    assert np.array_equal(message.values, values)


LINES = """
junk before a packet: 01 02 ok = junk 2, ok
junk inside: ok 01 7c 7c ok = ok, junk 3, ok
junk ends with an escape: 01 7f ok = junk 2, ok
bad checksum: 7d 10 6c 7e ok = crc 4, ok
lost end flag: 7d 10 6d ok = lost 3, ok
end flag became an escape: the joined packets' checksum is right: 7d 10 6d 7f ok = <10 6d 7d 10>
nothing inside: 7d 7e ok = nothing 2, ok
flags only: 7d 7d 7e ok = lost 1, nothing 2, ok
impossible length: 7c 7c 7c 7c ff ff ff ff 00 ok = too long 1, junk 8, ok
fast packet with a bad checksum: 7d 51 02 00 00 00 01 01 01 ok = lost 9, ok
fast packet without data: 7d 51 00 00 00 00 01 ok = lost 7, ok
a packet of a checksum alone is none, and an end flag too many is junk:
    02 7d 7f 7d 7e / 7e = junk 1, nothing 4 / junk 1
a fast packet that breaks off is given up at the next packet:
    00 7d 7d 51 / 01 00 / 00 00 / ok = junk 1 +3 / +5 / +7 / lost 1, lost 6, ok
a packet that holds an escaped flag only:
    7d 51 05 / 00 / 00 00 7c 7d 7f /  / ok = +3 / +4 / +9 / +9 / lost 7, crc 2, ok
a length packet behind junk, and the beginning of one behind it:
    7e 7c 7c 7c 7c 03 00 00 00 00 03 7e 7c = junk 1, L<03 7e 7c>
escapes before a false start flag: 7d 7d 7f 7e / 7f 7f 03 7d 7e = +4 / lost 1, lost 6, nothing 2
an escaped end flag is no packet: 51 7c / 7d 7f 7e 7e = junk 1 +1 / junk 1, nothing 4
an escape for a checksum is one where a start flag follows: 7d 10 12 7f 7e / ok = +5 / <10 12>, ok
two escapes guard no start flag: 7d 7f / 7f / ok = +2 / +3 / lost 3, ok
junk in pieces: 01 00 7d / 7e / ef a9 7f 7f 7f 7d = junk 2 +1 / nothing 2 / junk 5 +1
a length packet of no byte is told once its header is whole:
    7c 7c 7c 7c 00 00 00 00 / 00 / 7f = +8 / too long 1, junk 8 / junk 1
an escaped fast start in a broken packet is none:
    00 7d 00 7f 7d 51 7d 7e / ok = junk 1, lost 5, nothing 2 / ok
a fast packet behind an escaped one:
    7d 7d / 7c 05 04 7e 7d 51 01 00 00 00 64 49 = +2 / lost 1, <7c 05>, F<64>
a fast packet that ends within its header: 7d 51 7f 00 00 7e = crc 6
a first packet that lost its end: 7d / 7f / ok = +1 / +2 / crc 6
a start flag and an escaped one:
    7d / 7d / 7f / 7d / 00 / 00 / 7e = +1 / +2 / +3 / +4 / +5 / +6 / lost 1, <7d 00>
an odd run of escapes across two pieces: 7d 7f 7c 7f 7f 7f / 7f 7e = +6 / crc 8
a length packet's header alone waits: 7c 7c 7c 7c 01 00 00 00 7c = +9
an escaped fast start at the beginning:
    7d 7f 7d 51 7f 7f 2e / 7d / 7e = +7 / +8 / lost 7, nothing 2
an impossible length is dropped a byte at a time and told at once:
    7c 7c / 7c 7c / 7c 00 00 01 / ok = +2 / +4 / +8 / too long 2, junk 6, ok
junk that ends in 7c, and a packet in pieces:
    7f / 7c / 7d / 7f 7f 7d 7d 00 00 7c 05 / 04 / 7e
        = junk 1 / +1 / junk 1 +1 / +9 / +10 / lost 4, <00 00 7c 05>
after a good packet an escape before a start flag is one again:
    7d 7c 03 10 7c 51 7c 03 05 02 01 7f 7f 05 3c 7e 7d 7f 7f 7f ok
        = <7c 03 10 7c 51 7c 03 05 02 01 7f 05>, crc 8
of a start flag and a length packet behind junk the first counts: 7e 7d 7c 7c 7c 7c = junk 1 +5
a length packet behind junk waits for its header: 7e 7c 7c 7c 7c = junk 1 +4
an escaped escape behind other escapes: 7d 05 7f 7d 7f 00 7f 7f 7d 07 7e = <05 7d 00 7f 7d>
a length packet behind a false start waits for its bytes:
    7d 7d 7c 7c 7c 7c 0c 00 00 00 7f 7e 7d 6d 7e = lost 2 +13
only what lies before a length packet is dropped:
    20 7d 7c 7c 7c 7c 01 00 00 00 7d 7e = junk 1, lost 1, L<7e>
a length packet directly behind a broken start: 7d 7c 7c 7c 7c 08 00 00 00 7e = crc 1 +9
a fast packet of no byte in a broken packet is none:
    7d 7d 51 00 00 00 00 7d 28 7e = lost 7, nothing 3
a length packet longer than the limit is refused by its header:
    7c 7c 7c 7c 00 00 02 00 7e = too long 1, junk 8
length packets of flags, in pieces and with the beginning of another packet behind:
    7c 7c 7c 7c 03 00 00 00 00 7d 7e 7f 7c 7c / 7c 7c 03 00 00 00 00 7d 7e 7f 7d 50
        = <7d 7e 7f> +2 / <7d 7e 7f> +2
fast packets of flags, without an end flag and with one:
    7d 51 02 00 00 00 7e 7f 2f 7d 51 02 00 00 00 7e 7f 2f 7e 7d 50 = <7e 7f>, <7e 7f> +2
an escaped checksum, a start flag: 7d 10 10 7f 7d 7e 7d 50 = <10 10> +2
and an end flag: 7d 10 13 7f 7e 7e = <10 13>
and an escape: 7d 10 12 7f 7f 7e = <10 12>
a start flag for a checksum is no start: 7d 10 10 7d 7e 7d 50 = <10 10> +2
nor is it behind an escaped escape: 7d 10 6f 7f 7f 7d 7e = <10 6f 7f>
nor behind a lost end flag: 7d 01 02 03 7f 7d 7d 10 10 7d 7e = lost 6, <10 10>
an escape for a checksum, twice: 7d 10 12 7f 7e 7d 10 12 7f 7e ok = <10 12>, <10 12>, ok
what lies before an escaped end flag has 7f for a checksum: 7d 02 7f 7e 7c 01 7c 7e = <02 7e 7c 01>
a length packet with flags of its own behind a false start:
    ok 7d 01 02 7c 7c 7c 7c 05 00 00 00 00 a0 7e 01 7d 02 ok = ok, crc 3, <a0 7e 01 7d 02>, ok
and behind one that ends with an escape:
    ok 7d 01 7f 7c 7c 7c 7c 05 00 00 00 00 a0 7e 01 7d 02 ok = ok, crc 3, <a0 7e 01 7d 02>, ok
and behind two flags:
    ok 7d 7d 7c 7c 7c 7c 05 00 00 00 00 a0 7e 01 7d 02 ok = ok, lost 1, crc 1, <a0 7e 01 7d 02>, ok
a fast packet with flags of its own behind a false start:
    ok 7d 01 02 7d 51 05 00 00 00 a0 7e 01 7d 02 89 7e ok = ok, lost 3, <a0 7e 01 7d 02>, ok
and behind two flags, too:
    ok 7d 7d 7d 51 05 00 00 00 a0 7e 01 7d 02 89 7e ok = ok, lost 2, <a0 7e 01 7d 02>, ok
impossible starts are passed over:
    7d 01 7d 51 ff ff ff ff 7c 7c 7c 7c ff ff ff ff 01 7e ok = lost 2, crc 16, ok
and hidden ones found: 7d 01 02 7e 7d 7f 7d 03 7f 7d 10 7f 7d 11 01 7e ok
    = crc 4, crc 5, <10 7d 11>, ok
a start flag alone, and an end flag: 7d / 7e = +1 / nothing 2
an escaped packet in place of a broken fast one:
    7d 51 04 00 00 00 00 7e 7f 56 7e = <51 04 00 00 00 00 7e>
start flags for data and for a checksum: 7d 00 7d 7d 7e = lost 2, lost 1, nothing 2
a needless escape is none of the data: 7d 7d 7f 00 7e = <7d>
start flags before a packet: 10 7d 7d 7d 10 6d 7e = junk 1, lost 2, ok
an escaped start flag is no bare checksum: 7d 7d 7f 7d 7f 7d 7e = lost 1, crc 6
a length packet a byte behind the first four 7c:
    7c 7d 7c 7f 01 7c 7c 7c 7c 7c 7c 03 00 00 / 00 00 7f 7c / 7d 7e 7d
        = junk 1 +13 / +17 / lost 5 +15
a length packet handed out too early takes no other along:
    7c 7c 7c 7c 04 00 00 00 00 01 02 03 7d / 10 6d 7e ok = <01 02 03 7d> / lost 1, junk 11, ok, ok
"""
"""What: bytes of the line in pieces = what is told of each piece, and of how many bytes it waits.
A packet is shown by its bytes; `ok` is `7d 10 6d 7e`, and its packet."""
names = ("lost", "junk", "crc", "nothing", "too long")
kinds = (Fault.LOST_BYTES, Fault.JUNK, Fault.CRC_ERROR, Fault.INCOMPLETE_PACKET)
FAULTS = dict(zip(names, (*kinds, Fault.OUT_OF_BUFFER), strict=True))
ACK = "7d 10 6d 7e"


def told_of(text: str) -> tuple[list, int]:
    items, _, waiting = text.partition("+")
    return [item_of(each.strip()) for each in items.split(",") if each.strip()], int(waiting or 0)


def item_of(text: str) -> Packet | LineFault:
    if text == "ok":
        return SOUND
    if text.endswith(">"):
        return Packet(bytes.fromhex(text[:-1].partition("<")[2]))
    kind, _, n_bytes = text.rpartition(" ")
    return LineFault(FAULTS[kind], int(n_bytes))


def _rows() -> Iterator:
    """Yield pieces of hex and what is told of each, for every row."""
    for row in re.sub(r"\n +", " ", LINES.strip()).splitlines():
        what, line, told = re.fullmatch(r"(.+): ([^:=]*) = (.*)", row).groups()
        pieces = [each.strip().replace("ok", ACK) for each in line.split("/")]
        yield pytest.param(pieces, [told_of(each) for each in told.split("/")], id=what)


def read(pieces: list[str]) -> list:
    decoder = PacketDecoder()
    return [(decoder.feed(bytes.fromhex(each)), decoder.n_buffered) for each in pieces]


@pytest.mark.parametrize(("pieces", "told"), list(_rows()))
def test_what_is_said_of_a_line_and_the_same_packets_byte_by_byte(pieces, told) -> None:
    assert read(pieces) == told
    alone = [f"{byte:02x}" for each in pieces for byte in bytes.fromhex(each)]
    items = [item for out, _ in read(alone) for item in out if isinstance(item, Packet)]
    expected = [item for out, _ in told for item in out if isinstance(item, Packet)]
    assert items == expected
