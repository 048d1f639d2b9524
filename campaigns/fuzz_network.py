"""What strangers on a network can send: requests, messages of pages, and what a broker hands on.

The dashboard of `http` and `websocket` listens in this process, without the limits on how often
somebody may ask, so that every input gets as far as it can. An answer of 5xx but 503 (there is no
run) and 507 (the disk), or anything that the server logs with a traceback, is unhandled.
"""

import atexit
import contextlib
import json
import logging
import socket
import struct
import tempfile
from functools import lru_cache
from pathlib import Path
from unittest.mock import patch

from radard.commands.fleet import Fleet, table
from radard.config.sink_table import MqttSection
from radard.errors import ConfigError
from radard.outputs.mqtt.sink import CommandReader
from radard.outputs.mqtt.topics import MqttTopics
from tests import sink_helpers
from tests.dashboard_helpers import maker
from tests.web_helpers import decision, event

BORDER = b"\n--8<--\n"
"""Between the parts of an input."""
_RIGHT = (503, 507)
_ANSWER_S = 0.3
"""An answer takes a few milliseconds, also on a busy machine."""
_HELLO = sink_helpers.hello(
    module={"name": "X2M200", "firmware": "1.2"}, range_offset_m=0.6, bin_length_m=0.03
)
_ID = "01J0000000000000000000000A"


class Unhandled(Exception):
    """The server has failed at an input."""


_logged: list[logging.LogRecord] = []


@lru_cache(maxsize=1)
def _dashboard() -> int:
    """Return the port of a dashboard that has heard of a decision and an event."""
    watch = logging.Handler()
    watch.emit = _logged.append  # type: ignore[method-assign]
    for name in ("", "radard", "uvicorn", "uvicorn.error", "asyncio", "websockets"):
        logging.getLogger(name).addHandler(watch)
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    made = maker(Path(folder.name))
    client = next(made)(served=True)
    atexit.register(next, made, None)
    for record in (_HELLO, decision(), event(_ID)):
        client.tell(record)
    return client.port


def _send(data: bytes) -> bytes:
    """Send the dashboard bytes and no more; return what comes back."""
    address = ("127.0.0.1", _dashboard())
    _logged.clear()
    answer = b""
    line = socket.create_connection(address, timeout=_ANSWER_S)
    # Else all but the first inputs would be turned away.
    unlimited = patch("radard.web.auth.RateLimit.take", lambda _limit: True)
    with line, unlimited, contextlib.suppress(ConnectionError):
        line.sendall(data)
        # Half a request gets no answer, and one whose sender has left may get none.
        with contextlib.suppress(TimeoutError):
            answer = line.recv(65536)
        line.shutdown(socket.SHUT_WR)
        line.settimeout(20)
        while part := line.recv(65536):
            answer = (answer + part)[:1_000_000]
    for record in _logged:
        if record.exc_info and record.exc_info[0] is not None:
            raise Unhandled(repr(record.exc_info[1]))
    return answer


def _http(_folder: Path, data: bytes) -> None:
    """Send a request; its head says @LENGTH for the length of the body behind the border."""
    head, border, body = data.partition(BORDER)
    length = str(len(body)).encode()
    raw = head.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n").replace(b"@LENGTH", length)
    answer = _send(raw + (b"\r\n\r\n" + body if border else b""))
    for line in answer.split(b"\r\n"):
        if line.startswith(b"HTTP/1.1 5") and int(line[9:12]) not in _RIGHT:
            raise Unhandled(line.decode(errors="replace"))


def _http_seeds(_folder: Path) -> list[bytes]:
    head = "{} {} HTTP/1.1\nHost: 127.0.0.1\nConnection: close"
    pages = (
        *("/", "/healthz", "/readyz", "/metrics", "/static/app.js", "/api/v1/status"),
        *("/api/v1/decisions?since=1&limit=5", "/api/v1/decisions/1", "/api/v1/config"),
        *("/api/v1/events?since=24h&kind=alarm&limit=3", f"/api/v1/events/{_ID}/clip"),
        *(f"/api/v1/events/{_ID}/pictures", f"/api/v1/events/{_ID}/thumbnail"),
        *("/api/v1/events/export?format=csv", "/api/v1/sensitivities", "/api/v1/calibration"),
    )
    out = [f"{head.format('GET', page)}\n\n".encode() for page in pages]
    json_head = "\nContent-Type: application/json\nX-Radard: 1\nContent-Length: @LENGTH"
    posts = (
        ("/api/v1/command", {"command": "disarm"}),
        ("/api/v1/labels", {"event": _ID, "label": "human"}),
        ("/api/v1/zones", {"include": [[0.5, 2.0]], "exclude": []}),
        ("/api/v1/zones", {"forget": True}),
        ("/api/v1/settings", {"alarm": {"sensitivity": "high", "entry_delay_s": 30}}),
        ("/api/v1/test-alarm", {}),
        ("/api/v1/playback", {"action": "seek", "value": 3.5}),
        ("/api/v1/login", {"token": "x" * 40}),
        ("/api/v1/logout", {}),
    )
    for path, body in posts:
        first = head.format("POST", path) + json_head
        out.append(first.encode() + BORDER + json.dumps(body).encode())
    return out


_UPGRADE = (
    b"GET /ws HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)


def _websocket(_folder: Path, data: bytes) -> None:
    """Open a page's WebSocket and send frames: as they are, or texts behind borders as frames."""
    if data[:1] == b"{":
        data = b"".join(_frame(1, text) for text in data.split(BORDER))
    _send(_UPGRADE + data)


def _frame(opcode: int, payload: bytes) -> bytes:
    """Return a frame of a client (RFC 6455, section 5.2), masked with zeros."""
    n = len(payload)
    size = bytes([0x80 | n]) if n < 126 else b"\xfe" + struct.pack(">H", n & 0xFFFF)
    return bytes([0x80 | opcode]) + size + bytes(4) + payload


def _websocket_seeds(_folder: Path) -> list[bytes]:
    text = b'{"pictures": true}' + BORDER + b'{"drawn": 3}' + BORDER + b'{"pictures": false}'
    frames = [_frame(k, b'{"drawn": 1}') for k in (0, 1, 2, 8, 9, 10)]
    return [text, *frames, b"".join(frames)]


@lru_cache(maxsize=1)
def _reader() -> CommandReader:
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    (code := Path(folder.name) / "code").write_text("1234\n")
    return CommandReader(MqttSection(code_file=code), now_s=lambda: 0.0)


def _mqtt(_folder: Path, data: bytes) -> None:
    """Read a message on a command's topic: the topic, a border, and the payload."""
    topic, _, payload = data.partition(BORDER)
    with contextlib.suppress(ValueError, ConfigError):
        # A topic that is no UTF-8 is refused by brokers and the library.
        _reader().read(topic.decode(errors="replace"), payload, is_retained=False)


def _mqtt_seeds(_folder: Path) -> list[bytes]:
    rows = (
        *((name, b"") for name in ("arm", "arm-home", "ack", "calibrate")),
        *(("disarm", b"1234"), ("sensitivity", b"high"), ("panel", b"ARM_AWAY")),
        ("panel", b'{"action": "DISARM", "code": "1234"}'),
    )
    return [f"radard/hall/command/{name}".encode() + BORDER + body for name, body in rows]


def _announce(_folder: Path, data: bytes) -> None:
    """Make Home Assistant's discovery of what a run, and its module, say of themselves."""
    try:
        hello = json.loads(data)
        # The driver gives texts and numbers under these names, whatever the module has sent.
        if not all(isinstance(hello.get(key), type(value)) for key, value in _HELLO.items()):
            return
    except (ValueError, RecursionError, AttributeError):
        return
    topics = MqttTopics("hall", "radard", MqttSection(), takes_commands=True)
    topics.on_record({**hello, "type": "hello"}, 0.0)
    for each in topics.discovery():
        each.topic.encode()
        if each.payload:
            json.loads(each.payload)


def _announce_seeds(_folder: Path) -> list[bytes]:
    return [json.dumps(_HELLO).encode()]


def _fleet(_folder: Path, data: bytes) -> None:
    """Show what messages of a broker say of radars: topic, border, payload, border, topic, ..."""
    seen = Fleet("radard")
    parts = data.split(BORDER)
    for topic, payload in zip(parts[::2], parts[1::2], strict=False):
        seen.take(topic.decode(errors="replace"), payload, 1.0)
    rows = seen.rows(2.0)
    for line in (*table(rows), *(json.dumps(row) for row in rows)):
        if not line.isprintable():
            # A stranger's text must not steer a terminal.
            raise Unhandled(repr(line[:80]))


def _fleet_seeds(_folder: Path) -> list[bytes]:
    state = {"armed": True, "alarm": False, "gate": "open", "label": "pet"}
    health = {"state": "online", "reason": "", "fault": None, "tamper": "covered: it is dark"}
    rows = {"availability": "online", "state": json.dumps(state), "health": json.dumps(health)}
    border = BORDER.decode()
    parts = [f"radard/hall/{kind}{border}{payload}" for kind, payload in rows.items()]
    return [border.join(parts).encode()]


ROWS = {
    "http": (_http, _http_seeds),
    "websocket": (_websocket, _websocket_seeds),
    "mqtt": (_mqtt, _mqtt_seeds),
    "discovery": (_announce, _announce_seeds),
    "fleet": (_fleet, _fleet_seeds),
}
"""What runs an input, and what makes good ones."""
