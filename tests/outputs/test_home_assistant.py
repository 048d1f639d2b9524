"""A Home Assistant core, a broker and the daemon, all real; and what deploy/ holds for it."""

import base64
import json
import os
import subprocess
from pathlib import Path

import pytest

from radard.config.config import load_config
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
        self._process = subprocess.Popen(
            [PYTHON, str(PROBE), str(folder), str(port)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

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
    event, picture = "event.radar_simulated_event", "image.radar_simulated_last_alarm"
    alarm = {"sensitivity": "high", "latch_s": 86_400, "armed": False}
    sensor = {"port": "sim:human", "speed": "10"}
    daemon = running(
        sensor=sensor, model={"name": "thesis"}, alarm=alarm, mqtt={"discovery": discovery}
    )
    wait_for(lambda: {event, picture} <= set(home.ask(states=True)))
    given = {"radar_event": event, "radar_picture": picture, "notifier": "phone"}
    assert home.ask(blueprint=str(BLUEPRINT), input=given) is True
    daemon.radar.command("arm")
    home.shows("binary_sensor.radar_simulated_alarm", "on")
    home.shows("alarm_control_panel.radar_simulated_panel", "triggered")
    (call,) = wait_for(lambda: home.ask(calls=True))
    assert call["title"] == "Radar alarm"
    assert call["message"].startswith(("human", "undecided"))
    assert call["data"]["image"].startswith(f"/api/image_proxy/{picture}")
    assert home.state(event)["event_type"].startswith("alarm_")
    png = wait_for(lambda: base64.b64decode(home.ask(picture=picture)))
    assert png.startswith(b"\x89PNG")
    assert daemon.stop() == 0
    assert home.ask(calls=True) == [call]


def test_a_sensitivity_chosen_over_mqtt_outlives_a_restart(running, listen):
    listener, base = listen("radard/#"), "radard/radar-simulated"

    def shown():
        return [json.loads(body)["sensitivity"] for body in listener.on(f"{base}/state")]

    daemon = running(model={"name": "accurate"})
    wait_for(lambda: shown() and shown()[-1] == "normal")
    pipeline = daemon.radar.parts.pipeline
    assert pipeline.verdict.pet_limit == 0.8
    listener.say(f"{base}/command/sensitivity", "high")
    wait_for(lambda: shown()[-1] == "high")
    # The same pipeline, so what it has learned of the room stays.
    wait_for(lambda: pipeline.verdict.pet_limit == 0.9)
    assert daemon.radar.parts.pipeline is pipeline
    assert daemon.stop() == 0
    daemon = running(alarm={"exit_delay_s": 1})
    assert daemon.config.alarm.sensitivity == "high"
