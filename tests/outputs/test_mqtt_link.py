"""When a delivery is over, as a link to a real broker tells it."""

import threading

import pytest

from radard.config.sink_table import MqttSection
from radard.outputs.base import DeliveryError
from radard.outputs.mqtt.link import Broker, MqttLink, Publication
from tests.waiting import wait_for
from x2radar.backoff import Backoff

# paho leaves the socket of a connection that ended to the collector.
pytestmark = [
    pytest.mark.integration,
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
STATE = Publication("radard/hall/state", "{}")
PICTURE = Publication("radard/hall/picture", b"x" * 20_000)


class Link:
    """A link, what it said, and a gate at which its own thread may be held."""

    def __init__(self, port):
        self.said, self.gate, self.is_held = [], threading.Event(), threading.Event()
        self.gate.set()
        self.link = MqttLink(
            Broker(host="127.0.0.1", port=port, is_tls=False, client_id="hall", username=None),
            MqttSection(keepalive_s=2),
            Backoff(0.02, 0.05, "hall"),
            will=None,
            subscriptions=[],
            on_up=lambda: None,
            on_down=lambda _reason: None,
            on_message=lambda *_: None,
            is_alive=self._pass_gate,
            say=self.said.append,
        )
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
