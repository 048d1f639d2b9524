"""What a broker of MQTT 5 answers: refusals, and what it says that it does not do."""

import contextlib
import socket
import socketserver
import threading

import pytest

from radard.config.sink_table import SinkOptions
from radard.outputs.base import DeliveryError
from radard.outputs.mqtt.link import Publication
from radard.outputs.trial import tried
from tests.outputs.test_mqtt_link import Link
from tests.sink_helpers import QUICK, decision, event, hello, open_sink
from tests.waiting import wait_for

# paho leaves the socket of a connection that ended to the collector.
pytestmark = [
    pytest.mark.integration,
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
_NOT_AUTHORIZED, _NO_RETAIN = 0x87, 0x9A
EVENT = Publication("radard/hall/event", "{}", is_retained=False)


class Broker(socketserver.ThreadingTCPServer):
    """Answers as MQTT 5 has it; refuses topics that end so, and keeps messages if it may."""

    daemon_threads = True

    def __init__(self, refused=(), *, retains=True, answers=True):
        super().__init__(("127.0.0.1", 0), _Line)
        self.refused, self.retains, self.answers = tuple(refused), retains, answers
        self.topics: list[str] = []
        self.lines: list[socket.socket] = []
        threading.Thread(target=self.serve_forever, args=(0.01,), daemon=True).start()

    @property
    def port(self):
        return self.server_address[1]

    def stop(self):
        self.shutdown()
        self.server_close()
        for line in self.lines:
            with contextlib.suppress(OSError):
                line.shutdown(socket.SHUT_RDWR)

    def code_of(self, topic):
        return _NOT_AUTHORIZED if self.refused and topic.endswith(self.refused) else 0


class _Line(socketserver.StreamRequestHandler):
    def handle(self):
        self.server.lines.append(self.connection)
        try:
            while self._answer():
                pass
        except (OSError, IndexError):
            return

    def _answer(self):
        head = self.rfile.read(1)[0]
        n, shift = 0, 0
        while (byte := self.rfile.read(1)[0]) & 0x80:
            n, shift = n | (byte & 0x7F) << shift, shift + 7
        body, broker = self.rfile.read(n | byte << shift), self.server
        match head >> 4:
            case 1:
                wants_retain = bool(body[7] & 0x20)
                code = _NO_RETAIN if wants_retain and not broker.retains else 0
                self._say(0x20, bytes([0, code, 2, 0x25, broker.retains]))
                return not code
            case 8:
                names, at = [], 3
                while at < len(body):
                    n = int.from_bytes(body[at : at + 2], "big")
                    names.append(body[at + 2 : at + 2 + n].decode())
                    at += 3 + n
                self._say(0x90, body[:2] + bytes([0, *map(broker.code_of, names)]))
            case 3:
                n = int.from_bytes(body[:2], "big")
                broker.topics.append(topic := body[2 : 2 + n].decode())
                if head & 1 and not broker.retains:
                    self.connection.shutdown(socket.SHUT_RDWR)
                    return False
                if head & 6 and broker.answers:
                    self._say(0x40, body[2 + n : 4 + n] + bytes([broker.code_of(topic)]))
            case 12:
                self._say(0xD0, b"")
        return True

    def _say(self, head, body):
        self.wfile.write(bytes([head, len(body)]) + body)


@pytest.fixture
def broker():
    made = []

    def make(*args, **options):
        made.append(Broker(*args, **options))
        return made[-1]

    yield make
    for each in made:
        each.stop()


def test_what_a_broker_refuses_is_not_delivered_and_said(broker):
    link = Link(broker(["event", "state"]).port)
    try:
        with pytest.raises(DeliveryError, match="Not authorized") as caught:
            link.link.publish_confirmed(EVENT)
        assert caught.value.is_refusal
        for _ in range(2):
            link.link.publish(Publication("radard/hall/state", "{}"))
            wait_for(lambda: link.link.is_idle)
        said = ["radard/hall/state is left out: the broker refuses it: Not authorized"]
        assert link.said == said
        link.link.publish_confirmed(Publication("radard/hall/health", "{}"))
    finally:
        link.link.close(1.0)


def test_an_alarm_that_a_broker_refuses_waits_and_is_no_success(broker, tmp_path):
    url = f"mqtt://127.0.0.1:{broker(['event']).port}"
    sink = open_sink(url, SinkOptions(log=QUICK), state_dir=tmp_path, sensor="hall")
    try:
        wait_for(lambda: sink.state.is_ok)
        sink.write(event(1))
        wait_for(lambda: sink.state.n_failures >= 4)
        state = sink.state
        assert (state.n_waiting, state.n_events) == (1, 0)
        assert "Not authorized" in state.reason
    finally:
        sink.close(1.0)


def test_a_broker_that_keeps_nothing_still_gets_events(broker):
    made = broker(retains=False)
    sink = open_sink(f"mqtt://127.0.0.1:{made.port}", SinkOptions(log=QUICK), sensor="hall")
    try:
        wait_for(lambda: sink.state.is_ok)
        sink.write(hello())
        sink.write(decision())
        sink.write(event(1))
        wait_for(lambda: sink.state.n_events == 1)
        wait_for(lambda: "radard/hall/state" in made.topics)
        assert "radard/hall/event" in made.topics
    finally:
        sink.close(1.0)


def test_commands_that_nobody_can_send_are_said(broker):
    made = broker(["command/+"])
    options = SinkOptions(log=QUICK, mqtt={"commands": "always"})
    sink = open_sink(f"mqtt://127.0.0.1:{made.port}", options, sensor="hall")
    try:
        wait_for(lambda: "nobody listen" in sink.state.remark)
    finally:
        sink.close(1.0)


def test_a_test_alarm_is_taken_once_it_is_confirmed_and_not_by_decisions(broker, monkeypatch):
    monkeypatch.setattr("radard.outputs.trial.ANSWERED_S", 0.5)
    made = broker(answers=False)
    sink = open_sink(f"mqtt://127.0.0.1:{made.port}", SinkOptions(log=QUICK), sensor="hall")
    try:
        wait_for(lambda: sink.state.is_ok)

        def send():
            sink.write(event(1))
            sink.write(decision())

        (answer,) = tried([sink], send)
        assert sink.state.n_sent > 0
        assert answer["answer"] == "no answer yet"
    finally:
        # What waits for an answer ends with the line.
        made.stop()
        sink.close(5.0)
