"""Far ends that are real: brokers, HTTP servers, sockets; and records to send there."""

import contextlib
import http.server
import json
import shutil
import socket
import ssl
import subprocess
import sys
import threading
import time
from pathlib import Path

import paho.mqtt.client as paho
import pytest
from paho.mqtt.enums import CallbackAPIVersion

from radard.config.config import Config
from radard.config.sink_table import LogSection, SinkOptions
from radard.health.health import Health
from radard.log import EventLog
from radard.outputs.base import SinkContext
from radard.outputs.registry import make_output, start_sink
from tests import alarm_helpers
from tests.waiting import free_port

MQTT_MARKS = [
    pytest.mark.integration,
    # paho leaves the socket of a connection that ended, or failed, to the collector.
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
QUICK = LogSection(first_retry_s=0.02, longest_retry_s=0.05, attempts=3)
USER, PASSWORD = "hall", "correct horse"


def ulid(n: int) -> str:
    """A valid id that holds a number."""
    return f"{n:026d}"


def event(n=1, *, kind="alarm", phase="new", t_s: float | None = None) -> dict:
    """An event record."""
    record = {"type": "event", "id": ulid(n), "phase": phase, "kind": kind}
    record |= {"t_s": float(n) if t_s is None else t_s, "start_t_s": float(n)}
    record |= {"time": f"2026-11-21T06:{n // 60 % 60:02d}:{n % 60:02d}.000Z", "clip": None}
    end_t_s = None if phase != "end" else float(n)
    return record | {"end_t_s": end_t_s, "peak": 0.97, "reason": f"human at {n:.1f} m"}


def decision(seq: int = 1, **changes) -> dict:
    """A decision record."""
    record = {"type": "decision", "seq": seq, "t_s": 1.45 + seq, "gate": "open"}
    record |= {"time": "2026-11-21T06:00:00.000Z", "latency_ms": 3.1, "frames": 147, "dropped": 0}
    record |= {"power_db": -41.2, "noise_floor_db": -60.1, "threshold_db": -47.0}
    record |= {"p_human": 0.93, "p_pet": 0.07, "p_other": 0.0}
    record |= {"fused_p_human": 0.95, "fused_p_pet": 0.05, "fused_p_other": 0.0}
    return record | {"label": "human", "alarm": True, "range_m": 2.1, "tracks": []} | changes


def hello(**changes) -> dict:
    """The first record."""
    record = {"type": "hello", "schema": 1, "version": "0.1.0", "sensor": "hall", "device": "X2"}
    record |= {"model": "thesis", "frame_rate_hz": 60.0, "n_range": 256, "port": "sim:demo"}
    return record | changes


def status(state: str, reason: str = "") -> dict:
    """A status record."""
    return {"type": "status", "state": state, "reason": reason}


class FakeHost:
    """A `radard.outputs.base.Host` that notes what is asked of it."""

    def __init__(self, sensor="radar", *, config=None, state=None, sinks=()):
        self.sensor, self.health = sensor, Health()
        self.asked, self.n_reloads = [], 0
        self.held = Config() if config is None else config
        self.state, self.player, self.the_ring, self.all_sinks = state, None, None, sinks
        self.command = self.asked.append
        self.config = lambda: self.held
        self.panel = lambda: self.state
        self.ring = lambda: self.the_ring
        self.playback = lambda: self.player
        self.sinks = lambda: self.all_sinks
        self.driver, self.test_alarm, self.mark = dict, tuple, str

    def reload(self):
        self.n_reloads += 1


def well_host() -> FakeHost:
    """A sensor `hall` that decides, and stays online."""
    host = FakeHost("hall")
    host.health = Health(stale_s=1e6)
    host.health.on_decision(alarm_helpers.decision(1.0, t_mono_s=time.monotonic()))
    return host


class Alone:
    """A sink and the log that it belongs to, as in a daemon: an event is in the log first."""

    def __init__(self, sink, log):
        self.sink, self.log = sink, log

    def __getattr__(self, name):
        return getattr(self.sink, name)

    def write(self, record):
        if record["type"] == "event":
            self.log.append(record)
        self.sink.write(record)

    def close(self, timeout_s=None):
        self.sink.close(timeout_s)
        self.log.close()


def open_sink(url, options=None, *, state_dir=None, **context):
    """Open one output with a log of its own, which goes on in `state_dir`."""
    log = EventLog(state_dir / "log.db" if state_dir is not None else None)
    given = {"sensor": "hall", "log": log, **context}
    context = SinkContext(**{**given, "host": given.get("host") or well_host()})
    sink = make_output(url, options or SinkOptions(), context)
    start_sink(sink)
    return Alone(sink, log)


class MqttBroker:
    """amqtt in a process; on one port, with stops; `plugins` are more of its plug-ins."""

    def __init__(self, folder: Path, *, cert=None, auth=False, plugins=()):
        self.port = free_port()
        self._folder, self._cert, self._auth, self._plugins = folder, cert, auth, dict(plugins)
        self.start()

    def stop(self):
        """Kill it: a signal that comes before the broker's loop has begun is forgotten by it."""
        with self.process:
            self.process.kill()

    def start(self):
        listener = {"type": "tcp", "bind": f"127.0.0.1:{self.port}"}
        if self._cert:
            cert, key = map(str, self._cert)
            listener |= {"ssl": True, "certfile": cert, "keyfile": key}
        kinds = "amqtt.plugins.authentication."
        plugins = {f"{kinds}AnonymousAuthPlugin": {"allow_anonymous": True}}
        if self._auth:
            from pwdlib.hashers.argon2 import Argon2Hasher

            words = self._folder / "passwords"
            words.write_text(f"{USER}:{Argon2Hasher().hash(PASSWORD)}\n")
            plugins = {f"{kinds}FileAuthPlugin": {"password_file": str(words)}}
        plugins |= self._plugins
        config = {"listeners": {"default": listener}, "plugins": plugins}
        command = [sys.executable, "-m", "tests.mqtt_broker", json.dumps(config)]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        self.process = subprocess.Popen(command, cwd=Path(__file__).parents[1], **pipes)
        assert self.process.stdout.readline() == b"serves\n"


class Listener:
    """A subscriber that keeps what it gets, across outages of the broker."""

    def __init__(self, port: int, *topics: str, tls: ssl.SSLContext | None = None, user=None):
        self.messages: list[tuple[str, bytes, bool]] = []
        self._topics = [(topic, 1) for topic in topics or ("#",)]
        self._ready = threading.Event()
        self.client = paho.Client(CallbackAPIVersion.VERSION2, client_id=f"listener{id(self)}")
        if tls:
            self.client.tls_set_context(tls)
        if user:
            self.client.username_pw_set(*user)
        self.client.reconnect_delay_set(1, 1)
        self.client.on_connect = lambda *_: self.client.subscribe(self._topics)
        self.client.on_subscribe = lambda *_: self._ready.set()
        self.client.on_message = lambda _c, _d, m: self.messages.append(
            (m.topic, bytes(m.payload), m.retain)
        )
        self.client.connect("127.0.0.1", port)
        self.client.loop_start()
        assert self._ready.wait(60)

    def on(self, topic: str) -> list[bytes]:
        """Payloads on a topic."""
        return [payload for name, payload, _ in list(self.messages) if name == topic]

    def say(self, topic: str, payload: str = "", **how):
        """Publish, and wait for it."""
        self.client.publish(topic, payload, qos=1, **how).wait_for_publish(60)

    def close(self):
        self.client.disconnect()
        self.client.loop_stop()


def read_packet(file):
    """The head of an MQTT packet (3.1.1, 2.2) with its length, and its body."""
    head, size, shift = file.read(1), 0, 0
    while not shift or head[-1] & 0x80:
        head += file.read(1)
        size, shift = size | (head[-1] & 0x7F) << shift, shift + 7
    return head, file.read(size)


class Relay:
    """A port at which nobody answers, until it is opened to another on this machine.

    With `max_bytes` it hangs up at a larger MQTT packet of a client, as brokers do.
    """

    def __init__(self, far_port: int, max_bytes: int | None = None):
        self.port = free_port()
        self._max_bytes = max_bytes
        self._far_port = far_port
        self._server: socket.socket | None = None
        self._ends: list[socket.socket] = []

    def open(self):
        """Answer, and hand on what comes, both ways."""
        self._server = socket.create_server(("127.0.0.1", self.port))
        threading.Thread(target=self._accept, args=(self._server,), daemon=True).start()

    def _accept(self, server):
        with contextlib.suppress(OSError):  # closed
            while True:
                near, _ = server.accept()
                far = socket.create_connection(("127.0.0.1", self._far_port))
                self._ends += [near, far]
                there = self._pump if self._max_bytes is None else self._pump_packets
                for pump, ends in ((there, (near, far)), (self._pump, (far, near))):
                    threading.Thread(target=pump, args=ends, daemon=True).start()

    def _pump_packets(self, source, target):
        """Hand on whole packets while they are small enough."""
        with contextlib.suppress(OSError, IndexError), source.makefile("rb") as packets:
            while True:
                head, body = read_packet(packets)
                if len(body) > self._max_bytes:
                    break
                target.sendall(head + body)
        for end in (source, target):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    @staticmethod
    def _pump(source, target):
        with contextlib.suppress(OSError):
            while data := source.recv(4096):
                target.sendall(data)
        with contextlib.suppress(OSError):
            target.shutdown(socket.SHUT_RDWR)

    def close(self):
        """Hang up."""
        for end in (self._server, *self._ends):
            if end is not None:
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)
                end.close()


class WebServer:
    """An HTTP server that keeps what is posted and answers with `code`."""

    def __init__(self, port: int = 0, *, cert: tuple[Path, Path] | None = None):
        self.code = 200
        self.headers: dict[str, str] = {}
        self.posts: list[tuple[str, dict, bytes]] = []
        far = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                body = self.rfile.read(int(self.headers["Content-Length"]))
                headers = {name.lower(): value for name, value in self.headers.items()}
                far.posts.append((self.path, headers, body))
                self.send_response(far.code)
                for name, value in far.headers.items():
                    self.send_header(name, value)
                self.send_header("Content-Length", "0")
                self.end_headers()

            def log_message(self, *_):
                pass

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._server.handle_error = lambda *_: None
        if cert:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(*cert)
            self._server.socket = context.wrap_socket(self._server.socket, server_side=True)
        self.port = self._server.server_address[1]
        serve = lambda: self._server.serve_forever(0.01)  # noqa: E731
        self._thread = threading.Thread(target=serve, daemon=True)
        self._thread.start()

    def ids(self):
        return [json.loads(body)["id"] for _, _, body in list(self.posts)]

    def close(self):
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


def make_cert(folder: Path) -> tuple[Path, Path]:
    """A self-made certificate of localhost and its key; skips where openssl is missing."""
    if not shutil.which("openssl"):
        pytest.skip("no openssl to make a certificate with")
    cert, key = folder / "cert.pem", folder / "key.pem"
    command = "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2"
    command += " -subj /CN=localhost -addext subjectAltName=DNS:localhost,IP:127.0.0.1"
    files = ["-keyout", str(key), "-out", str(cert)]
    subprocess.run([*command.split(), *files], check=True, capture_output=True)
    key.chmod(0o644)
    return cert, key
