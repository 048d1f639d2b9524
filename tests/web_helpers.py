"""A daemon with a dashboard, records to feed one, and the way to ask it things."""

import contextlib
import http.client
import json
import socket
import subprocess
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import h5py
from websockets.sync.client import connect

from tests import processes, sink_helpers
from tests.waiting import free_port, wait_for

ULID = "01J0000000000000000000000A"
HEADERS = {"Content-Type": "application/json", "X-Radard": "1"}


def decision(seq=1, t_s=2.45, **changes):
    """A decision's record; by default the gate is closed."""
    own = {k: None for k in sink_helpers.decision() if k.endswith(("human", "pet", "other"))}
    own |= {"gate": "closed", "label": "none", "alarm": False, "range_m": None}
    own |= {"power_db": -33.7, "noise_floor_db": -33.9, "threshold_db": -27.8, "latency_ms": 3.0}
    return sink_helpers.decision(seq, **own | {"t_s": t_s} | changes)


def open_decision(seq=1, t_s=2.45, *, human, other=0.0, **changes):
    """A decision with the gate open and some p(human)."""
    pet = round(1 - human - other, 6)
    harmless = pet + other > 0.8
    chances = {"human": human, "pet": pet, "other": other}
    record = {"gate": "open", "power_db": -20.0, "range_m": 1.8, "alarm": not harmless}
    record |= {f"p_{k}": v for k, v in chances.items()}
    record |= {f"fused_p_{k}": v for k, v in chances.items()}
    record["label"] = "pet" if harmless else "human"
    return decision(seq, t_s, **record | changes)


def event(event_id=ULID, phase="new", kind="alarm", **changes):
    """A record of an event."""
    own = {"id": event_id, "time": "2026-11-21T06:00:02.000Z", "end_t_s": None, "peak": 0.9}
    own |= {"reason": "human at 1.8 m"}
    return sink_helpers.event(5, kind=kind, phase=phase) | own | changes


class Running:
    """`radard` in a process of its own, with a dashboard."""

    def __init__(self, folder, *arguments, port=None, environ=None):
        self.port = port or free_port()
        self.base = f"http://127.0.0.1:{self.port}"
        self.folder = Path(folder)
        dirs = dict.fromkeys(("STATE", "RUNTIME"), str(folder))
        own = {f"RADARD_SERVICE__{name}_DIR": at for name, at in dirs.items()} | (environ or {})
        self._log = (self.folder / "log").open("w+")
        said = {"stdout": subprocess.DEVNULL, "stderr": self._log}
        argv = ("-m", "radard", *arguments, "-o", self.base)
        self.process = processes.started(*argv, env=processes.environ(**own), **said)

    @property
    def log(self):
        """What it has said on stderr."""
        self._log.flush()
        return (self.folder / "log").read_text()

    def get(self, path, headers=None):
        """Return status code and body, read as JSON where it is JSON."""
        return ask(self.base + path, headers=headers)

    def post(self, path, body, headers=None):
        """POST as the page does; return status code and body."""
        sent = HEADERS if headers is None else headers
        return ask(self.base + path, data=json.dumps(body).encode(), headers=sent)

    def status(self):
        return self.get("/api/v1/status")[1]

    def ended_alarm(self, key):
        """Arm, and acknowledge until an alarm that has this is over; return its id."""
        self.post("/api/v1/command", {"command": "arm"})

        def found():
            self.post("/api/v1/command", {"command": "ack"})
            events = self.get("/api/v1/events?kind=alarm")[1]["events"]
            return next((e["id"] for e in events if e[key] and e["phase"] == "end"), None)

        return self.wait(found)

    def wait(self, what, timeout_s=180.0):
        """Return what `what()` returns once that is true; a refused connection is false."""
        return wait(what, timeout_s, lambda: self.log)

    def wait_online(self):
        """Wait until it decides; one that never does is ended."""
        try:
            self.wait(lambda: self.process.poll() is not None or self.get("/healthz")[0] == 200)
            assert self.process.returncode is None, self.log
        except BaseException:
            self.end()
            raise
        return self

    def end(self):
        """Stop it; return its exit code."""
        if self.process.poll() is None:
            self.process.terminate()
        code = self.process.wait(60)
        self._log.close()
        return code


def wait(what, timeout_s=180.0, explain=lambda: ""):
    """Return what `what()` returns once that is true; a refused connection is false."""

    def found():
        with contextlib.suppress(OSError):
            return what()

    return wait_for(found, timeout_s, explain)


def is_finished(clip):
    """Whether a clip has been closed, with its event; OSError while it is being written."""
    # Without a lock: the daemon's own writing must not fail on it.
    with h5py.File(clip, "r", locking=False) as file:
        return "event" in file.attrs


def ask(url, *, data=None, headers=None):
    """Return status code and body of a request."""
    parts = urlsplit(url)
    path = f"{parts.path}?{parts.query}" if parts.query else parts.path
    method = "GET" if data is None else "POST"
    answer = Client(parts.port).request(method, path, headers=headers, content=data)
    try:
        return answer.status_code, answer.json()
    except ValueError:
        return answer.status_code, answer.content


@dataclass
class Answer:
    """What came back."""

    status_code: int
    headers: dict
    content: bytes

    @property
    def text(self):
        return self.content.decode()

    def json(self):
        return json.loads(self.content)


class Client:
    """A browser without a page: requests, cookies, sockets; `host` is what it takes us for."""

    def __init__(self, port, host=None):
        self.port = port
        self.host = host or f"127.0.0.1:{port}"
        self.cookies = {}

    def tell(self, record):
        """Let the dashboard hear a record, as a run would: events through the log."""
        if record["type"] == "event":
            self.log.append(record)
        self.sink.write(record)

    def get(self, path, headers=None):
        return self.request("GET", path, headers=headers)

    def post(self, path, content=b"", headers=None):
        return self.request("POST", path, headers=headers, content=content)

    def request(self, method, path, *, headers=None, content=None):
        sent = {"Host": self.host, **self._cookie(), **(headers or {})}
        answer = self.send(method, path, sent, content)
        if "set-cookie" in answer.headers:
            name, _, value = answer.headers["set-cookie"].partition(";")[0].partition("=")
            self.cookies[name] = value.strip('"')
        return answer

    def send(self, method, path, sent, content):
        """Send a request over a connection of its own; return the answer."""
        line = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        is_chunked = content is not None and not isinstance(content, bytes)
        if is_chunked:
            sent["Transfer-Encoding"] = "chunked"
        try:
            line.request(method, path, content, sent, encode_chunked=is_chunked)
            answer = line.getresponse()
            told = {name.lower(): value for name, value in answer.getheaders()}
            return Answer(answer.status, told, answer.read())
        finally:
            line.close()

    def socket(self, *, origin=None, host=None):
        """Return an open WebSocket."""
        line = socket.create_connection(("127.0.0.1", self.port), timeout=60)
        try:
            own = {"origin": origin, "additional_headers": self._cookie(), "proxy": None}
            return connect(f"ws://{host or self.host}/ws", sock=line, close_timeout=0.5, **own)
        except BaseException:
            line.close()
            raise

    def _cookie(self):
        text = "; ".join(f"{k}={v}" for k, v in self.cookies.items())
        return {"Cookie": text} if text else {}
