"""What holds for every sink: writes return, ends come in time, trouble is told and passes."""

import contextlib
import json
import os
import socket
import sqlite3
import sys

import pytest

from radard.config.sink_table import SinkOptions
from radard.outputs import jsonl, store
from tests import sink_helpers as far
from tests.device_helpers import in_thread
from tests.sink_helpers import QUICK, Listener, WebServer, decision, event, hello, ulid
from tests.waiting import free_port, wait_for
from x2radar.backoff import Backoff

pytestmark = pytest.mark.integration

OPTIONS = SinkOptions(log=QUICK, mqtt={"keepalive_s": 1, "discovery": "off"})


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    """Let files be tried again as soon as what lies behind a network."""
    for module in (jsonl, store):
        quick = lambda _first_s, _longest_s, name: Backoff(0.02, 0.05, name)  # noqa: E731
        monkeypatch.setattr(module, "Backoff", quick)


class FarEnd:
    """What a sink writes to at `url`: broken when a test begins, `damage`d if it has that."""

    def close(self):
        pass


class File(FarEnd):
    def __init__(self, folder):
        self._file = folder / "logs" / "out.jsonl"
        self._file.parent.mkdir()
        self.url = f"json:{self._file}"

    def damage(self):
        """Take the folder away while the file is open."""
        self._file.parent.rename(self._file.parent.with_name("gone"))
        self._file.parent.write_text("in the way")

    def mend(self):
        self._file.parent.unlink()
        self._file.parent.mkdir()

    def events(self):
        if not self._file.exists():
            return []
        # The last line may be being written.
        whole = self._file.read_text().rpartition("\n")[0]
        return [r["id"] for r in map(json.loads, whole.splitlines()) if r["type"] == "event"]


class Store(FarEnd):
    def __init__(self, folder):
        self._file = folder / "radard.db"
        self.url = f"store:{self._file}"

    def damage(self):
        """Hold the lock, as a backup would."""
        self._other = sqlite3.connect(self._file, isolation_level=None)
        self._other.execute("BEGIN IMMEDIATE")

    def mend(self):
        self._other.execute("ROLLBACK")

    def events(self):
        return [id_ for (id_,) in self._other.execute("SELECT id FROM events ORDER BY start_s")]

    def close(self):
        self._other.close()


class Mqtt(FarEnd):
    def __init__(self, folder):
        # The listener is there before the sink is: it must not be late for what is published.
        self._broker = far.MqttBroker(folder)
        self._listener = Listener(self._broker.port, "radard/hall/event")
        self._relay = far.Relay(self._broker.port)
        self.url = f"mqtt://127.0.0.1:{self._relay.port}"

    def mend(self):
        self._relay.open()

    def events(self):
        return [json.loads(body)["id"] for body in self._listener.on("radard/hall/event")]

    def close(self):
        self._relay.close()
        self._listener.close()
        self._broker.stop()


class Hook(FarEnd):
    def __init__(self, _folder):
        self._port = free_port()
        self._server = None
        self.url = f"webhook:http://127.0.0.1:{self._port}/hook"

    def mend(self):
        self._server = WebServer(self._port)

    def events(self):
        return self._server.ids()

    def close(self):
        if self._server:
            self._server.close()


class Message(Hook):
    def __init__(self, folder):
        super().__init__(folder)
        self.url = f"apprise:json://127.0.0.1:{self._port}/hook"

    def events(self):
        texts = [json.loads(body)["message"] for _, _, body in list(self._server.posts)]
        return [ulid(round(float(text.split(" ")[2]))) for text in texts]


class Program(FarEnd):
    def __init__(self, folder):
        self._flag, self._out = folder / "works", folder / "ids"
        self._out.touch()
        script = folder / "hook"
        said = f'echo "$RADAR_EVENT_ID" >> {self._out}'
        script.write_text(f"#!/bin/sh\n[ -e {self._flag} ] || exit 1\n{said}\n")
        script.chmod(0o755)
        self.url = f"exec:{script}"

    def mend(self):
        self._flag.touch()

    def events(self):
        return self._out.read_text().split()


class Syslog(FarEnd):
    def __init__(self, folder):
        self._path = folder / "log"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._ids = []
        self.url = f"syslog:{self._path}"

    def mend(self):
        self._socket.bind(str(self._path))

    def events(self):
        try:
            while True:
                text = self._socket.recv(4096).decode()
                self._ids += [text.rpartition("id=")[2].rstrip("\0")] if "id=" in text else []
        except BlockingIOError:
            return self._ids

    def close(self):
        self._socket.close()


@pytest.fixture(params=[File, Store, Mqtt, Hook, Message, Program, Syslog])
def far_end(request, tmp_path):
    end = request.param(tmp_path)
    yield end
    end.close()


def opened(far_end, tmp_path):
    """The sink of a broken far end that has noticed it."""
    sink = far.open_sink(far_end.url, OPTIONS, state_dir=tmp_path / "state")
    sink.write(hello())
    if hasattr(far_end, "damage"):
        wait_for(lambda: sink.state.n_waiting == 0)
        far_end.damage()
    sink.write(event(1))
    assert wait_for(lambda: sink.state.status == "retrying" and sink.state).reason
    return sink


def in_time(function, *arguments):
    thread = in_thread(function, *arguments)
    thread.join(60)
    assert not thread.is_alive()


def test_a_broken_far_end_delays_nothing_and_gets_all_events_once_mended(far_end, tmp_path):
    sink = opened(far_end, tmp_path)

    def flood():
        for k in range(2, 22):
            for seq in range(150):
                sink.write(decision(seq))
            sink.write(event(k))

    in_time(flood)
    # An alarm is never given up.
    wait_for(lambda: sink.state.n_failures > 2 * QUICK.attempts)
    far_end.mend()
    wait_for(lambda: len(far_end.events()) >= 21)
    assert far_end.events() == [ulid(k) for k in range(1, 22)]
    wait_for(lambda: sink.state.is_ok)
    assert sink.state.reason == ""
    assert sink.state.n_failures > 0
    in_time(sink.close)


def test_a_broken_far_end_does_not_hold_up_the_end(far_end, tmp_path):
    sink = opened(far_end, tmp_path)
    in_time(sink.close, 0.3)
    sink.write(event(2))
    # What is not delivered is in the log, for the next start.
    assert sink.state.n_dropped + sink.state.n_waiting >= 1
    in_time(sink.close, 0.3)


@pytest.mark.parametrize("scheme", ["mqtt", "webhook:http"])
def test_a_far_end_that_is_there_but_silent(scheme, tmp_path):
    options = SinkOptions(log=QUICK, mqtt={"keepalive_s": 1}, webhook={"timeout_s": 0.1})
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"{scheme}://127.0.0.1:{silent.getsockname()[1]}"
        sink = far.open_sink(url, options, state_dir=tmp_path)
        for k in range(1, 6):
            sink.write(event(k))
        wait_for(lambda: "no answer" in sink.state.reason)
        assert sink.state.n_waiting == 5
        in_time(sink.close, 0.2)


@pytest.fixture
def pipe():
    """Open a sink on stdout that is a pipe; return it and what reads that."""
    with contextlib.ExitStack() as stack:

        def open_on_pipe(url, **context):
            read_fd, write_fd = os.pipe()
            reader = stack.enter_context(os.fdopen(read_fd, "rb", 0))
            # In the test itself, for pytest puts its own stdout in place.
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(sys, "stdout", stack.enter_context(os.fdopen(write_fd, "w")))
                return far.open_sink(url, **context), reader

        yield open_on_pipe


@pytest.mark.parametrize("url", ["json", "table"])
def test_a_reader_that_pauses_costs_decisions_and_no_events(url, pipe):
    sink, reader = pipe(url)
    n = 6000

    def flood():
        sink.write(hello())
        for seq in range(1, n + 1):
            sink.write(decision(seq))
        sink.write(event(7))

    in_time(flood)
    assert wait_for(lambda: sink.state.n_dropped) > 1000
    end = in_thread(sink.close, 8.0)
    text = b""
    while b"human at 7.0 m" not in text:
        text += reader.read(65_536)
    end.join(60)
    assert not end.is_alive()
    assert sink.state.n_sent == n + 2 - sink.state.n_dropped


@pytest.mark.parametrize("can_wait", [True, False])
def test_a_reader_that_goes_away_ends_the_run(pipe, can_wait):
    sink, reader = pipe("json", can_wait=can_wait)
    reader.close()

    def is_over():
        with contextlib.suppress(BrokenPipeError):
            sink.write(decision())
            return False
        return True

    wait_for(is_over)
    in_time(sink.close)
