"""What is said of lines that are damaged in awkward places, byte for byte.

Every row is a line, cut where a reader of a port may cut it, and what becomes of it piece by
piece: packets, faults, and how many bytes wait for more.
"""

import pytest

from x2radar.wire.framing import Fault, LineFault, Packet, PacketDecoder, Packing

LOST, JUNK, CRC = Fault.LOST_BYTES, Fault.JUNK, Fault.CRC_ERROR
NOTHING, TOO_LONG = Fault.INCOMPLETE_PACKET, Fault.OUT_OF_BUFFER
GOOD = "7d 10 6d 7e"


def is_dropped(fault: Fault, n_bytes: int) -> LineFault:
    return LineFault(fault, n_bytes)


def packet(data: str, packing: Packing = Packing.ESCAPED) -> Packet:
    return Packet(bytes.fromhex(data), packing)


SOUND = packet("10")
LINES = {
    "a packet of a checksum alone is none, and an end flag too many is junk": (
        ["02 7d 7f 7d 7e", "7e"],
        [([is_dropped(JUNK, 1), is_dropped(NOTHING, 4)], 0), ([is_dropped(JUNK, 1)], 0)],
    ),
    "a fast packet that breaks off is given up at the next packet": (
        ["00 7d 7d 51", "01 00", "00 00", GOOD],
        [
            ([is_dropped(JUNK, 1)], 3),
            ([], 5),
            ([], 7),
            ([is_dropped(LOST, 1), is_dropped(LOST, 6), SOUND], 0),
        ],
    ),
    "a packet that holds an escaped flag only": (
        ["7d 51 05", "00", "00 00 7c 7d 7f", "", GOOD],
        [
            ([], 3),
            ([], 4),
            ([], 9),
            ([], 9),
            ([is_dropped(LOST, 7), is_dropped(CRC, 2), SOUND], 0),
        ],
    ),
    "a length packet behind junk, and the beginning of one behind it": (
        ["7e 7c 7c 7c 7c 03 00 00 00 00 03 7e 7c"],
        [([is_dropped(JUNK, 1), packet("03 7e 7c", Packing.LENGTH)], 0)],
    ),
    "escapes before a false start flag": (
        ["7d 7d 7f 7e", "7f 7f 03 7d 7e"],
        [([], 4), ([is_dropped(LOST, 1), is_dropped(LOST, 6), is_dropped(NOTHING, 2)], 0)],
    ),
    "an escaped end flag is no packet": (
        ["51 7c", "7d 7f 7e 7e"],
        [([is_dropped(JUNK, 1)], 1), ([is_dropped(JUNK, 1), is_dropped(NOTHING, 4)], 0)],
    ),
    "two escapes guard no start flag": (
        ["7d 7f", "7f", GOOD],
        [([], 2), ([], 3), ([is_dropped(LOST, 3), SOUND], 0)],
    ),
    "junk in pieces": (
        ["01 00 7d", "7e", "ef a9 7f 7f 7f 7d"],
        [([is_dropped(JUNK, 2)], 1), ([is_dropped(NOTHING, 2)], 0), ([is_dropped(JUNK, 5)], 1)],
    ),
    "a length packet of no byte is told once its header is whole": (
        ["7c 7c 7c 7c 00 00 00 00", "00", "7f"],
        [([], 8), ([is_dropped(TOO_LONG, 1), is_dropped(JUNK, 8)], 0), ([is_dropped(JUNK, 1)], 0)],
    ),
    "an escaped fast start in a broken packet is none": (
        ["00 7d 00 7f 7d 51 7d 7e", GOOD],
        [([is_dropped(JUNK, 1), is_dropped(LOST, 5), is_dropped(NOTHING, 2)], 0), ([SOUND], 0)],
    ),
    "a fast packet behind an escaped one": (
        ["7d 7d", "7c 05 04 7e 7d 51 01 00 00 00 64 49"],
        [([], 2), ([is_dropped(LOST, 1), packet("7c 05"), packet("64", Packing.FAST)], 0)],
    ),
    "a fast packet that ends within its header": (
        ["7d 51 7f 00 00 7e"],
        [([is_dropped(CRC, 6)], 0)],
    ),
    "a first packet that lost its end": (
        ["7d", "7f", GOOD],
        [([], 1), ([], 2), ([is_dropped(CRC, 6)], 0)],
    ),
    "a start flag and an escaped one": (
        ["7d", "7d", "7f", "7d", "00", "00", "7e"],
        [*([([], k) for k in range(1, 7)]), ([is_dropped(LOST, 1), packet("7d 00")], 0)],
    ),
    "an odd run of escapes across two pieces": (
        ["7d 7f 7c 7f 7f 7f", "7f 7e"],
        [([], 6), ([is_dropped(CRC, 8)], 0)],
    ),
    "a length packet's header alone waits": (["7c 7c 7c 7c 01 00 00 00 7c"], [([], 9)]),
    "an escaped fast start at the beginning": (
        ["7d 7f 7d 51 7f 7f 2e", "7d", "7e"],
        [([], 7), ([], 8), ([is_dropped(LOST, 7), is_dropped(NOTHING, 2)], 0)],
    ),
    "an impossible length is dropped a byte at a time and told at once": (
        ["7c 7c", "7c 7c", "7c 00 00 01", GOOD],
        [([], 2), ([], 4), ([], 8), ([is_dropped(TOO_LONG, 2), is_dropped(JUNK, 6), SOUND], 0)],
    ),
    "junk that ends in 7c, and a packet in pieces": (
        ["7f", "7c", "7d", "7f 7f 7d 7d 00 00 7c 05", "04", "7e"],
        [
            ([is_dropped(JUNK, 1)], 0),
            ([], 1),
            ([is_dropped(JUNK, 1)], 1),
            ([], 9),
            ([], 10),
            ([is_dropped(LOST, 4), packet("00 00 7c 05")], 0),
        ],
    ),
    "after a good packet an escape before a start flag is one again": (
        ["7d 7c 03 10 7c 51 7c 03 05 02 01 7f 7f 05 3c 7e 7d 7f 7f 7f 7d 10 6d 7e"],
        [([packet("7c 03 10 7c 51 7c 03 05 02 01 7f 05"), is_dropped(CRC, 8)], 0)],
    ),
    "of a start flag and a length packet behind junk the first counts": (
        ["7e 7d 7c 7c 7c 7c"],
        [([is_dropped(JUNK, 1)], 5)],
    ),
    "a length packet behind junk waits for its header": (
        ["7e 7c 7c 7c 7c"],
        [([is_dropped(JUNK, 1)], 4)],
    ),
    "an escaped escape behind other escapes": (
        ["7d 05 7f 7d 7f 00 7f 7f 7d 07 7e"],
        [([packet("05 7d 00 7f 7d")], 0)],
    ),
    "a length packet behind a false start waits for its bytes": (
        ["7d 7d 7c 7c 7c 7c 0c 00 00 00 7f 7e 7d 6d 7e"],
        [([is_dropped(LOST, 2)], 13)],
    ),
    "only what lies before a length packet is dropped": (
        ["20 7d 7c 7c 7c 7c 01 00 00 00 7d 7e"],
        [([is_dropped(JUNK, 1), is_dropped(LOST, 1), packet("7e", Packing.LENGTH)], 0)],
    ),
    "a length packet directly behind a broken start": (
        ["7d 7c 7c 7c 7c 08 00 00 00 7e"],
        [([is_dropped(CRC, 1)], 9)],
    ),
    "a fast packet of no byte in a broken packet is none": (
        ["7d 7d 51 00 00 00 00 7d 28 7e"],
        [([is_dropped(LOST, 7), is_dropped(NOTHING, 3)], 0)],
    ),
    "a length packet longer than the limit is refused by its header": (
        ["7c 7c 7c 7c 00 00 02 00 7e"],
        [([is_dropped(TOO_LONG, 1), is_dropped(JUNK, 8)], 0)],
    ),
}


def read(pieces: list[str]) -> list:
    decoder = PacketDecoder()
    return [(decoder.feed(bytes.fromhex(each)), decoder.n_buffered) for each in pieces]


@pytest.mark.parametrize(("pieces", "told"), LINES.values(), ids=LINES)
def test_what_is_said_of_a_line(pieces: list[str], told: list) -> None:
    assert read(pieces) == told


@pytest.mark.parametrize(("pieces", "told"), LINES.values(), ids=LINES)
def test_the_same_packets_come_of_a_line_byte_by_byte(pieces: list[str], told: list) -> None:
    alone = [f"{byte:02x}" for each in pieces for byte in bytes.fromhex(each)]
    items = [item for out, _ in read(alone) for item in out if isinstance(item, Packet)]
    expected = [item for out, _ in told for item in out if isinstance(item, Packet)]
    assert items == expected


def test_a_reset_in_a_packet_forgets_how_far_it_was_searched() -> None:
    decoder = PacketDecoder()
    assert decoder.feed(bytes.fromhex("7d 7c 01")) == []
    decoder.reset()
    assert decoder.feed(b"\x7e") == [is_dropped(JUNK, 1)]
    assert decoder.feed(bytes.fromhex(GOOD)) == [SOUND]
    decoder.feed(bytes.fromhex("7d 01 02 03 04 05 06 07"))
    decoder.reset()
    assert decoder.feed(bytes.fromhex(GOOD)) == [SOUND]
    assert decoder.n_buffered == 0


def test_a_reset_forgets_that_a_fast_packet_may_have_an_end_flag() -> None:
    decoder = PacketDecoder()
    assert decoder.feed(bytes.fromhex("7d 51 01 00 00 00 64 49")) == [packet("64", Packing.FAST)]
    decoder.reset()
    assert decoder.feed(b"\x7e") == [is_dropped(JUNK, 1)]
