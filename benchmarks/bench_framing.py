"""How fast packets are decoded, against a byte-at-a-time state machine in the same run.

The stream is what a module sends that streams 768-bin complex baseband: escaped IQ packets.
Four ways are timed in turn, several rounds, and medians of the rounds' ratios printed: the
driver up to frames, a state machine with one call a byte (packets only), the same as one
tight loop, and a copy of the same bytes. One core; run it alone.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable

import numpy as np

from x2radar.device.assemble import FrameAssembler
from x2radar.modules.x2 import RadarSettings
from x2radar.wire.codec import decode_response, encode
from x2radar.wire.framing import Packet, PacketDecoder
from x2radar.wire.framing import encode as frame
from x2radar.wire.messages import BasebandIq

CHUNK = 1 << 16  # what one read of a port returns at most


class StateMachine:
    """A byte-at-a-time parser as clients of such modules write it: one call a byte."""

    def __init__(self) -> None:
        self.good = 0
        self._state = "hunt"
        self._data = bytearray()
        self._crc = 0

    def push(self, byte: int) -> None:
        """Take one byte."""
        if self._state == "hunt":
            if byte == 0x7D:
                self._state = "data"
                self._data = bytearray()
                self._crc = 0x7D
        elif self._state == "escape":
            self._take(byte)
            self._state = "data"
        elif byte == 0x7F:
            self._state = "escape"
        elif byte == 0x7E:
            self.good += self._crc == 0 and len(self._data) > 1
            self._state = "hunt"
        else:
            self._take(byte)

    def _take(self, byte: int) -> None:
        self._data.append(byte)
        self._crc ^= byte


def state_machine(stream: bytes) -> int:
    """Decode escaped packets with one call a byte; return how many are sound."""
    machine = StateMachine()
    for byte in stream:
        machine.push(byte)
    return machine.good


def inline_loop(stream: bytes) -> int:
    """Decode escaped packets in one tight loop, as fast as plain Python gets."""
    good = 0
    inside = escaped = False
    data = bytearray()
    crc = 0
    for byte in stream:
        if not inside:
            if byte == 0x7D:
                inside, escaped, crc = True, False, 0x7D
                data.clear()
        elif escaped:
            data.append(byte)
            crc ^= byte
            escaped = False
        elif byte == 0x7F:
            escaped = True
        elif byte == 0x7E:
            good += crc == 0 and len(data) > 1
            inside = False
        else:
            data.append(byte)
            crc ^= byte
    return good


def driver(stream: bytes) -> int:
    """Decode to frames as the driver does, in reads of `CHUNK` bytes."""
    decoder = PacketDecoder()
    assembler = FrameAssembler(RadarSettings(output="iq"))
    good = 0
    for at in range(0, len(stream), CHUNK):
        for item in decoder.feed(stream[at : at + CHUNK]):
            if isinstance(item, Packet):
                good += assembler.frame(decode_response(item.data), 0.0) is not None
    return good


def copy(stream: bytes) -> int:
    """Copy the bytes."""
    return len(bytearray(stream))


def seconds(work: Callable[[bytes], int], stream: bytes) -> float:
    """Return the time of one call."""
    started_s = time.perf_counter()
    work(stream)
    return time.perf_counter() - started_s


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--packets", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=9)
    args = parser.parse_args()
    rng = np.random.default_rng(0)
    parts = []
    for counter in range(1, args.packets + 1):
        i, q = rng.standard_normal((2, 768)).astype(np.float32)
        parts.append(frame(encode(BasebandIq(counter, 0.00366, 41e9, 6.8e9, 0.6, i, q))))
    stream = b"".join(parts)
    assert driver(stream) == args.packets
    n_slow = max(1, args.packets // 20)
    slow_stream = b"".join(parts[:n_slow])
    assert state_machine(slow_stream) == inline_loop(slow_stream) == n_slow
    ways = (
        (driver, stream),
        (state_machine, slow_stream),
        (inline_loop, slow_stream),
        (copy, stream),
    )
    rows = [[len(data) / seconds(work, data) for work, data in ways] for _ in range(args.rounds)]
    ours, machine, loop, floor = (statistics.median(c) for c in zip(*rows, strict=True))
    per_packet_s = len(stream) / args.packets / ours
    print(
        json.dumps(
            {
                "speedup": round(statistics.median(r[0] / r[1] for r in rows), 1),
                "speedup_over_inline_loop": round(statistics.median(r[0] / r[2] for r in rows), 1),
                "driver_mb_per_s": round(ours / 1e6, 1),
                "state_machine_mb_per_s": round(machine / 1e6, 2),
                "inline_loop_mb_per_s": round(loop / 1e6, 2),
                "copy_mb_per_s": round(floor / 1e6, 1),
                "us_per_frame": round(per_packet_s * 1e6, 1),
                "core_share_60hz": round(60 * per_packet_s, 5),
                "core_share_200hz": round(200 * per_packet_s, 5),
                "modules_per_core_60hz": round(1 / (60 * per_packet_s)),
                "modules_per_core_200hz": round(1 / (200 * per_packet_s)),
            }
        )
    )


if __name__ == "__main__":
    main()
