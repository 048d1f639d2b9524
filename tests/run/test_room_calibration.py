"""The command `calibrate`: a running sensor makes its calibration, keeps it and uses it."""

import json
import logging

import numpy as np
import pytest

from radard.config.config import load_config
from radard.config.directories import kept_calibration
from radard.detect.calibration import load_calibration
from radard.run.room_calibration import can_calibrate
from tests.daemon_helpers import launcher, told
from tests.sink_helpers import Listener, MqttBroker
from tests.waiting import free_port, wait_for
from tests.web_helpers import ask, wait

pytestmark = pytest.mark.integration

launch = pytest.fixture(launcher)
FAST = {"port": "sim:empty", "speed": "10"}
GATE = {"calibrate_after_s": 3.0, "calibrate_s": 25.0}


def phase_of(daemon):
    return (daemon.panel().get("calibration") or {}).get("phase")


def ended(daemon):
    """Ask for a calibration and return how it ended."""
    radar = daemon.radar
    wait_for(lambda: told(radar).get("seq"))
    seen = set()
    radar.command("calibrate")

    def is_over():
        seen.add(phase_of(daemon))
        return phase_of(daemon) in {"made", "failed"}

    wait_for(is_over)
    assert {"leave", "listen"} <= seen
    return told(radar)["calibration"]


def test_an_empty_room_is_kept_and_used(tmp_path, launch, caplog):
    caplog.set_level(logging.INFO, "radard")
    daemon = launch(sensor=FAST, gate=GATE)
    told = ended(daemon)
    assert told["phase"] == "made"
    assert "predicted false gates" in told["text"]
    path = tmp_path / "state" / "radar.sim.calibration.json"
    made = load_calibration(path)
    assert (made.provenance.port, made.provenance.model) == ("sim:empty", "none")
    assert 22 <= made.provenance.n_dwells <= 26
    assert path.stat().st_mode & 0o777 == 0o644
    pipeline = daemon.radar.parts.pipeline
    wait_for(lambda: pipeline.calibration is not None)
    np.testing.assert_allclose(pipeline.calibration.floor, made.floor, rtol=1e-3)
    seq = daemon.panel()["seq"]
    wait_for(lambda: daemon.panel()["seq"] > seq + 2)
    assert daemon.panel()["gate"] == "closed"
    daemon.ask("reload")
    assert daemon.stop() == 0
    assert pipeline.calibration is not None


def test_a_room_with_somebody_in_it_is_refused(tmp_path, launch, caplog):
    daemon = launch(sensor={**FAST, "port": "sim:human"}, gate=GATE)
    told = ended(daemon)
    assert told["phase"] == "failed"
    assert "the room is not empty" in told["text"]
    assert daemon.radar.parts.pipeline.calibration is None
    assert daemon.stop() == 0
    assert not list((tmp_path / "state").glob("*calibration*"))
    assert "what held before holds" in caplog.text


def test_a_file_that_cannot_be_written_holds_for_this_run(tmp_path, launch):
    (tmp_path / "file").write_text("")
    daemon = launch(sensor=FAST)
    wait_for(lambda: daemon.panel().get("seq"))
    # Not at the start, where a file that was named must be there.
    gate = daemon.config.gate.model_copy(
        update={**GATE, "calibration": str(tmp_path / "file" / "x.json")}
    )
    daemon.radar.parts.config = daemon.config.model_copy(update={"gate": gate})
    told = ended(daemon)
    assert told["phase"] == "made"
    assert "holds until the end of this run" in told["text"]
    wait_for(lambda: daemon.radar.parts.pipeline.calibration is not None)
    assert daemon.stop() == 0


def test_without_calibration_the_gate_learns_anew(launch, monkeypatch):
    restarted = []
    monkeypatch.setattr("radard.pipeline.Pipeline.restart", lambda _self: restarted.append(1))
    daemon = launch(gate={"calibration": "none"})
    wait_for(lambda: daemon.panel().get("seq"))
    daemon.radar.command("calibrate")
    wait_for(lambda: restarted)
    assert daemon.panel()["calibration"] is None
    assert daemon.stop() == 0


@pytest.mark.parametrize(
    ("port", "calibration", "name"),
    [
        ("/dev/ttyACM0", "auto", "hall.calibration.json"),
        ("sim:empty", "auto", "hall.sim.calibration.json"),
        ("/dev/ttyACM0", "/etc/own.json", "own.json"),
        ("replay:x.h5", "auto", None),
        ("/dev/ttyACM0", "none", None),
    ],
)
def test_where_it_is_kept(tmp_path, port, calibration, name):
    config = load_config(
        environ={},
        options={
            "sensor": {"name": "hall", "port": port},
            "service": {"state_dir": tmp_path},
            "gate": {"calibration": calibration},
        },
    )
    assert can_calibrate(config) is (name is not None)
    if name:
        assert kept_calibration(config).name == name


def test_mqtt_and_the_dashboard_start_it_and_tell_how_it_went(tmp_path, launch):
    broker = MqttBroker(tmp_path)
    listener = Listener(broker.port, "radard/radar-simulated/health")
    base = f"http://127.0.0.1:{free_port()}"
    daemon = launch(
        sensor=FAST,
        gate=GATE,
        output=[f"mqtt://127.0.0.1:{broker.port}", base],
        mqtt={"commands": "always"},
    )

    def said():
        messages = listener.on("radard/radar-simulated/health")
        return json.loads(messages[-1])["calibration"] or "" if messages else ""

    try:
        wait(lambda: ask(base + "/healthz")[0] == 200)
        wait_for(lambda: listener.on("radard/radar-simulated/health"))
        listener.say("radard/radar-simulated/command/calibrate")
        wait_for(lambda: said() == "leave")
        wait_for(lambda: said().startswith("made: "))
        path = tmp_path / "state" / "radar.sim.calibration.json"
        first = path.read_text()
        body = json.dumps({"command": "calibrate"}).encode()
        headers = {"Content-Type": "application/json", "X-Radard": "1"}
        assert ask(base + "/api/v1/command", data=body, headers=headers)[0] == 202

        def shown():
            return ask(base + "/api/v1/status")[1]["panel"]["calibration"]["phase"]

        wait_for(lambda: shown() == "listen")
        wait_for(lambda: shown() == "made")
        assert path.read_text() != first
    finally:
        listener.close()
        assert daemon.stop() == 0
        broker.stop()
