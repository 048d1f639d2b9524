"""Trouble of outputs: health says it, names the output, and takes it back."""

import time

import pytest

from radard.health.heartbeat import read_status, status_path
from radard.outputs import exec as program
from radard.outputs import webhook
from radard.outputs.jsonl import JsonLinesSink
from radard.outputs.mqtt.link import MqttLink
from radard.outputs.mqtt.sink import MqttSink
from radard.outputs.store import StoreSink
from tests.radar_helpers import records_in, states
from tests.sink_helpers import MQTT_MARKS, MqttBroker
from tests.waiting import free_port, wait_for

pytestmark = MQTT_MARKS


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr("radard.outputs.registry.GRACE_S", 0.2)
    monkeypatch.setattr("radard.outputs.registry.STUCK_S", 0.6)
    monkeypatch.setattr("radard.outputs.mqtt.sink._HANGS_S", 1.2)


def report(tmp_path):
    return read_status(status_path(tmp_path, "radar")).content


def wait_for_state(tmp_path, state, words=""):
    def holds():
        found = report(tmp_path)
        return found.get("state") == state and words in found.get("reason", "")

    wait_for(holds, explain=lambda: report(tmp_path))


OUTBOX = {"first_retry_s": 0.05, "longest_retry_s": 0.1}


def test_a_broker_that_is_away_degrades_until_it_is_back(tmp_path, launch, quick):
    broker, out = MqttBroker(tmp_path), tmp_path / "out.jsonl"
    daemon = launch(output=[f"mqtt://127.0.0.1:{broker.port}", f"json:{out}"], log=OUTBOX)
    wait_for_state(tmp_path, "online")
    broker.stop()
    wait_for_state(tmp_path, "degraded", f"output mqtt://127.0.0.1:{broker.port}/radard: ")
    daemon.far.drain()
    status = daemon.far.wait_for("WATCHDOG")["STATUS"]
    # A busy machine may lose frames besides.
    assert status.startswith("degraded: ")
    assert "output mqtt://" in status
    broker.start()
    wait_for_state(tmp_path, "online")
    assert daemon.stop() == 0
    told = [state for state, _ in states(records_in(out))]
    assert (told[0], told[-1]) == ("starting", "offline")
    # In this order; on a busy machine an output may be in trouble besides.
    left = iter(told[1:-1])
    assert all(state in left for state in ("online", "degraded", "online"))
    assert set(told[1:-1]) <= {"degraded", "online"}


SINKS = {
    "json:{folder}/out.jsonl": (JsonLinesSink, "_deliver"),
    "store:{folder}/radard.db": (StoreSink, "_deliver"),
    "webhook:http://127.0.0.1:{web}/": (webhook.http.client, "HTTPConnection"),
    "exec:cat": (program.subprocess, "Popen"),
    "mqtt://127.0.0.1:{mqtt}/a": (MqttLink, "publish_confirmed"),
    "mqtt://127.0.0.1:{mqtt}/b": (MqttSink, "_tick"),
}


@pytest.mark.parametrize("output", SINKS)
def test_a_sink_that_stands_still_degrades_and_delays_nothing(
    output, tmp_path, monkeypatch, *, server, broker, listen, launch, gate
):
    gate.before(monkeypatch, *SINKS[output])
    listener = listen("b/radar-simulated/availability")
    # Somebody walks about, so there are events for those who take nothing else.
    daemon = launch(
        sensor={"port": "sim:human", "speed": "10"},
        alarm={"sensitivity": "high", "refractory_s": 0, "latch_s": 0},
        model={"name": "thesis"},
        output=[output.format(folder=tmp_path, web=server.port, mqtt=broker.port)],
        log=OUTBOX,
        clips={"enabled": False},
    )

    def is_said(state):
        """Whether MQTT's own thread tells that it works, or the broker that it does not."""
        return not output.endswith("/b") or [m[1] for m in listener.messages[-1:]] == [state]

    wait_for_state(tmp_path, "online")
    wait_for(lambda: is_said(b"online"))
    gate.shut()
    wait_for_state(tmp_path, "degraded", f"output {output.partition(':')[0]}:")
    seq = report(tmp_path)["seq"]
    wait_for(lambda: report(tmp_path)["seq"] > seq + 5)
    daemon.far.drain()
    assert daemon.far.wait_for("WATCHDOG")
    wait_for(lambda: is_said(b"offline"))
    gate.open()
    wait_for_state(tmp_path, "online")
    wait_for(lambda: is_said(b"online"))


def test_a_replay_says_the_same_whatever_its_outputs_do(tmp_path, launch, quick):
    out = tmp_path / "out.jsonl"
    outputs = [f"mqtt://127.0.0.1:{free_port()}", f"json:{out}"]
    daemon = launch(sensor={"port": "sim:empty", "speed": "max"}, output=outputs, log=OUTBOX)
    wait_for(lambda: report(tmp_path).get("seq", 0) > 100)
    time.sleep(0.5)
    assert daemon.stop() == 0
    assert [state for state, _ in states(records_in(out))] == ["starting", "online", "offline"]
