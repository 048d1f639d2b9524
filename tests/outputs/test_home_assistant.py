"""Home Assistant: a real core, broker and daemon; and what is offered to it over a broker."""

import base64
import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from radard.alarm.sensor_state import SensorState
from radard.config.config import Config, load_config
from radard.config.sink_table import MqttSection
from radard.errors import ConfigError
from radard.outputs.mqtt.sink import CommandReader, panel_command
from tests.sink_helpers import decision, event, hello, status, well_host
from tests.waiting import wait_for

pytestmark = pytest.mark.integration

PROBE = Path(__file__).with_name("home_assistant_probe.py")
BLUEPRINT = Path(__file__).parents[2] / "deploy/homeassistant/blueprints/notify_with_picture.yaml"
# Of an environment of its own (Python 3.13): homeassistant 2025.3.4 and paho-mqtt 2.1.0, with the
# file package_constraints.txt out of the wheel of the former as --constraint.
PYTHON = os.environ.get("RADARD_TEST_HOME_ASSISTANT")
WITHOUT = "no Home Assistant here: RADARD_TEST_HOME_ASSISTANT names the Python of one"


class HomeAssistant:
    """A core in a process of its own, see `home_assistant_probe.py`."""

    def __init__(self, folder, port):
        folder.mkdir()
        (folder / "configuration.yaml").write_text("")
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        command = [PYTHON, str(PROBE), str(folder), str(port)]
        self._process = subprocess.Popen(command, text=True, **pipes)

    def ask(self, **wanted):
        self._process.stdin.write(json.dumps(wanted) + "\n")
        self._process.stdin.flush()
        answer = json.loads(self._process.stdout.readline())
        assert "ok" in answer, answer
        return answer["ok"]

    def state(self, entity_id):
        """State and attributes, None while there is no such entity."""
        return self.ask(states=True).get(entity_id)

    def shows(self, entity_id, wanted):
        wait_for(lambda: (self.state(entity_id) or {}).get("state") == wanted)

    def call(self, service, **data):
        self.ask(call=[service, data])

    def close(self):
        self._process.stdin.close()
        try:
            self._process.wait(60)
        finally:
            self._process.kill()
            self._process.stdout.close()


@pytest.fixture
def home(tmp_path, broker):
    made = HomeAssistant(tmp_path / "ha", broker.port)
    yield made
    made.close()


@pytest.fixture(params=["components", "device"])
def discovery(request, home):
    """A form of discovery that this Home Assistant knows."""
    if request.param == "device" and home.ask(version=True) < [2024, 11]:
        pytest.skip("this Home Assistant knows no message for a whole device")
    return request.param


@pytest.fixture
def running(launch, broker):
    """Start a daemon that publishes to the broker, takes commands, and can be reloaded."""

    def begin(*, mqtt=None, **options):
        given = {"output": [f"mqtt://127.0.0.1:{broker.port}"], **options}
        given |= {"mqtt": {"commands": "always", **(mqtt or {})}}
        given |= {"reload": lambda: load_config(environ={}, options=daemon.options)}
        daemon = launch(**given)
        return daemon

    return begin


@pytest.mark.skipif(not PYTHON, reason=WITHOUT)
def test_a_house_arms_disarms_and_chooses_the_sensitivity(home, discovery, running, tmp_path):
    (tmp_path / "code").write_text("4711\n")
    mqtt = {"code_file": tmp_path / "code", "dashboard_url": "http://radar.lan:8434/"}
    mqtt["discovery"] = discovery
    daemon = running(mqtt=mqtt, alarm={"exit_delay_s": 5})
    panel = "alarm_control_panel.radar_simulated_panel"
    select = "select.radar_simulated_sensitivity"
    home.shows(panel, "armed_away")
    assert home.state(panel)["code_format"] == "number"
    home.call("alarm_control_panel.alarm_disarm", entity_id=panel, code="1234")
    home.call("alarm_control_panel.alarm_arm_home", entity_id=panel)
    home.shows(panel, "arming")
    home.shows(panel, "armed_home")
    home.call("alarm_control_panel.alarm_disarm", entity_id=panel, code="4711")
    home.shows(panel, "disarmed")
    assert daemon.panel()["armed"] is False
    home.shows(select, "normal")
    home.call("select.select_option", entity_id=select, option="high")
    home.shows(select, "high")
    wait_for(lambda: home.ask(device="radard_radar-simulated"))
    device = home.ask(device="radard_radar-simulated")
    assert (device["manufacturer"], device["model"]) == ("Novelda", "X2 (simulated)")
    assert device["configuration_url"] == "http://radar.lan:8434/"
    assert daemon.stop() == 0
    home.shows(panel, "unavailable")


@pytest.mark.skipif(not PYTHON, reason=WITHOUT)
def test_an_alarm_reaches_a_phone_with_its_picture(home, discovery, running):
    events, picture = "event.radar_simulated_event", "image.radar_simulated_last_alarm"
    alarm = {"sensitivity": "high", "latch_s": 86_400, "armed": False}
    sensor = {"port": "sim:human", "speed": "10"}
    given = {"sensor": sensor, "alarm": alarm, "mqtt": {"discovery": discovery}}
    daemon = running(model={"name": "thesis"}, **given)
    wait_for(lambda: {events, picture} <= set(home.ask(states=True)))
    given = {"radar_event": events, "radar_picture": picture, "notifier": "phone"}
    assert home.ask(blueprint=str(BLUEPRINT), input=given) is True
    daemon.radar.command("arm")
    home.shows("binary_sensor.radar_simulated_alarm", "on")
    home.shows("alarm_control_panel.radar_simulated_panel", "triggered")
    (call,) = wait_for(lambda: home.ask(calls=True))
    assert call["title"] == "Radar alarm"
    assert call["message"].startswith(("human", "undecided"))
    assert call["data"]["image"].startswith(f"/api/image_proxy/{picture}")
    assert home.state(events)["event_type"].startswith("alarm_")
    assert wait_for(lambda: base64.b64decode(home.ask(picture=picture))).startswith(b"\x89PNG")
    assert daemon.stop() == 0
    assert home.ask(calls=True) == [call]


def test_a_sensitivity_chosen_over_mqtt_outlives_a_restart(running, listen):
    listener, base = listen("radard/#"), "radard/radar-simulated"

    def shown():
        return [json.loads(body)["sensitivity"] for body in listener.on(f"{base}/state")]

    daemon = running(model={"name": "accurate"})
    wait_for(lambda: shown() and shown()[-1] == "normal")
    pipeline = daemon.radar.worker.parts.pipeline
    assert pipeline.verdict.pet_limit == 0.8
    listener.say(f"{base}/command/sensitivity", "high")
    wait_for(lambda: shown()[-1] == "high")
    # The same pipeline, so what it has learned of the room stays.
    wait_for(lambda: pipeline.verdict.pet_limit == 0.9)
    assert daemon.radar.worker.parts.pipeline is pipeline
    assert daemon.stop() == 0
    daemon = running(alarm={"exit_delay_s": 1})
    assert daemon.config.alarm.sensitivity == "high"


BASE = "radard/hall"
DEVICE = "homeassistant/device/radard_hall/config"


@pytest.fixture
def shown(publish):
    """Open a sink of a radar that is online."""

    def begin(first=None, *, radar=None, **section):
        records = (first or hello(), status("online"), decision(1))
        return publish(*records, radar=radar or well_host(), **section)

    return begin


def about(listener):
    return json.loads(wait_for(lambda: listener.on(DEVICE))[-1])


def state(listener):
    found = listener.on(f"{BASE}/state")
    return json.loads(found[-1]) if found else {}


def test_the_panel_shows_what_the_sensor_does_and_commands_it(shown, listen):
    listener, radar = listen("#"), well_host()
    heard, radar.state = radar.asked, SensorState(panel="exit", mode="home")
    shown(radar=radar)
    parts = about(listener)["cmps"]["panel"]
    assert (parts["p"], parts["stat_t"]) == ("alarm_control_panel", f"{BASE}/state")
    assert parts["sup_feat"] == ["arm_home", "arm_away"]
    assert "code" not in parts
    wait_for(lambda: state(listener).get("panel") == "arming")
    for changes, name in (
        ({"panel": "armed"}, "armed_home"),
        ({"panel": "armed", "mode": "away"}, "armed_away"),
        ({"panel": "entry"}, "pending"),
        ({"panel": "alarm"}, "triggered"),
        ({"panel": "disarmed", "armed": False}, "disarmed"),
    ):
        radar.state = replace(radar.state, **changes)
        wait_for(lambda name=name: state(listener)["panel"] == name)
    for payload in ("ARM_HOME", "ARM_AWAY", "TRIGGER", "DISARM"):
        listener.say(parts["cmd_t"], payload)
    wait_for(lambda: len(heard) == 3)
    assert heard == ["arm-home", "arm", "disarm"]


def test_a_code_is_asked_for_and_never_published(shown, listen, tmp_path, caplog):
    listener, radar = listen("#"), well_host()
    heard = radar.asked
    (tmp_path / "code").write_text("4711\n")
    shown(code_file=tmp_path / "code", radar=radar)
    parts = about(listener)["cmps"]
    assert parts["panel"]["code"] == "REMOTE_CODE"
    assert parts["panel"]["cod_dis_req"] is True
    assert parts["disarm"] == {"p": "button"}
    panel, disarm = parts["panel"]["cmd_t"], f"{BASE}/command/disarm"
    listener.say(disarm)
    for code in ("1234", ""):
        listener.say(panel, json.dumps({"action": "DISARM", "code": code}))
    listener.say(panel, json.dumps({"action": "ARM_AWAY", "code": None}))
    wait_for(lambda: heard == ["arm"])
    listener.say(panel, json.dumps({"action": "DISARM", "code": "4711"}))
    wait_for(lambda: heard == ["arm", "disarm"])
    listener.say(disarm, "4711")
    wait_for(lambda: heard == ["arm", "disarm", "disarm"])
    assert "wrong code" in caplog.text
    ours = [body for topic, body, _ in listener.messages if "/command/" not in topic]
    assert not any(b"4711" in body for body in ours)
    assert "4711" not in caplog.text


def test_wrong_codes_lock_for_a_minute(tmp_path):
    now_s = [0.0]
    (tmp_path / "code").write_text("open sesame\n")
    reader = CommandReader(MqttSection(code_file=tmp_path / "code"), now_s=lambda: now_s[0])

    def disarm(code):
        return reader.read("b/command/disarm", code, is_retained=False)

    for _ in range(5):
        with pytest.raises(ValueError, match="wrong code"):
            disarm(b"open")
    with pytest.raises(ValueError, match="too many"):
        disarm(b"open sesame")
    now_s[0] = 61.0
    assert disarm(b"open sesame") == ("disarm", "")
    with pytest.raises(ValueError, match="decode"):
        disarm(b"\xff")
    (tmp_path / "code").unlink()
    with pytest.raises(ConfigError):
        disarm(b"open sesame")


def test_sensitivity_is_chosen_and_shown(shown, listen, tmp_path):
    listener, radar = listen("#"), well_host()
    radar.held = Config(service={"state_dir": tmp_path})
    radar.state = SensorState(sensitivity="normal")
    shown(radar=radar)
    parts = about(listener)["cmps"]["sensitivity"]
    assert (parts["p"], parts["ops"]) == ("select", ["low", "normal", "high"])
    wait_for(lambda: state(listener).get("sensitivity") == "normal")
    for payload in ("deaf", "", "high"):
        listener.say(parts["cmd_t"], payload)
    wait_for(lambda: radar.n_reloads == 1)
    assert 'sensitivity: "high"' in (tmp_path / "radar.settings.yaml").read_text()
    radar.state = SensorState(sensitivity="high")
    wait_for(lambda: state(listener)["sensitivity"] == "high")


def distinct(listener, topic):
    """Payloads on a topic, each once: a busy machine loses connections and makes them again."""
    return list(dict.fromkeys(listener.on(topic)))


def put_whole(path, content, at_ns):
    """Put a file in place as clips are: nobody sees it half written."""
    new = path.with_suffix(".new")
    new.write_bytes(content)
    os.utime(new, ns=(at_ns, at_ns))
    new.replace(path)


def test_the_picture_of_an_alarm_its_final_form_and_again(shown, listen, broker, tmp_path):
    """What was on its way when the line was cut is lost, and this broker keeps nothing."""
    listener, topic = listen("#"), f"{BASE}/picture"
    sink = shown()
    parts = about(listener)["cmps"]["picture"]
    assert (parts["p"], parts["img_t"], parts["cont_type"]) == ("image", topic, "image/png")
    sink.write({**event(1), "clip": str(tmp_path / "clip.h5")})
    put_whole(tmp_path / "clip.png", b"first", 2)
    wait_for(lambda: distinct(listener, topic) == [b"first"])
    put_whole(tmp_path / "clip.png", b"whole", 1)
    wait_for(lambda: distinct(listener, topic) == [b"first", b"whole"])
    late = listen(topic)
    wait_for(lambda: distinct(late, topic) == [b"whole"])
    for each in (listener, late):
        each.close()
    broker.stop()
    wait_for(lambda: not sink.state.is_ok)
    broker.start()
    again = listen(topic)
    wait_for(lambda: distinct(again, topic) == [b"whole"])


def test_without_pictures_none_stays_at_the_broker(shown, listen, tmp_path):
    listener = listen("#")
    listener.say(f"{BASE}/picture", "of last year", retain=True)
    sink = shown(picture=False)
    assert about(listener)["cmps"]["picture"] == {"p": "image"}
    (tmp_path / "clip.png").write_bytes(b"first")
    sink.write({**event(1), "clip": str(tmp_path / "clip.h5")})
    wait_for(lambda: distinct(listener, f"{BASE}/picture") == [b"of last year", b""])
    late = listen(f"{BASE}/picture", "end")
    late.say("end")
    wait_for(lambda: late.on("end"))
    assert late.on(f"{BASE}/picture") == []


@pytest.mark.parametrize(
    ("changes", "device"),
    [
        ({"module": "X4M03"}, {"mf": "Novelda", "mdl": "X4M03"}),
        ({"module": "X2", "simulated": True}, {"mf": "Novelda", "mdl": "X2 (simulated)"}),
        ({"replayed": True}, {"mdl": "replayed"}),
        ({}, {}),
    ],
)
def test_the_device_is_the_module_and_not_its_port(shown, listen, changes, device):
    listener, link = listen("#"), "http://radar.lan:8434/"
    shown(hello(**changes), dashboard_url=link)
    found = about(listener)["dev"]
    assert found.pop("cu") == link
    assert found == {"ids": ["radard_hall"], "name": "hall", "sw": "0.1.0", **device}


@pytest.mark.parametrize(
    "payload", [b"", b"{}", b"[", b'{"action": 1}', b"{", b"\xff", b'{"a":' * 3000]
)
def test_what_is_no_command_of_a_panel(payload):
    with pytest.raises(ValueError, match=r"."):
        panel_command(payload)
