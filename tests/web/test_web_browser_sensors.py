"""The dashboard of several radars in a real browser: whose page it is, and calibrating one."""

import json

import pytest
import yaml

from tests.browser_helpers import MARKS, Tab
from tests.web_helpers import Running

pytestmark = MARKS


@pytest.fixture
def radard(tmp_path):
    """Two simulated rooms, both empty, as fast as they are judged: no frame is lost for haste."""
    config = tmp_path / "house.yaml"
    sensors = {name: {"port": "sim:empty", "speed": "max"} for name in ("hall", "attic")}
    gate = {"calibrate_after_s": 30, "calibrate_s": 60}
    text = {"sensors": sensors, "model": {"name": "none"}, "gate": gate}
    config.write_text(yaml.safe_dump(text, sort_keys=False))
    running = Running(tmp_path, "--config", str(config))
    running.wait(lambda: running.get("/sensor/attic/healthz")[0] == 200)
    yield running
    assert running.end() == 0


def test_one_sensor_is_chosen_and_commanded_and_the_other_is_left_alone(browser, radard, tmp_path):
    tab = Tab(browser, radard)
    page = tab.open("live").page
    assert page.locator("#sensor option").all_inner_texts() == ["hall", "attic"]
    page.select_option("#sensor select", label="attic")
    page.wait_for_url("**/sensor/attic/**")
    tab.until("document.querySelector('#sensor option')?.textContent === 'attic'")
    page.goto(f"{radard.base}/sensor/attic/#/setup")
    page.get_by_role("button", name="Calibrate the empty room").click()
    tab.until("document.body.textContent.includes('Leave the room now')")
    tab.until("document.body.textContent.includes('Listening to the empty room')")
    tab.until("document.body.textContent.includes('predicted false gates')")
    radard.wait((tmp_path / "attic.sim.calibration.json").exists)
    assert not (tmp_path / "hall.sim.calibration.json").exists()
    page.goto(f"{radard.base}/sensor/attic/#/live")
    code, status = radard.get("/api/v1/status")
    assert (code, status["sensor"], status["panel"]["calibration"]) == (200, "hall", None)
    file = tmp_path / "attic.status.json"
    radard.wait(lambda: json.loads(file.read_text())["calibration"]["phase"] == "made")
    page.close()
    assert tab.complaints == []
