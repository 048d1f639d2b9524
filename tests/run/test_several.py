"""Several radars in one process: each as if alone, none touched by another's trouble or reload."""

import json
import threading

import pytest
import yaml

from radard.commands.config import shown
from radard.config.config import load_config, load_with_origins
from radard.errors import UsageError
from radard.health.heartbeat import read_status, status_path
from radard.log import EventLog
from radard.run.sensor import Sensor
from radard.stream.source import LiveSource
from tests.daemon_helpers import told
from tests.device_helpers import plugged
from tests.radar_helpers import decisions, records_in, run_radard, stable, states
from tests.sink_helpers import event, ulid
from tests.waiting import free_port, wait_for
from tests.web_helpers import HEADERS, ask, wait

pytestmark = pytest.mark.integration

TWO = {"hall": {"port": "sim:human?seed=1"}, "attic": {"port": "sim:dog?seed=2"}}


def written(tmp_path, **sections):
    path = tmp_path / "radard.yaml"
    path.write_text(yaml.safe_dump(sections, sort_keys=False))
    return path


def of(records, sensor):
    return [r for r in records if r.get("sensor") == sensor]


def bare(records):
    """Records without what only says whose they are, or depends on it."""
    return [
        {k: v for k, v in r.items() if k not in {"sensor", "id", "clip"}} for r in stable(records)
    ]


def test_two_decide_as_each_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("RADARD_SERVICE__RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    sensors = {
        "hall": {**TWO["hall"], "alarm": {"sensitivity": "high"}},
        "attic": {**TWO["attic"], "gate": {"false_alarms_per_day": 9.0}},
    }
    config = written(tmp_path, sensors=sensors, model={"name": "thesis"})
    common = ("--speed", "max", "--duration", "14", "-o", "json", "--model", "thesis")
    code, both, _ = run_radard("--config", str(config), *common)
    assert code == 0
    for sensor, name, value in (
        ("hall", "RADARD_ALARM__SENSITIVITY", "high"),
        ("attic", "RADARD_GATE__FALSE_ALARMS_PER_DAY", "9"),
    ):
        with monkeypatch.context() as patch:
            patch.setenv(name, value)
            alone = run_radard("--port", TWO[sensor]["port"], *common)[1]
        assert bare(of(both, sensor)) == bare(alone)
    hashes = {r["sensor"]: r["config_hash"] for r in both if r["type"] == "hello"}
    assert len(set(hashes.values())) == 2
    assert len([r for r in both if r["type"] == "decision"]) == 24
    assert all("sensor" in r for r in both)


def states_of(tmp_path, *names):
    return {n: read_status(status_path(tmp_path, n)).content.get("state") for n in names}


def test_one_that_cannot_work_is_named_and_leaves_the_others_alone(tmp_path, launch, caplog):
    out = tmp_path / "out.jsonl"
    sensors = {
        "hall": {"port": "sim:empty"},
        "attic": {"port": f"replay:{tmp_path / 'gone.h5'}"},
        "cellar": {"port": str(tmp_path / "ttyX2")},
    }
    daemon = launch(sensors=sensors, output=[f"json:{out}"])
    assert daemon.far.wait_for("READY")["STATUS"].startswith("degraded: attic: offline")
    text = daemon.far.wait_for("WATCHDOG")["STATUS"]
    assert "cellar: offline: device absent" in text
    assert "hall" not in text
    wanted = {"hall": "online", "attic": "offline", "cellar": "offline"}
    wait_for(lambda: states_of(tmp_path, *wanted) == wanted)
    assert daemon.stop() == 0
    records = records_in(out)
    assert decisions(of(records, "hall"))
    assert [r["state"] for r in of(records, "attic")] == ["offline"]
    assert "radard.attic" in {r.name for r in caplog.records}


def test_when_none_can_work_the_process_ends_with_the_first_fault(tmp_path, launch):
    gone = {name: {"port": f"replay:{tmp_path / name}.h5"} for name in ("hall", "attic")}
    daemon = launch(sensors=gone)
    wait_for(lambda: daemon.result is not None)
    daemon.stop()
    assert daemon.result.exit_code == 66
    assert "hall.h5" in str(daemon.result)


def test_work_that_breaks_off_is_begun_anew(tmp_path, launch, monkeypatch):
    monkeypatch.setattr("radard.run.process._FIRST_PAUSE_S", 0.3)
    plain, broken = LiveSource.frames, []

    def frames(self):
        for frame in plain(self):
            if self.stream.device == "sim:dog" and frame.index == 400 and not broken:
                broken.append(frame)
                raise RuntimeError("the cable is on fire")
            yield frame

    monkeypatch.setattr(LiveSource, "frames", frames)
    out = tmp_path / "out.jsonl"
    sensors = {"hall": {"port": "sim:empty"}, "attic": {"port": "sim:dog"}}
    daemon = launch(sensors=sensors, output=[f"json:{out}"])
    wait_for(lambda: out.exists() and out.read_text().count('"hello"') == 3)
    wait_for(lambda: states_of(tmp_path, "attic") == {"attic": "online"})
    assert daemon.stop() == 0
    records = records_in(out)
    told = states(of(records, "attic"))
    assert ("offline", "the cable is on fire") in told
    assert [s for s, _ in told if s == "online"] == ["online", "online"]
    assert [state for state, _ in states(of(records, "hall"))] == ["starting", "online", "offline"]
    # Also of the one that began again: a number is of one decision, whatever asks for it.
    for sensor in sensors:
        seqs = [d["seq"] for d in decisions(of(records, sensor))]
        assert seqs == list(range(1, len(seqs) + 1))


def test_each_has_topics_a_client_and_pages(tmp_path, launch, broker, listen):
    listener, base = listen(), f"http://127.0.0.1:{free_port()}"
    daemon = launch(
        sensors={"hall": {"port": "sim:empty"}, "attic": {"port": str(tmp_path / "gone")}},
        output=[base, f"mqtt://127.0.0.1:{broker.port}"],
        mqtt={"client_id": "ours", "commands": "always"},
    )
    wait_for(lambda: b"online" in listener.on("radard/hall-simulated/availability"))
    wait_for(lambda: b"offline" in listener.on("radard/attic/availability"))
    wait_for(lambda: listener.on("radard/hall-simulated/decision"))
    assert not listener.on("radard/attic/decision")
    assert json.loads(listener.on("radard/hall-simulated/decision")[0])["sensor"] == "hall"
    wait(lambda: ask(base + "/healthz")[1]["state"] == "degraded")
    assert ask(base + "/healthz")[1]["reason"].startswith("attic: offline: device absent")
    codes = [ask(f"{base}/sensor/{name}/healthz")[0] for name in ("hall", "attic", "cellar")]
    assert codes == [200, 503, 404]
    first, second = (ask(f"{base}{at}/api/v1/status")[1] for at in ("", "/sensor/attic"))
    assert (first["sensor"], first["sensors"]) == ("hall", {"attic": "/sensor/attic/"})
    assert (second["sensor"], second["sensors"]) == ("attic", {"hall": "/sensor/hall/"})
    assert b"<html" in ask(base + "/sensor/attic/")[1].lower()
    decisions = ask(base + "/sensor/hall/api/v1/decisions")[1]["decisions"]
    assert {d["sensor"] for d in decisions} == {"hall"}
    text = ask(base + "/metrics")[1].decode()
    assert 'radard_up{sensor="hall"} 1.0' in text
    assert 'radard_up{sensor="attic"} 0.0' in text
    listener.say("radard/hall-simulated/command/disarm")
    wait_for(lambda: daemon.panel()["armed"] is False)
    body = json.dumps({"command": "arm"}).encode()
    at = base + "/sensor/hall/api/v1/command"
    assert ask(at, data=body, headers=HEADERS)[0] == 202
    wait_for(lambda: daemon.panel()["armed"] is True)
    names = [sink.name.rpartition("/")[2] for sink in daemon.radar.sinks() if "mqtt" in sink.name]
    assert names == ["hall", "attic"]
    assert daemon.stop() == 0
    wait_for(lambda: listener.on("radard/hall-simulated/availability")[-1] == b"offline")


def test_sections_of_an_entry_complete_the_common_ones(tmp_path):
    entry = {"port": "sim:dog", "gate": {"adapt_db": 3}}
    gate = {"false_alarms_per_day": 8}
    path = written(tmp_path, gate=gate, sensors={"a": {"port": "x"}, "b": entry})
    config, places = load_with_origins(path, environ={})
    a, b = config.each()
    assert (a.sensor.name, a.sensor.port) == ("a", "x")
    assert (a.gate.false_alarms_per_day, a.gate.adapt_db) == (8, 40)
    assert (b.gate.false_alarms_per_day, b.gate.adapt_db) == (8, 3)
    lines = [line for line in shown(config, places) if "false_alarms_per_day" in line]
    assert [f"# {path}" in line for line in lines] == [True, True]
    assert load_config(path, environ={}, options={"sensor": {"port": "y"}}).sensors == {}
    assert a.of_sensor("b") == b
    for name in ("c", None):
        with pytest.raises(UsageError, match="known are a, b"):
            config.of_sensor(name)


def test_what_only_one_can_have(tmp_path):
    config = written(tmp_path, sensors=TWO)
    code, _, err = run_radard("--config", str(config), "--record", str(tmp_path / "x.h5"))
    assert (code, "name it with --port" in err) == (2, True)
    code, _, err = run_radard("calibrate", "--config", str(config))
    assert (code, "which sensor? known are hall, attic" in err) == (2, True)
    code, _, _ = run_radard("config", "show", "--config", str(config))
    assert code == 0
    assert list(tmp_path.iterdir()) == [config]


def test_a_command_to_a_sensor_that_is_away_holds_when_it_comes(tmp_path, launch):
    name = tmp_path / "ttyX2"
    daemon = launch(sensors={"hall": {"port": "sim:empty"}, "attic": {"port": str(name)}})
    hall, attic = daemon.run.sensors
    wait_for(lambda: told(hall).get("seq"))
    with pytest.raises(ValueError, match="known are arm"):
        attic.command("dance")
    attic.command("disarm")
    attic.command("ack")
    assert told(attic) == {}
    with plugged(speed=5.0) as pty:
        name.symlink_to(pty.path)
        wait_for(lambda: told(attic).get("armed") is False)
        assert told(hall)["armed"] is True
        assert daemon.stop() == 0


def test_only_so_many_are_brought_up_at_once_and_those_who_are_away_count_not(launch, monkeypatch):
    lock, now, most, plain = threading.Lock(), [0], [0], Sensor.open

    def counted(self, on_notice, **options):
        is_away = self.sensor.startswith("away")
        with lock:
            now[0] += not is_away
            most[0] = max(most[0], now[0])
        try:
            return plain(self, on_notice, **options)
        finally:
            with lock:
                now[0] -= not is_away

    monkeypatch.setattr(Sensor, "open", counted)
    monkeypatch.setattr("radard.run.process.MAX_AT_ONCE", 2)
    away = {f"away{k}": {"port": f"/dev/nothing{k}"} for k in range(4)}
    there = {f"r{k}": {"port": f"sim:empty?seed={k}"} for k in range(6)}
    daemon = launch(sensors={**away, **there}, sensor={"speed": "max"})
    wait_for(lambda: all(told(r).get("seq") for r in daemon.run.sensors if r.sensor in there))
    assert 1 <= most[0] <= 2


ROOMS = {"hall": {"port": "sim:empty"}, "attic": {"port": "sim:empty?seed=3"}}


def two_rooms(launch, **how):
    """A daemon whose two radars decide, what a reload gives it (to be filled), and they."""
    choices = []
    daemon = launch(sensors=ROOMS, reload=lambda: with_others(daemon, choices[0]), **how)
    hall, attic = daemon.run.sensors
    wait_for(lambda: told(hall).get("seq") and told(attic).get("seq"))
    return daemon, choices, hall, attic


def with_others(daemon, sensors):
    options = daemon.config.model_dump(exclude={"sensors", "sensor"})
    options["sensor"] = {"speed": "10"}
    return load_config(environ={}, options={**options, "sensors": sensors})


def test_a_reload_adds_and_removes_radars_and_leaves_the_others(tmp_path, launch, broker, listen):
    out, base, listener = tmp_path / "out.jsonl", f"http://127.0.0.1:{free_port()}", listen()
    outputs = [f"json:{out}", f"mqtt://127.0.0.1:{broker.port}", base]
    daemon, choices, hall, _ = two_rooms(launch, output=outputs)
    wait_for(lambda: b"online" in listener.on("radard/attic-simulated/availability"))
    assert ask(base + "/sensor/attic/healthz")[0] == 200
    more = {"shed": {"port": "sim:empty?seed=4"}, "cellar": {"port": str(tmp_path / "absent")}}
    choices.append({"hall": ROOMS["hall"], **more})
    daemon.ask("reload")
    wait_for(lambda: [radar.sensor for radar in daemon.run.sensors] == ["hall", "shed", "cellar"])
    shed = daemon.run.sensors[1]
    wait_for(lambda: told(shed).get("seq", 0) > 2)
    # So have its topics and pages; its status, its socket and its threads are gone.
    wait_for(lambda: b"online" in listener.on("radard/shed-simulated/availability"))
    wait_for(lambda: listener.on("radard/attic-simulated/availability")[-1] == b"offline")
    wait_for(lambda: ask(base + "/sensor/shed/healthz")[0] == 200)
    assert ask(base + "/sensor/attic/healthz")[0] == 404
    others = {name: f"/sensor/{name}/" for name in ("shed", "cellar")}
    assert ask(base + "/api/v1/status")[1]["sensors"] == others
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
    records = records_in(out)
    seqs = [d["seq"] for d in decisions(of(records, "shed"))]
    assert seqs == list(range(1, len(seqs) + 1))
    assert next(r for r in of(records, "shed") if r["type"] != "status")["type"] == "hello"
    assert states(of(records, "attic"))[-1] == ("offline", "stopped")


def test_a_reload_begins_a_radar_again_whose_settings_are_right_now(launch):
    """Before, one that had never come to work stayed away until a restart."""
    zones = ({"include": [span]} for span in ([90, 95], [1, 2]))
    wrong, right = ({**ROOMS, "attic": {**ROOMS["attic"], "zones": each}} for each in zones)
    daemon = launch(sensors=wrong, reload=lambda: with_others(daemon, right))
    hall, attic = daemon.run.sensors
    wait_for(lambda: attic.health.is_over)
    daemon.ask("reload")
    wait_for(lambda: told(daemon.run.sensors[-1]).get("seq"))
    assert daemon.run.sensors[0] is hall
    assert daemon.run.sensors[1].sensor == "attic"


def test_an_alarm_ends_with_a_radar_that_a_reload_takes_away(tmp_path, launch):
    """Before, a siren that waits for the end went on for ever."""
    out, rooms = tmp_path / "out.jsonl", {**ROOMS, "attic": {"port": "sim:human"}}
    daemon = launch(
        sensors=rooms,
        reload=lambda: with_others(daemon, {"hall": ROOMS["hall"]}),
        output=[f"json:{out}"],
        model={"name": "thesis"},
        alarm={"sensitivity": "high", "latch_s": 3600},
    )
    attic = daemon.run.sensors[1]
    wait_for(lambda: told(attic).get("alarm_id"))
    daemon.ask("reload")
    wait_for(lambda: len(daemon.run.sensors) == 1)
    assert daemon.stop() == 0
    rows = of(map(json.loads, out.read_text().splitlines()), "attic")
    last = [r for r in rows if r["type"] == "event" and r["kind"] == "alarm"][-1]
    assert (last["phase"], last["reason"]) == ("end", "taken away by a reload")


def test_what_an_earlier_run_has_left_open_ends_with_the_next(tmp_path, launch):
    """Before, a fault or tamper that a kill had left open never ended at any output."""
    out, log = tmp_path / "out.jsonl", EventLog(tmp_path / "state" / "log.db")
    left = [("hall", "fault", True), ("gone", "tamper", True), ("hall", "alarm", False)]
    for k, (sensor, kind, is_simulated) in enumerate(left):
        mark = {"simulated": True} if is_simulated else {}
        log.append({**event(k, kind=kind), "sensor": sensor, **mark})
    log.close()
    daemon = launch(sensors=ROOMS, output=[f"json:{out}"])
    wait_for(lambda: out.exists() and out.read_text().count('"event"') >= len(left))
    assert daemon.stop() == 0
    ends = [r for r in map(json.loads, out.read_text().splitlines()) if r["type"] == "event"]
    found = {(r["id"], r["phase"], r["sensor"], r.get("simulated", False)) for r in ends}
    assert found == {(ulid(k), "end", of, mark) for k, (of, _, mark) in enumerate(left)}
    again = EventLog(tmp_path / "state" / "log.db")
    assert again.open_events() == [] == [e.id for e in again.events() if e.phase != "end"]
    again.close()


def test_a_reload_begins_a_radar_again_whose_port_is_another(launch, broker, listen):
    """Before, its topics stayed offline, and their commands went to the radar that had gone."""
    mqtt = {"output": [f"mqtt://127.0.0.1:{broker.port}"], "mqtt": {"commands": "always"}}
    daemon, choices, hall, attic = two_rooms(launch, **mqtt)
    base, listener = "radard/hall-simulated", listen()
    wait_for(lambda: b"online" in listener.on(f"{base}/availability"))
    choices.append({**ROOMS, "hall": {"port": "sim:empty?seed=9"}})
    daemon.ask("reload")
    wait_for(lambda: daemon.run.sensors[0] is attic and len(daemon.run.sensors) == 2)
    again = daemon.run.sensors[1]
    assert (again.sensor, again is hall) == ("hall", False)
    wait_for(lambda: told(again).get("seq"))
    wait_for(lambda: listener.on(f"{base}/availability")[-2:] == [b"offline", b"online"])
    listener.say(f"{base}/command/disarm")
    wait_for(lambda: told(again)["armed"] is False)


@pytest.mark.parametrize(
    "broken", [{"port": "sim:empty", "model": {"name": "nosuch"}}, {"port": "socket://h:99999"}]
)
def test_a_reload_that_adds_a_radar_that_cannot_be_changes_nothing(launch, caplog, broken):
    """Before, a port's URL that nothing can be behind ended all of them."""
    daemon, choices, hall, attic = two_rooms(launch)
    choices.append({**ROOMS, "shed": broken})
    daemon.ask("reload")
    wait_for(lambda: "the old configuration stays" in caplog.text)
    assert daemon.run.sensors == [hall, attic]
    wait_for(lambda: "the old configuration stays" in hall.health.status.reason)
    choices[0] = ROOMS
    daemon.ask("reload")
    wait_for(lambda: hall.health.status.state == "online")
    seq = told(hall)["seq"]
    wait_for(lambda: told(hall)["seq"] > seq)
