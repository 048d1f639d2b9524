import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from x2radar.commands.decode import describe, read_trace
from x2radar.wire import framing
from x2radar.wire import messages as msg
from x2radar.wire.codec import decode_any, encode
from x2radar.wire.framing import PacketDecoder
from x2radar.wire.wire_ids import Mode, PongCode, Profile, SystemCode

PING = framing.encode(encode(msg.Ping()))
PONG = framing.encode(encode(msg.Pong(PongCode.READY)))


def spaced(data, form="{:02x}", between=" "):
    return between.join(form.format(b) for b in data)


@pytest.mark.parametrize("form", ["0x{:02x}", "0x{:02X}", "0X{:02x}", "{:02x}", "{:02X}"])
@pytest.mark.parametrize("between", [" ", ", ", ",", "\t", "  "])
def test_forms_of_hex_text(form, between):
    assert read_trace(spaced(PING, form, between).encode()) == PING


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_a_trace_with_prose_labels_and_comments(newline):
    lines = [
        "A session with a module, 7d and all",
        "",
        "# sent first",
        f"Write: {spaced(PING, '0x{:02x}')}  // ping",
        f"12:30:01.5 Read: {spaced(PONG[:4], '0x{:02x}')}",
        spaced(PONG[4:]) + " # the rest",
        "// 7d 7d 7d 7d 7d",
        "The module said 0x7d 0x10 0x6d 0x7e and stopped.",
        "Bytes: 0x7d 0x10 0x6d",  # too short for a packet
        "7d 10 6d",
        "0x7d 0x1 0x2 0x3 0x4",
        "7d 10 6d 7e ...",
    ]
    assert read_trace(newline.join(lines).encode()) == PING + PONG


@given(st.binary(min_size=4, max_size=200), st.integers(4, 40))
def test_any_bytes_come_back_from_their_hex_text(data, width):
    rows = [data[k : k + width] for k in range(0, len(data) - len(data) % width, width)]
    text = "\n".join(f"Read: {spaced(row, '0x{:02x}')}" for row in rows)
    assert read_trace(text.encode()) == (b"".join(rows) or text.encode())


def test_a_long_line_is_read_in_time():
    row = b"0x7d " * 50_000
    assert len(read_trace(row)) == 50_000
    assert read_trace(row + b"x") == row + b"x"
    assert read_trace(b":" * 20_000) == b":" * 20_000


def described(*messages):
    items = list(describe(b"".join(framing.encode(encode(m)) for m in messages)))
    # What json would write is valid for everyone: no NaN, no Infinity.
    return json.loads(json.dumps(items, allow_nan=False))


def test_arrays_texts_numbers_and_what_is_not_known():
    data, raw, reply, floats, zone, mode, ready = described(
        msg.Data(0, 7, np.array([1, np.nan, -np.inf, 0.5], np.float32)),
        msg.Data(3, 8, np.array([1, 255], np.uint8)),
        msg.Reply(0x58, 1, "X2M200"),
        msg.Reply(0x11, 2, (1.5, float("nan"), float("inf"))),
        msg.SetDetectionZone(0.5, float("nan")),
        msg.SetMode(Mode.MANUAL),
        msg.SystemMessage(SystemCode.READY),
    )
    assert data.pop("values") == [1.0, None, None, 0.5]
    assert data == {"message": "Data", "content_id": 0, "info": 7}
    assert (mode, ready["code"]) == ({"message": "SetMode", "mode": 0x12}, 0x11)
    assert raw["values"] == [1, 255]
    assert reply["value"] == "X2M200"
    assert floats["value"] == [1.5, None, None]
    assert zone == {"message": "SetDetectionZone", "start_m": 0.5, "end_m": None}
    items = list(describe(framing.encode(b"\xee\x01\x02")))
    assert items == [{"message": "Unknown", "data": "ee 01 02"}]
    [status] = describe(framing.encode(bytes.fromhex("50 26 fe 75 23 01")))
    assert (status["name"], status["data"]) == ("RespirationStatus", "50 26 fe 75 23 01")


def test_what_is_no_sound_packet_is_reported_in_place():
    broken = bytearray(PING)
    broken[2] ^= 1
    senseless = framing.encode(b"\x90\x51\x01")
    items = list(describe(PONG + bytes(broken) + b"\x00\x01\x02" + PING + senseless + PONG[:-2]))
    assert [i.get("message") for i in items] == ["Pong", None, None, "Ping", None, None]
    assert items[1] == {"fault": "crc error", "n_bytes": len(PING)}
    assert items[2] == {"fault": "junk between packets", "n_bytes": 3}
    assert items[4]["n_bytes"] == 3
    assert "SetSysInt" in items[4]["fault"]
    assert items[5] == {"fault": "incomplete packet at the end", "n_bytes": len(PONG) - 2}


@given(st.binary(max_size=400))
def test_any_bytes_are_described_as_json(data):
    items = list(describe(data))
    json.dumps(items, allow_nan=False)
    assert sum(i["n_bytes"] for i in items if "fault" in i) <= len(data)


OWN = Path(__file__).parents[1] / "data" / "trace.txt"
REAL = Path(__file__).parents[3] / "shared" / "data" / "x2m200_bytetrace.txt"


def messages_of(path: Path) -> list[msg.Message]:
    """Decode a trace, which must be faultless."""
    packets = PacketDecoder().feed(read_trace(path.read_bytes()))
    out = [decode_any(packet.data) for packet in packets]
    assert {m.name for m in out if isinstance(m, msg.Unknown)} == {"RespirationStatus"}
    return out


def counters_of(messages: list[msg.Message]) -> list[int]:
    """Return the counters of the respiration statuses, which are known by name alone."""
    return [int.from_bytes(m.data[5:9], "little") for m in messages if isinstance(m, msg.Unknown)]


def test_own_trace() -> None:
    messages = messages_of(OWN)
    kinds = [type(m) for m in messages]
    assert len(messages) == 41
    begun = [msg.Reset, msg.Ack, msg.SystemMessage, msg.SystemMessage, msg.Ping, msg.Pong]
    asked = [msg.LoadProfile, msg.SetLed, msg.SetDetectionZone, msg.SetSensitivity, msg.SetOutput]
    assert kinds[:6] == begun
    assert [k for k in kinds[6:18] if k is not msg.Ack] == [*asked, msg.SetMode]
    assert counters_of(messages) == [1, 2, 3, 4, 401, 402, 981, 982, 983, 984, 125, 126, 127]
    last = msg.GetSystemInfo(3), msg.Reply(0x58, 3, "2.4.1")
    assert messages[-4:] == [msg.LoadProfile(0x12345678), msg.ErrorReply(0x20), *last]


@pytest.mark.skipif(not REAL.exists(), reason="the real module's trace is not part of the project")
def test_trace_of_a_real_module() -> None:
    messages = messages_of(REAL)
    assert len(messages) == 38
    assert messages.count(msg.LoadProfile(Profile.SLEEP)) == 2
    assert messages.count(msg.SetMode(Mode.RUN)) == 2
    assert messages.count(msg.Ack()) == 12
    assert counters_of(messages) == [*range(1, 8), *range(1, 8)]
