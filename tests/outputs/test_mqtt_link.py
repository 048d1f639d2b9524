"""A link to an MQTT broker: when a delivery is over, and what a broker's refusals do to it."""

import contextlib
import socket
import socketserver
import threading

import pytest

from radard.config.sink_table import MqttSection, SinkOptions
from radard.outputs.base import DeliveryError
from radard.outputs.mqtt.link import Broker, MqttLink, Publication
from radard.outputs.registry import tried
from tests.sink_helpers import MQTT_MARKS, QUICK, decision, event, hello, open_sink, read_packet
from tests.waiting import wait_for
from x2radar.backoff import Backoff

pytestmark = MQTT_MARKS
STATE = Publication("radard/hall/state", "{}")
PICTURE = Publication("radard/hall/picture", b"x" * 20_000)


class Link:
    """A link, what it said, and a gate at which its own thread may be held."""

    def __init__(self, port):
        self.said, self.gate, self.is_held = [], threading.Event(), threading.Event()
        self.gate.set()
        broker = Broker(host="127.0.0.1", port=port, is_tls=False, client_id="hall", username=None)
        calls = {"on_up": lambda: None, "on_down": lambda _reason: None}
        calls |= {"on_message": lambda *_: None, "is_alive": self._pass_gate}
        options = MqttSection(keepalive_s=2), Backoff(0.02, 0.05, "hall")
        given = {"will": None, "subscriptions": [], "say": self.said.append, **calls}
        self.link = MqttLink(broker, *options, **given)
        self.link.start()
        wait_for(lambda: self.link.is_up)

    def _pass_gate(self):
        if not self.gate.is_set():
            self.is_held.set()
        return self.gate.wait(60)


@pytest.fixture
def link(broker):
    made = Link(broker.port)
    yield made
    made.gate.set()
    made.link.close(1.0)


def test_a_delivery_is_over_once_the_broker_has_confirmed_it(link, listen):
    listener = listen("radard/#")
    assert link.link.is_idle
    for message in (STATE, PICTURE, Publication(STATE.topic, "{}", qos=0)):
        assert link.link.publish(message)
    wait_for(lambda: link.link.is_idle)
    link.link.publish_confirmed(STATE)
    assert link.link.is_idle
    wait_for(lambda: len(listener.messages) == 4)


def test_what_was_never_sent_is_over_and_to_blame_for_nothing(link, broker):
    # As often as it takes to leave a message out that breaks lines.
    for _ in range(2):
        link.gate.clear()
        assert link.is_held.wait(60)
        broker.stop()
        # The line is gone, and the thread that would say so is held.
        wait_for(lambda: not link.link.publish(STATE))
        assert link.link.is_up
        assert not link.link.publish(PICTURE)
        assert not link.link.publish(Publication(STATE.topic, "{}", qos=0))
        broker.start()
        link.is_held.clear()
        link.gate.set()
        wait_for(lambda: not link.link.is_up)
        wait_for(lambda: link.link.is_idle)
    link.link.publish_confirmed(PICTURE)
    assert link.said == []
    broker.stop()
    wait_for(lambda: not link.link.is_up)
    with pytest.raises(DeliveryError):
        link.link.publish_confirmed(STATE)


_NOT_AUTHORIZED, _NO_RETAIN = 0x87, 0x9A


class StrictBroker(socketserver.ThreadingTCPServer):
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
        (head, *_), body = read_packet(self.rfile)
        broker = self.server
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
def strict():
    """Make a strict broker, and a sink on it."""
    with contextlib.ExitStack() as stack:

        def make(*args, mqtt=None, **options):
            made = StrictBroker(*args, **options)
            url, options = f"mqtt://127.0.0.1:{made.port}", SinkOptions(log=QUICK, mqtt=mqtt or {})
            sink = open_sink(url, options, sensor="hall")
            stack.callback(sink.close, 1.0)
            # What waits for an answer ends with the line.
            stack.callback(made.stop)
            return made, sink

        yield make


def test_what_a_broker_refuses_is_not_delivered_and_said(strict):
    made, _ = strict(["event", "state"])
    link = Link(made.port)
    try:
        with pytest.raises(DeliveryError, match="Not authorized") as caught:
            link.link.publish_confirmed(Publication("radard/hall/event", "{}", is_retained=False))
        assert caught.value.is_refusal
        for _ in range(2):
            link.link.publish(Publication("radard/hall/state", "{}"))
            wait_for(lambda: link.link.is_idle)
        said = ["radard/hall/state is left out: the broker refuses it: Not authorized"]
        assert link.said == said
        link.link.publish_confirmed(Publication("radard/hall/health", "{}"))
    finally:
        link.link.close(1.0)


def test_a_rival_that_comes_late_is_said_and_not_met_ever_more_often(strict, monkeypatch, caplog):
    """Before, only one that came within five seconds was, and each then came sooner again."""
    monkeypatch.setattr("radard.outputs.mqtt.link._SHORT_S", 0.0)
    made, sink = strict()
    wait_for(lambda: sink.state.is_ok)
    made.lines[0].sendall(bytes([0xE0, 2, 0x8E, 0]))  # DISCONNECT, session taken over
    wait_for(lambda: len(made.lines) > 1)
    assert "taken over; is another client called" in caplog.text


def test_a_broker_that_keeps_nothing_still_gets_events(strict):
    made, sink = strict(retains=False)
    wait_for(lambda: sink.state.is_ok)
    for record in (hello(), decision(), event(1)):
        sink.write(record)
    wait_for(lambda: sink.state.n_events == 1)
    wait_for(lambda: "radard/hall/state" in made.topics)
    assert "radard/hall/event" in made.topics


def test_commands_that_nobody_can_send_are_said(strict):
    _, sink = strict(["command/+"], mqtt={"commands": "always"})
    wait_for(lambda: "nobody listen" in sink.state.remark)


def test_a_test_alarm_is_taken_once_it_is_confirmed_and_not_by_decisions(strict, monkeypatch):
    monkeypatch.setattr("radard.outputs.registry.ANSWERED_S", 0.5)
    _, sink = strict(answers=False)
    wait_for(lambda: sink.state.is_ok)

    def send():
        sink.write(event(1))
        sink.write(decision())

    (answer,) = tried([sink], send)
    assert sink.state.n_sent > 0
    assert answer["answer"] == "no answer yet"
