"""Trouble of outputs: health says it, names the output, and takes it back."""

import json
import time

import pytest

from radard.health.status_file import read_status, status_path
from radard.outputs.exec import ProgramSink
from radard.outputs.jsonl import JsonLinesSink
from radard.outputs.mqtt.sink import MqttSink
from radard.outputs.store import StoreSink
from radard.outputs.webhook import WebhookSink
from radard.pipeline import Pipeline
from radard.stream.source import LiveSource
from tests.daemon_helpers import Gate, launcher
from tests.sink_helpers import Listener, MqttBroker, WebServer
from tests.waiting import free_port, wait_for

pytestmark = [
    pytest.mark.integration,
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
launch = pytest.fixture(launcher)


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr("radard.run.sink_watch.GRACE_S", 0.2)
    monkeypatch.setattr("radard.run.sink_watch.STUCK_S", 0.6)
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
    outputs = [f"mqtt://127.0.0.1:{broker.port}", f"json:{out}"]
    daemon = launch(output=outputs, log=OUTBOX)
    try:
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
    finally:
        assert daemon.stop() == 0
        broker.stop()
    told = [json.loads(line) for line in out.read_text().splitlines()]
    states = [r["state"] for r in told if r["type"] == "status"]
    assert (states[0], states[-1]) == ("starting", "offline")
    # In this order; on a busy machine an output may be in trouble besides.
    left = iter(states[1:-1])
    assert all(state in left for state in ("online", "degraded", "online"))
    assert set(states[1:-1]) <= {"degraded", "online"}


SINKS = {
    "json": (JsonLinesSink, "_deliver", "json:"),
    "store": (StoreSink, "_deliver", "store:"),
    "webhook": (WebhookSink, "_send", "webhook:"),
    "exec": (ProgramSink, "_send", "exec:"),
    "mqtt delivery": (MqttSink, "_send", "mqtt:"),
    "mqtt": (MqttSink, "_tick", "mqtt:"),
}


@pytest.mark.parametrize("which", SINKS)
def test_a_sink_that_stands_still_degrades_and_delays_nothing(
    which, tmp_path, monkeypatch, launch, quick
):
    cls, name, scheme = SINKS[which]
    gate = Gate()
    gate.before(monkeypatch, cls, name)
    broker = MqttBroker(tmp_path) if scheme == "mqtt:" else None
    server = WebServer()
    outputs = {
        "json": f"json:{tmp_path / 'out.jsonl'}",
        "store": f"store:{tmp_path / 'radard.db'}",
        "webhook": f"webhook:http://127.0.0.1:{server.port}/",
        "exec": "exec:cat",
        "mqtt": f"mqtt://127.0.0.1:{broker.port if broker else 0}",
    }
    # Somebody walks about, so there are events for those who take nothing else.
    daemon = launch(
        sensor={"port": "sim:human", "speed": "10"},
        alarm={"sensitivity": "high", "refractory_s": 0, "latch_s": 0},
        model={"name": "thesis"},
        output=[outputs[which.split()[0]]],
        log=OUTBOX,
        clips={"enabled": False},
    )
    listener = Listener(broker.port) if which == "mqtt" else None
    try:
        wait_for_state(tmp_path, "online")
        if listener:
            wait_for(
                lambda: listener.on("radard/radar-simulated/availability")[-1:] == [b"online"]
            )
        gate.shut()
        wait_for_state(tmp_path, "degraded", f"output {scheme}")
        seq = report(tmp_path)["seq"]
        wait_for(lambda: report(tmp_path)["seq"] > seq + 5)
        daemon.far.drain()
        assert daemon.far.wait_for("WATCHDOG")
        if listener:
            wait_for(lambda: listener.on("radard/radar-simulated/availability")[-1] == b"offline")
        gate.open()
        wait_for_state(tmp_path, "online")
        if listener:
            wait_for(lambda: listener.on("radard/radar-simulated/availability")[-1] == b"online")
    finally:
        gate.open()
        if listener:
            listener.close()
        assert daemon.stop() == 0
        server.close()
        if broker:
            broker.stop()


@pytest.mark.parametrize(
    "where", [(Gate.before_each, LiveSource, "frames"), (Gate.before, Pipeline, "decide")]
)
def test_a_radar_that_stands_still_is_offline_on_the_broker(
    where, tmp_path, monkeypatch, launch, quick
):
    gate = Gate()
    put, cls, name = where
    put(gate, monkeypatch, cls, name)
    broker = MqttBroker(tmp_path)
    listener = Listener(broker.port, "radard/radar-simulated/#")
    url = f"mqtt://127.0.0.1:{broker.port}"
    daemon = launch(stale_s=1.5, output=[url], log=OUTBOX)
    try:
        wait_for(lambda: listener.on("radard/radar-simulated/availability")[-1:] == [b"online"])
        gate.shut()
        wait_for(lambda: listener.on("radard/radar-simulated/availability")[-1] == b"offline")
        wait_for(
            lambda: b"no decision from fresh" in listener.on("radard/radar-simulated/health")[-1]
        )
        wait_for(lambda: daemon.far.silent_for(0.5))
        gate.open()
        wait_for(lambda: listener.on("radard/radar-simulated/availability")[-1] == b"online")
    finally:
        gate.open()
        listener.close()
        assert daemon.stop() == 0
        broker.stop()


def test_a_port_of_the_dashboard_that_is_taken_is_said_and_costs_nothing(tmp_path, launch, quick):
    port = free_port()
    server = WebServer(port)
    daemon = launch(output=[f"http://127.0.0.1:{port}"])
    try:
        wait_for_state(tmp_path, "degraded", "cannot listen")
        seq = report(tmp_path)["seq"]
        wait_for(lambda: report(tmp_path)["seq"] > seq + 3)
    finally:
        assert daemon.stop() == 0
        server.close()


def test_a_replay_says_the_same_whatever_its_outputs_do(tmp_path, launch, quick):
    out = tmp_path / "out.jsonl"
    daemon = launch(
        sensor={"port": "sim:empty", "speed": "max"},
        output=[f"mqtt://127.0.0.1:{free_port()}", f"json:{out}"],
        log=OUTBOX,
    )
    wait_for(lambda: report(tmp_path).get("seq", 0) > 100)
    time.sleep(0.5)
    assert daemon.stop() == 0
    told = [json.loads(line) for line in out.read_text().splitlines()]
    states = [r["state"] for r in told if r["type"] == "status"]
    assert states == ["starting", "online", "offline"]
