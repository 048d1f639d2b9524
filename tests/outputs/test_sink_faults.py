"""What goes wrong with outputs while a daemon runs: its health says so, and alarms go out."""

import json

import pytest

from radard.health.status_file import read_status, status_path
from tests.daemon_helpers import launcher
from tests.sink_helpers import Listener, MqttBroker, WebServer, wait_for

pytestmark = [
    pytest.mark.integration,
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
launch = pytest.fixture(launcher)
OUTBOX = {"first_retry_s": 0.05, "longest_retry_s": 0.1}


def wait_for_state(tmp_path, state, words=""):
    def holds():
        found = read_status(status_path(tmp_path, "radar")).content
        return found.get("state") == state and words in found.get("reason", "")

    wait_for(holds)


def test_a_wrong_password_file_in_a_reload_is_degraded_and_mqtt_goes_on(
    tmp_path, launch, monkeypatch
):
    monkeypatch.setattr("radard.outputs.fanout._RETRY_S", 0.1)
    broker, words = MqttBroker(tmp_path), tmp_path / "words"
    listener = Listener(broker.port, "radard/#")
    # SIGHUP and zones saved on the dashboard ask for the same.
    wanted = []
    daemon = launch(
        output=[f"mqtt://127.0.0.1:{broker.port}"],
        log=OUTBOX,
        reload=lambda: wanted[-1],
    )

    def last(name):
        found = [m for t, m, _ in list(listener.messages) if t.endswith(f"/{name}")]
        return found[-1] if found else b""

    try:
        wait_for_state(tmp_path, "online")
        wait_for(lambda: last("availability") == b"online")
        mqtt = daemon.config.mqtt.model_copy(update={"username": "u", "password_file": words})
        wanted.append(daemon.config.model_copy(update={"mqtt": mqtt}))
        daemon.ask("reload")
        wait_for_state(tmp_path, "degraded", "mqtt.password_file")
        # Nothing was disconnected: the broker hears of it from the old connection.
        wait_for(lambda: b"mqtt.password_file" in last("health"))
        told = [m for t, m, _ in list(listener.messages) if t.endswith("/availability")]
        assert b"offline" not in told[told.index(b"online") :]
        words.write_text("right\n")
        wait_for_state(tmp_path, "online")
    finally:
        listener.close()
        assert daemon.stop() == 0
        broker.stop()


def test_alarms_go_out_although_nothing_can_be_kept(tmp_path, launch, monkeypatch):
    monkeypatch.setattr("radard.run.sink_watch.GRACE_S", 0.2)
    (tmp_path / "state").write_text("no folder\n")
    server = WebServer()
    daemon = launch(
        sensor={"port": "sim:human", "speed": "10"},
        alarm={"sensitivity": "high"},
        model={"name": "thesis"},
        output=[f"webhook:http://127.0.0.1:{server.port}/"],
        log=OUTBOX,
    )
    try:
        wait_for_state(tmp_path, "degraded", "in memory only")
        wait_for(lambda: any(json.loads(b)["kind"] == "alarm" for _, _, b in list(server.posts)))
    finally:
        assert daemon.stop() == 0
        server.close()
