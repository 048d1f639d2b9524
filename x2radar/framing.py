"""Bytes to packets and back: flags, escapes, checksum, all three packings, resynchronisation.

Three packings share one line (MCP, XTAN-11 rev C section 2; mcp_wrapper 1.3.1)::

    escaped       7D  esc(data) esc(crc)  7E        crc = 7D ^ every unescaped data byte
    length        7C 7C 7C 7C  u32 length  00  data[length]
    fast (old)    7D 51  u32 length  data[length]  crc  [7E]

``esc(b)`` puts 7F before 7D, 7E and 7F and leaves the byte itself as it is.

What a line does to them, and what `PacketDecoder` does about it:

* a byte lost or flipped: the checksum fails, or a start flag shows up inside the packet.
  The packet is dropped, and reading goes on at that start flag, else behind the end flag.
* junk between packets: skipped up to the next start flag, and counted.
* a length that lies: a length packet must be followed by a start flag; if it is not, only
  its header is dropped and the bytes inside it are searched again.
* an end flag that is lost: the packet ends at the next start flag or at `MAX_PACKET`.

Some hosts and modules send the checksum unescaped; a 7D or 7F directly before the end flag
is read that way when the checksum then is right.

The decoder never raises; it owns no port and no clock, and its buffer is bounded.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from x2radar.errors import ProtocolError

START, END, ESC = 0x7D, 0x7E, 0x7F
LENGTH_START = b"\x7c\x7c\x7c\x7c"
LENGTH_HEADER = 9
FAST = 0x51
FAST_HEADER = 6
MAX_PACKET = 1 << 17

_START = b"\x7d"
_END = b"\x7e"
_ESC = b"\x7f"
_ESC_ESC = b"\x7f\x7f"
_ESC_START = b"\x7f\x7d"
_ESC_END = b"\x7f\x7e"


class Packing(Enum):
    """How a packet was framed on the wire."""

    ESCAPED = "escaped"
    LENGTH = "length"
    FAST = "fast"


class Fault(Enum):
    """What went wrong on the line (names after mcp_wrapper's parser errors)."""

    CRC_ERROR = "crc error"
    LOST_BYTES = "lost bytes"
    INCOMPLETE_PACKET = "incomplete packet"
    OUT_OF_BUFFER = "packet too long"
    JUNK = "junk between packets"


@dataclass(frozen=True, slots=True)
class Packet:
    """One sound packet: its unescaped data, without flags and checksum."""

    data: bytes
    packing: Packing = Packing.ESCAPED


@dataclass(frozen=True, slots=True)
class LineFault:
    """Bytes that were dropped, and why."""

    fault: Fault
    n_bytes: int


def checksum(data: bytes | bytearray | memoryview) -> int:
    """Return 0x7D XOR every byte of `data`."""
    n_words = len(data) >> 3
    crc = START
    if n_words:
        word = int(np.bitwise_xor.reduce(np.frombuffer(data, np.uint64, n_words)))
        word ^= word >> 32
        word ^= word >> 16
        crc ^= (word ^ (word >> 8)) & 0xFF
    for byte in data[n_words << 3 :]:
        crc ^= byte
    return crc


def escape(data: bytes) -> bytes:
    """Return `data` with 7F put before every 7D, 7E and 7F."""
    return data.replace(_ESC, _ESC_ESC).replace(_START, _ESC_START).replace(_END, _ESC_END)


def unescape(body: bytes) -> bytes:
    """Return `body` with every escape taken out.

    A run of 7F begins with an active escape, because the byte before it is none; so pairs
    counted from the left are escaped 7Fs and every 7F left over is an escape.
    """
    if _ESC not in body:
        return body
    return _ESC.join([part.replace(_ESC, b"") for part in body.split(_ESC_ESC)])


def encode(data: bytes, packing: Packing = Packing.ESCAPED) -> bytes:
    """Frame `data` as one packet.

    Parameters
    ----------
    data : bytes
        Message bytes, at least one.
    packing : Packing
        Which of the three forms to use; `Packing.FAST` takes the data behind the 51 byte.

    Returns
    -------
    bytes
        The packet as it goes over the wire.

    Raises
    ------
    ProtocolError
        If `data` is empty or longer than `MAX_PACKET`.
    """
    if not 0 < len(data) <= MAX_PACKET - LENGTH_HEADER:
        msg = f"a packet holds 1 to {MAX_PACKET - LENGTH_HEADER} bytes, not {len(data)}"
        raise ProtocolError(msg)
    if packing is Packing.ESCAPED:
        return _START + escape(data + bytes([checksum(data)])) + _END
    length = len(data).to_bytes(4, "little")
    if packing is Packing.LENGTH:
        return LENGTH_START + length + b"\x00" + data
    body = bytes([FAST]) + length + data
    return _START + body + bytes([checksum(body)]) + _END


class PacketDecoder:
    """Turn a byte stream, cut anywhere, into packets and line faults."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._scanned = 0
        self._out: list[Packet | LineFault] = []

    @property
    def n_buffered(self) -> int:
        """Bytes held back because their packet is not complete; at most `MAX_PACKET` + 1 read."""
        return len(self._buffer)

    def reset(self) -> None:
        """Forget what is buffered, as after a reopened port."""
        self._buffer.clear()
        self._scanned = 0

    def feed(self, data: bytes | bytearray) -> list[Packet | LineFault]:
        """Take the next bytes; return what they complete, in order.

        Parameters
        ----------
        data : bytes
            Any piece of the stream, also empty.

        Returns
        -------
        list of Packet or LineFault
            Packets with good checksums, and every stretch of bytes that was dropped.
        """
        self._buffer += data
        done = 0
        while (used := self._step(done)) > 0:
            done += used
            self._scanned = done
        del self._buffer[:done]
        self._scanned = max(0, self._scanned - done)
        out, self._out = self._out, []
        return out

    def _step(self, at: int) -> int:
        """Consume one packet or one stretch of junk at `at`; 0 means: more bytes are needed."""
        buffer = self._buffer
        left = len(buffer) - at
        if left == 0:
            return 0
        if buffer[at] == START:
            if left > 1 and buffer[at + 1] == FAST:
                return self._fast(at, left)
            return self._escaped(at, left)
        if buffer.startswith(LENGTH_START, at):
            return self._length(at, left)
        return self._junk(at, left)

    def _drop(self, fault: Fault, n_bytes: int) -> int:
        self._out.append(LineFault(fault, n_bytes))
        return n_bytes

    def _junk(self, at: int, left: int) -> int:
        start = self._next_start(at)
        if start < 0:
            keep = _tail_of_length_start(self._buffer, at)
            return self._drop(Fault.JUNK, left - keep) if left > keep else 0
        return self._drop(Fault.JUNK, start - at)

    def _next_start(self, at: int) -> int:
        """Find the next start flag while hunting; a flag behind an escape is data."""
        buffer = self._buffer
        length = buffer.find(LENGTH_START, at)
        start = buffer.find(_START, at)
        while start > 0 and start > at and buffer[start - 1] == ESC:
            start = buffer.find(_START, start + 1)
        if length < 0 or start < 0:
            return max(length, start)
        return min(length, start)

    def _escaped(self, at: int, left: int) -> int:
        buffer = self._buffer
        end = buffer.find(_END, max(at + 1, self._scanned))
        while end >= 0 and buffer[end - 1] == ESC and self._is_escaped(end, at):
            if end + 1 < len(buffer) and buffer[end + 1] in (START, LENGTH_START[0]):
                body = bytes(buffer[at + 1 : end - 1])
                data = unescape(body)
                if data and checksum(data) == ESC and not _has_start(body):
                    self._out.append(Packet(data))
                    return end + 1 - at
            end = buffer.find(_END, end + 1)
        if end < 0:
            return self._unfinished(at, left)
        body = bytes(buffer[at + 1 : end])
        if _START in body and _has_start(body):
            if body.endswith(_START) and not _has_start(body[:-1]):
                data = unescape(body[:-1])
                if data and checksum(data) == START:
                    self._out.append(Packet(data))
                    return end + 1 - at
            return self._drop(Fault.LOST_BYTES, _last_start(body) + 1)
        data = unescape(body)
        size = end + 1 - at
        if len(data) < 2:
            return self._drop(Fault.INCOMPLETE_PACKET, size)
        if checksum(data):
            return self._drop(Fault.CRC_ERROR, size)
        self._out.append(Packet(data[:-1]))
        return size

    def _unfinished(self, at: int, left: int) -> int:
        if left <= MAX_PACKET:
            # Everything up to here holds no end flag; a lone ESC at the end may still guard one.
            self._scanned = max(at + 1, len(self._buffer) - 1)
            return 0
        return self._drop(Fault.OUT_OF_BUFFER, self._resume_after(at))

    def _resume_after(self, at: int) -> int:
        start = self._next_start(at + 1)
        return (start if start > 0 else len(self._buffer)) - at

    def _is_escaped(self, flag: int, at: int) -> bool:
        """Say whether the byte at `flag` is preceded by an odd run of escapes."""
        run = flag - 1
        while run > at and self._buffer[run] == ESC:
            run -= 1
        return (flag - 1 - run) % 2 == 1

    def _length(self, at: int, left: int) -> int:
        if left < LENGTH_HEADER:
            return 0
        buffer = self._buffer
        n = int.from_bytes(buffer[at + 4 : at + 8], "little")
        if not 0 < n <= MAX_PACKET - LENGTH_HEADER:
            return self._drop(Fault.OUT_OF_BUFFER, 1)
        size = LENGTH_HEADER + n
        if left < size:
            return 0
        if left > size and buffer[at + size] not in (START, LENGTH_START[0]):
            return self._drop(Fault.LOST_BYTES, 1)
        self._out.append(Packet(bytes(buffer[at + LENGTH_HEADER : at + size]), Packing.LENGTH))
        return size

    def _fast(self, at: int, left: int) -> int:
        if left < FAST_HEADER:
            return 0
        buffer = self._buffer
        n = int.from_bytes(buffer[at + 2 : at + 6], "little")
        size = FAST_HEADER + n + 1
        if n == 0 or size > MAX_PACKET:
            return self._drop(Fault.OUT_OF_BUFFER, 1)
        if left < size:
            return 0
        body = bytes(buffer[at + 1 : at + size])
        if checksum(body):
            return self._drop(Fault.CRC_ERROR, self._resume_after(at))
        self._out.append(Packet(body[5:-1], Packing.FAST))
        return size + (1 if left > size and buffer[at + size] == END else 0)


def _has_start(body: bytes) -> bool:
    """Say whether `body` holds a start flag that no escape guards."""
    return any(p.count(_START) != p.count(_ESC_START) for p in body.split(_ESC_ESC))


def _last_start(body: bytes) -> int:
    """Return the position of the last unguarded start flag in `body`."""
    at = body.rfind(_START)
    while at > 0:
        run = at
        while run > 0 and body[run - 1] == ESC:
            run -= 1
        if (at - run) % 2 == 0:
            break
        at = body.rfind(_START, 0, at)
    return at


def _tail_of_length_start(buffer: bytearray, at: int) -> int:
    """Return how many bytes at the end may be the beginning of a length packet."""
    for n in (3, 2, 1):
        if len(buffer) - at >= n and buffer.endswith(LENGTH_START[:n]):
            return n
    return 0
