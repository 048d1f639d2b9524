"""Bytes to packets and back: flags, escapes, checksum, all three packings, resynchronisation.

Three packings share one line (MCP, XTAN-11 rev C section 2; mcp_wrapper 1.3.1)::

    escaped       7D  esc(data) esc(crc)  7E        crc = 7D ^ every unescaped data byte
    length        7C 7C 7C 7C  u32 length  00  data[length]
    fast (old)    7D 51  u32 length  data[length]  crc  [7E]

``esc(b)`` puts 7F before 7D, 7E and 7F and leaves the byte itself as it is.

What a line does to them, and what `PacketDecoder` does about it:

* a byte lost or flipped: the checksum fails, or a start flag shows up inside the packet.
  The packet is dropped, and reading goes on at that start flag, else behind the end flag.
* junk between packets: skipped up to the next start flag, and counted. After a fault and
  until the next good packet, nothing says whether a 7F before a start flag is an escape or
  the end of the junk; such flags are tried too.
* a length that lies: a length packet must be followed by a start; if it is not, only its
  header is dropped and the bytes inside it are searched again, also when the packet was
  handed out before the next byte arrived.
* an end flag that is lost: the packet ends at the next start flag or at `MAX_PACKET`.

So one damaged byte costs at most one escaped packet, but for an end flag that became a 7F:
it hides the start flag behind it, and the checksum of two sound packets joined like that is
right, so both go out as one. A length packet has no checksum: a wrong length that happens to
end at another start is believed.

Some hosts and modules send the checksum unescaped; a 7D or 7F directly before the end flag
is read that way when the checksum then is right (a 7F: once the next start flag arrives).

The decoder never raises; it owns no port and no clock, and its buffer is bounded.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from x2radar.errors import ProtocolError

START, END, ESC = 0x7D, 0x7E, 0x7F
FAST = 0x51
LENGTH_START = b"\x7c\x7c\x7c\x7c"
LENGTH_HEADER, _FAST_HEADER = 9, 6
MAX_PACKET = 1 << 17  # bytes: ten times the longest frame of any module, all escaped

_START, _END, _ESC = b"\x7d", b"\x7e", b"\x7f"
_ESC_ESC, _ESC_START, _ESC_END = b"\x7f\x7f", b"\x7f\x7d", b"\x7f\x7e"
_END_START, _FAST_START = b"\x7e\x7d", b"\x7d\x51"
_FIRST_FLAG, _N_FLAGS = np.uint8(START), np.uint8(3)


class Fault(Enum):
    """What went wrong on the line (names after mcp_wrapper's parser errors)."""

    CRC_ERROR = "crc error"
    LOST_BYTES = "lost bytes"
    INCOMPLETE_PACKET = "incomplete packet"
    OUT_OF_BUFFER = "packet too long"
    JUNK = "junk between packets"


_MERGED = frozenset({Fault.JUNK, Fault.OUT_OF_BUFFER})  # one, however many steps they took
PacketData = bytes | memoryview  # a view behaves as bytes in comparisons, slices and NumPy


@dataclass(frozen=True, slots=True)
class Packet:
    """One sound packet: its unescaped data, without flags and checksum.

    A view is read-only and owns its memory: the decoder's buffer goes on without it.
    """

    data: PacketData


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


def encode(data: bytes) -> bytes:
    """Return `data` as one escaped packet; ProtocolError if empty, too long or of another kind."""
    packet = _START + escape(data + bytes([checksum(data)])) + _END
    if not data or len(packet) > MAX_PACKET:
        msg = f"a packet takes up to {MAX_PACKET} bytes and is not empty: {len(data)} bytes given"
        raise ProtocolError(msg)
    if data[0] == FAST:
        msg = "an escaped packet cannot begin with 51: that is the fast packing's mark"
        raise ProtocolError(msg)
    return packet


class PacketDecoder:
    """Turn a byte stream, cut anywhere, into packets and line faults."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._scanned = 0
        self._usual = 0
        self._given_out = 0
        self._end_may_follow = False
        self._hunting = False
        self._out: list[Packet | LineFault] = []

    @property
    def n_buffered(self) -> int:
        """Bytes held back because their packet is not complete; at most `MAX_PACKET` + 1 read."""
        return len(self._buffer) - self._given_out

    def feed(self, data: bytes | bytearray) -> list[Packet | LineFault]:
        """Take any piece of the stream; return what it completes, in order.

        Packets have good checksums; every stretch of bytes that was dropped is a fault.
        """
        self._buffer += data
        done = 0
        while (used := self._step(done)) > 0:
            done += used
            # No end flag before `_scanned`: true of the bytes, whatever packet they are in.
            self._scanned = max(self._scanned, done)
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
        end_may_follow, self._end_may_follow = self._end_may_follow, False
        if buffer[at] == START:
            if left > 1 and buffer[at + 1] == FAST:
                return self._fast(at, left)
            return self._escaped(at, left)
        if buffer.startswith(LENGTH_START, at):
            return self._length(at, left)
        if end_may_follow and buffer[at] == END:
            return 1
        return self._junk(at, left)

    def _emit(self, data: PacketData) -> None:
        self._out.append(Packet(data))
        self._hunting = False

    def _drop(self, fault: Fault, n_bytes: int) -> int:
        self._hunting = True
        last = self._out[-1] if self._out else None
        if isinstance(last, LineFault) and last.fault is fault and fault in _MERGED:
            self._out[-1] = LineFault(fault, last.n_bytes + n_bytes)
        else:
            self._out.append(LineFault(fault, n_bytes))
        return n_bytes

    def _junk(self, at: int, left: int) -> int:
        buffer = self._buffer
        start = buffer.find(_START, at + 1)
        # Looking no further than the start flag keeps a line full of flags from costing n squared.
        length = buffer.find(LENGTH_START, at + 1, start if start > 0 else at + left)
        if length > 0:
            start = length
        if start > 0:
            return self._drop(Fault.JUNK, start - at)
        # Bytes at the end may be the beginning of a length packet.
        ends = (n for n in (3, 2, 1) if n <= left and buffer.endswith(LENGTH_START[:n]))
        keep = next(ends, 0)
        return self._drop(Fault.JUNK, left - keep) if left > keep else 0

    def _escaped(self, at: int, left: int) -> int:
        buffer = self._buffer
        scan = max(at + 1, self._scanned)
        if size := self._sound(at, scan):
            return size
        end = buffer.find(_END, scan)
        while end >= 0 and _is_escaped(buffer, end, at + 1):
            # In a sound packet no bare start flag follows an escaped end flag.
            if buffer[end + 1 : end + 2] == _START and self._bare_checksum(at, end - 1):
                return end + 1 - at
            end = buffer.find(_END, end + 1)
        if end < 0:
            if left > MAX_PACKET:
                return self._drop(Fault.OUT_OF_BUFFER, 1)
            # Everything up to here holds no end flag; a lone ESC at the end may still guard one.
            self._scanned = max(at + 1, len(buffer) - 1)
            return 0
        body = bytes(buffer[at + 1 : end])
        if (last := _last_start(body)) >= 0:
            return self._overrun(at, end, body, last)
        data = unescape(body)
        if len(data) > 1 and not checksum(data):
            self._emit(data[:-1])
            return end + 1 - at
        return self._damaged(at, end, body, data)

    def _sound(self, at: int, scan: int) -> int:
        """Take the packet at `at` if it is sound and its end is plain; else return 0.

        The short cut for a clean line. An end flag shows by the start flag behind it, or by
        being the last byte there is. A packet is sound when every flag in its data was
        escaped, which counting tells, and the checksum is right.
        """
        buffer = self._buffer
        # A stream's packets are mostly of one length, and escapes only add to it. Where that
        # is wrong, a flag will show up inside and the short cut is not taken.
        end = buffer.find(_END_START, max(scan, at + self._usual))
        if end < 0 and buffer[-1] == END:
            end = len(buffer) - 1
        if end <= at + 2 or buffer[end - 1] == ESC:
            return 0
        if buffer.find(_ESC_ESC, at + 1, end) >= 0:
            # An escaped 7F, which must not go with the escapes.
            body = bytes(buffer[at + 1 : end])
            data = np.frombuffer(unescape(body), np.uint8)
        else:
            coded = np.frombuffer(buffer, np.uint8, end - at - 1, at + 1)
            data = coded[coded != ESC]
            data.flags.writeable = False
        # START, END and ESC are neighbours: shifted down, they are the bytes below three.
        flags = np.count_nonzero((data - _FIRST_FLAG) < _N_FLAGS)
        if len(data) < 2 or flags != end - at - 1 - len(data) or checksum(data.data):
            return 0
        self._usual = len(data)
        self._emit(data.data[:-1])
        return end + 1 - at

    def _bare_checksum(self, at: int, flag: int) -> bool:
        """Take the packet at `at` if the byte at `flag` is its checksum, sent unescaped."""
        body = bytes(self._buffer[at + 1 : flag])
        data = unescape(body)
        if not data or _last_start(body) >= 0 or checksum(data) != self._buffer[flag]:
            return False
        self._emit(data)
        return True

    def _overrun(self, at: int, end: int, body: bytes, last: int) -> int:
        """Deal with a start flag inside a packet: go on there, or behind a bare checksum."""
        if body.endswith(_START) and self._bare_checksum(at, end - 1):
            return end + 1 - at
        if last == len(body) - 1:
            # It may be the bare checksum of the packet that begins one start flag earlier.
            before = _last_start(body[:-1])
            last = before if before >= 0 else last
        inner = self._raw_start(at, at + 1 + last)
        return self._drop(Fault.LOST_BYTES, inner - at if inner > 0 else last + 1)

    def _damaged(self, at: int, end: int, body: bytes, data: bytes) -> int:
        """Drop a packet with a wrong checksum, or the part before a packet hidden in it."""
        inner = self._raw_start(at, end)
        if inner > 0:
            return self._drop(Fault.CRC_ERROR, inner - at)
        hidden = _hidden_start(data) if self._hunting and len(data) > 2 else -1
        if hidden >= 0:
            flags = np.flatnonzero(np.frombuffer(body, np.uint8) == START)
            flag = int(flags[data.count(_START, 0, hidden)])
            return self._drop(Fault.CRC_ERROR, flag + 1)
        fault = Fault.CRC_ERROR if len(data) > 1 else Fault.INCOMPLETE_PACKET
        return self._drop(fault, end + 1 - at)

    def _raw_start(self, at: int, end: int) -> int:
        """Return where in a broken packet another one may begin whose end is no flag, or -1."""
        buffer = self._buffer
        found = -1
        for start, skip in ((LENGTH_START, 4), (_FAST_START, 2)):
            inner = buffer.find(start, at + 1, end)
            while inner > 0:
                n = int.from_bytes(buffer[inner + skip : inner + skip + 4], "little")
                escaped = start is _FAST_START and buffer[inner - 1] == ESC
                if 0 < n <= MAX_PACKET and not escaped:
                    found = inner if found < 0 else min(found, inner)
                    break
                inner = buffer.find(start, inner + 1, end)
        return found

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
        given_out, self._given_out = self._given_out, 0
        follows = bytes(buffer[at + size : at + size + len(LENGTH_START)])
        if not (follows.startswith(_START) or LENGTH_START.startswith(follows)):
            return self._drop(Fault.LOST_BYTES, 1)
        if not given_out:
            self._emit(bytes(buffer[at + LENGTH_HEADER : at + size]))
        if follows.startswith((_START, LENGTH_START)):
            return size
        self._given_out = size
        return 0

    def _fast(self, at: int, left: int) -> int:
        if left < _FAST_HEADER:
            return 0
        buffer = self._buffer
        n = int.from_bytes(buffer[at + 2 : at + 6], "little")
        size = _FAST_HEADER + n + 1
        if n == 0 or size > MAX_PACKET:
            return self._escaped(at, left)
        if left < size:
            return 0
        body = bytes(buffer[at + 1 : at + size])
        if checksum(body):
            return self._escaped(at, left)
        self._emit(body[5:-1])
        self._end_may_follow = True
        return size


def _is_escaped(buffer: bytes | bytearray, flag: int, first: int = 0) -> bool:
    """Say whether the byte at `flag` is preceded by an odd run of escapes, from `first` on."""
    run = flag
    while run > first and buffer[run - 1] == ESC:
        run -= 1
    return (flag - run) % 2 == 1


def _last_start(body: bytes) -> int:
    """Return the position of the last start flag in `body` that no escape guards, or -1."""
    at = body.rfind(_START)
    while at > 0 and _is_escaped(body, at):
        at = body.rfind(_START, 0, at)
    return at


def _hidden_start(data: bytes) -> int:
    """Return where in unescaped `data` a sound packet begins, or -1."""
    values = np.frombuffer(data, np.uint8)
    flags = np.flatnonzero(values[:-2] == START)
    until = np.bitwise_xor.accumulate(values)
    found = flags[until[flags] ^ until[-1] == START]
    return int(found[0]) if found.size else -1
