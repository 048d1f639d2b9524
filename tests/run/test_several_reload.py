"""Several radars and reloads: what changes, comes or goes, and what stays as it was."""

import json
import threading

import pytest

from radard.config.config import load_config
from radard.health.status_file import status_path
from tests.daemon_helpers import told
from tests.waiting import free_port, wait_for
from tests.web_helpers import ask

pytestmark = pytest.mark.integration


def of(records, sensor):
    return [r for r in records if r.get("sensor") == sensor]


ROOMS = {"hall": {"port": "sim:empty"}, "attic": {"port": "sim:empty?seed=3"}}


def two_rooms(launch, **how):
    """A daemon whose two radars decide, what its reload takes (to be filled), and the radars."""
    choices = []
    daemon = launch(sensors=ROOMS, reload=lambda: choices[0], **how)
    hall, attic = daemon.run.sensors
    wait_for(lambda: told(hall).get("seq") and told(attic).get("seq"))
    return daemon, choices, hall, attic


def with_others(daemon, sensors):
    options = daemon.config.model_dump(exclude={"sensors", "sensor"})
    options["sensor"] = {"speed": "10"}
    return load_config(environ={}, options={**options, "sensors": sensors})


def test_a_reload_adds_and_removes_radars_and_leaves_the_others(tmp_path, launch):
    out = tmp_path / "out.jsonl"
    daemon, choices, hall, _ = two_rooms(launch, output=[f"json:{out}"])
    more = {"shed": {"port": "sim:empty?seed=4"}, "cellar": {"port": str(tmp_path / "absent")}}
    choices.append(with_others(daemon, {"hall": ROOMS["hall"], **more}))
    daemon.ask("reload")
    wait_for(lambda: [radar.sensor for radar in daemon.run.sensors] == ["hall", "shed", "cellar"])
    shed = daemon.run.sensors[1]
    wait_for(lambda: told(shed).get("seq", 0) > 2)
    # Its status, its socket and its threads are gone; another's have come.
    wait_for(lambda: not status_path(tmp_path, "attic").exists())
    assert not (tmp_path / "attic.sock").exists()
    assert (tmp_path / "shed.sock").exists()
    wait_for(lambda: status_path(tmp_path, "shed").exists())
    wait_for(lambda: not any(t.name.startswith("attic") for t in threading.enumerate()))
    wait_for(lambda: daemon.run._heart.status.state == "degraded")
    assert "cellar: offline" in daemon.run._heart.status.reason
    seq = told(hall)["seq"]
    wait_for(lambda: told(hall)["seq"] > seq + 1)
    assert daemon.stop() == 0
    records = [json.loads(line) for line in out.read_text().splitlines()]
    seqs = [r["seq"] for r in of(records, "shed") if r["type"] == "decision"]
    assert seqs == list(range(1, len(seqs) + 1))
    assert next(r for r in of(records, "shed") if r["type"] != "status")["type"] == "hello"
    last = [r for r in of(records, "attic") if r["type"] == "status"][-1]
    assert (last["state"], last["reason"]) == ("offline", "stopped")


def test_radars_that_a_reload_adds_have_topics_and_pages(launch, broker, listen):
    choices, base = [], f"http://127.0.0.1:{free_port()}"
    listener = listen()
    outputs = [f"mqtt://127.0.0.1:{broker.port}", base]
    daemon = launch(sensors=ROOMS, output=outputs, reload=lambda: choices[0])
    wait_for(lambda: b"online" in listener.on("radard/attic-simulated/availability"))
    assert ask(base + "/sensor/attic/healthz")[0] == 200
    more = {"shed": {"port": "sim:empty?seed=4"}}
    choices.append(with_others(daemon, {"hall": ROOMS["hall"], **more}))
    daemon.ask("reload")
    wait_for(lambda: b"online" in listener.on("radard/shed-simulated/availability"))
    wait_for(lambda: listener.on("radard/attic-simulated/availability")[-1] == b"offline")
    wait_for(lambda: ask(base + "/sensor/shed/healthz")[0] == 200)
    assert ask(base + "/sensor/attic/healthz")[0] == 404
    assert ask(base + "/api/v1/status")[1]["sensors"] == {"shed": "/sensor/shed/"}


def test_a_reload_begins_a_radar_again_whose_port_is_another(launch):
    daemon, choices, hall, attic = two_rooms(launch)
    entry = daemon.config.sensors["hall"].model_copy(update={"port": "sim:empty?seed=9"})
    changed = {**daemon.config.sensors, "hall": entry}
    choices.append(daemon.config.model_copy(update={"sensors": changed}))
    daemon.ask("reload")
    wait_for(lambda: daemon.run.sensors[0] is attic and len(daemon.run.sensors) == 2)
    again = daemon.run.sensors[1]
    assert (again.sensor, again is hall) == ("hall", False)
    wait_for(lambda: told(again).get("seq"))


def test_a_reload_that_adds_a_radar_without_a_model_changes_nothing(launch, caplog):
    choices = []
    daemon = launch(sensors={"hall": {"port": "sim:empty"}}, reload=lambda: choices[0])
    (hall,) = daemon.run.sensors
    wait_for(lambda: told(hall).get("seq"))
    broken = {"port": "sim:empty", "model": {"name": "nosuch"}}
    choices.append(with_others(daemon, {"hall": {"port": "sim:empty"}, "shed": broken}))
    daemon.ask("reload")
    wait_for(lambda: "the old configuration stays" in caplog.text)
    assert daemon.run.sensors == [hall]
    seq = told(hall)["seq"]
    wait_for(lambda: told(hall)["seq"] > seq)
