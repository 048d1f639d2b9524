"""Whole traces of the wire, both directions: one of our own, and one of a real module."""

import re
from pathlib import Path

import numpy as np
import pytest

from x2radar.wire.codec import decode_any, decode_command, decode_response
from x2radar.wire.framing import Packet, PacketDecoder
from x2radar.wire.messages import (
    Ack,
    BasebandIq,
    Data,
    ErrorReply,
    GetSystemInfo,
    LoadProfile,
    Message,
    Ping,
    Pong,
    Reply,
    Reset,
    SetDetectionZone,
    SetLed,
    SetMode,
    SetOutput,
    SetSensitivity,
    SystemMessage,
    Unknown,
)
from x2radar.wire.wire_ids import Mode, Profile

OWN = Path(__file__).parents[1] / "data" / "trace.txt"
REAL = Path(__file__).parents[3] / "shared" / "data" / "x2m200_bytetrace.txt"


def lines_of(path: Path) -> list[tuple[str, bytes]]:
    """Return direction and bytes of every line that shows a packet."""
    out = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if match := re.match(r"(?:DEBUG )?(Read|Write):(.*?)(//|$)", line):
            pairs = re.findall(r"0x([0-9a-f]{2})", match[2])
            out.append((match[1], bytes.fromhex("".join(pairs))))
    return out


def reads_right(line: bytes) -> bool:
    """Check flags, escapes and checksum of one packet by hand."""
    crc, body = 0x7D, iter(line[1:-1])
    for byte in body:
        crc ^= next(body) if byte == 0x7F else byte
    return line[0] == 0x7D and line[-1] == 0x7E and crc == 0


def messages_of(path: Path) -> list[Message]:
    """Decode a trace line by line and as one stream; both must agree and be faultless."""
    lines = lines_of(path)
    assert all(reads_right(line) for _, line in lines)
    items = PacketDecoder().feed(b"".join(line for _, line in lines))
    assert len(items) == len(lines)
    out = []
    for (direction, _), item in zip(lines, items, strict=True):
        assert isinstance(item, Packet)
        message = (decode_command if direction == "Write" else decode_response)(item.data)
        assert not isinstance(message, Unknown) or message.name == "RespirationStatus"
        assert type(decode_any(item.data)) is type(message)
        out.append(message)
    return out


def counters_of(messages: list[Message]) -> list[int]:
    """Return the counters of the respiration statuses, which are known by name alone."""
    return [int.from_bytes(m.data[5:9], "little") for m in messages if isinstance(m, Unknown)]


def test_own_trace() -> None:
    messages = messages_of(OWN)
    kinds = [type(m) for m in messages]
    assert len(messages) == 41
    assert kinds[:6] == [Reset, Ack, SystemMessage, SystemMessage, Ping, Pong]
    assert [k for k in kinds[6:18] if k is not Ack] == [
        LoadProfile,
        SetLed,
        SetDetectionZone,
        SetSensitivity,
        SetOutput,
        SetMode,
    ]
    assert counters_of(messages) == [1, 2, 3, 4, 401, 402, 981, 982, 983, 984, 125, 126, 127]
    assert messages[-4:] == [
        LoadProfile(0x12345678),
        ErrorReply(0x20),
        GetSystemInfo(3),
        Reply(0x58, 3, "2.4.1"),
    ]


def test_echoes_of_the_own_trace() -> None:
    messages = messages_of(OWN)
    (iq,) = [m for m in messages if isinstance(m, BasebandIq)]
    assert (iq.counter, iq.i.size, iq.q.size) == (985, 12, 12)
    assert iq.sample_rate_hz == pytest.approx(39e9)
    np.testing.assert_allclose(iq.i + 1j * iq.q, 0.5 * np.exp(1j * np.arange(12) / 3), atol=1e-6)
    (raw,) = [m for m in messages if isinstance(m, Data)]
    assert raw.info == 1
    np.testing.assert_allclose(raw.values, 50 + np.sin(np.arange(8)), rtol=1e-6)


@pytest.mark.skipif(not REAL.exists(), reason="the real module's trace is not part of the project")
def test_trace_of_a_real_module() -> None:
    messages = messages_of(REAL)
    assert len(messages) == 38
    assert messages.count(LoadProfile(Profile.SLEEP)) == 2
    assert messages.count(SetMode(Mode.RUN)) == 2
    assert messages.count(Ack()) == 12
    assert counters_of(messages) == [*range(1, 8), *range(1, 8)]
