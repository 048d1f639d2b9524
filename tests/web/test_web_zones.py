"""Zones from the dashboard: saved, taken up at once, there after a restart, and said whose."""

import json

import pytest

from radard.commands.config import shown
from radard.config.config import Config, load_with_origins
from radard.config.directories import saved_file
from radard.config.saved import change, forget
from radard.errors import ConfigError, OutputError
from tests.waiting import wait_for


@pytest.fixture
def run(launched, tmp_path):
    """A daemon before an empty room, whose configuration has a zone of its own."""
    (tmp_path / "config.yaml").write_text("zones: {include: [[0.5, 5.0]]}\n")
    argv = ("--port", "sim:empty", "--model", "none", "--config", str(tmp_path / "config.yaml"))
    return lambda: launched(*argv).wait_online()


def zones_now(running):
    return running.get("/api/v1/status")[1]["zones"]


def save_zones(path, include, exclude):
    change(path, "zones", {"zones": {"include": include, "exclude": exclude}})


@pytest.mark.integration
def test_saved_zones_hold_at_once_and_after_a_restart(run, tmp_path):
    running = run()
    wanted = {"include": [], "exclude": [[1.2, 1.9], [3.0, 4.25]], "away": [[0.5, 0.8]]}
    assert running.post("/api/v1/zones", wanted)[0] == 202
    running.wait(lambda: zones_now(running) == wanted)
    assert running.get("/api/v1/status")[1]["has_saved_zones"] is True
    before = running.get("/api/v1/status")[1]["panel"]["seq"]
    running.wait(lambda: running.get("/api/v1/status")[1]["panel"]["seq"] > before)
    assert running.end() == 0
    again = run()
    assert zones_now(again) == wanted
    # What is in the file of the configuration holds again once they are forgotten.
    assert again.post("/api/v1/zones", {"forget": True})[0] == 202
    again.wait(lambda: zones_now(again) == {"include": [[0.5, 5.0]], "exclude": [], "away": []})
    assert again.get("/api/v1/status")[1]["has_saved_zones"] is False
    assert not (tmp_path / "radar.sim.zones.yaml").exists()


@pytest.mark.integration
def test_zones_are_saved_although_an_output_cannot_be_made_again_and_it_goes_on(
    launched, tmp_path, broker, listen
):
    listener, file = listen("radard/#"), tmp_path / "config.yaml"
    file.write_text("{}\n")
    argv = ("--port", "sim:empty", "--model", "none", "--config", str(file))
    running = launched(*argv, "-o", f"mqtt://127.0.0.1:{broker.port}").wait_online()

    def last(name):
        return listener.on(f"radard/radar-simulated/{name}")[-1]

    wait_for(lambda: listener.on("radard/radar-simulated/availability"))
    wait_for(lambda: last("availability") == b"online")
    # To save zones reads all of the configuration again, and so this mistake.
    file.write_text("mqtt: {username: u, password_file: /nowhere/words}\n")
    wanted = {"include": [], "exclude": [[1.2, 1.9]], "away": []}
    assert running.post("/api/v1/zones", wanted)[0] == 202
    running.wait(lambda: zones_now(running) == wanted)
    running.wait(lambda: b"mqtt.password_file" in last("health"))
    assert last("availability") == b"online"


def load(tmp_path, **environ):
    options = {"service": {"state_dir": tmp_path}}
    return load_with_origins(tmp_path / "c.yaml", environ=environ, options=options)


@pytest.fixture
def saved(tmp_path):
    """The file of a real sensor's zones, and a configuration beside it."""
    (tmp_path / "c.yaml").write_text("zones:\n  include: [[0.5, 5.0]]\n  exclude: [[2, 3]]\n")
    path = tmp_path / "radar.zones.yaml"
    save_zones(path, [(1.0, 2.5)], [])
    return path


def test_config_show_says_where_zones_came_from(saved, tmp_path):
    def told(**environ):
        return next(line for line in shown(load(tmp_path, **environ)) if "  include" in line)

    assert "[[1.0, 2.5]]" in told()
    assert told().endswith(f"# {saved}:3, saved on the dashboard")
    assert told(RADARD_ZONES__INCLUDE="[[3, 4]]").endswith("# RADARD_ZONES__INCLUDE")
    assert load(tmp_path).config.zones.exclude == ()
    forget(saved)
    assert told().endswith(f"# {tmp_path / 'c.yaml'}:2")
    forget(saved)


@pytest.mark.parametrize(
    ("port", "name"),
    [
        (None, "hall.zones.yaml"),
        ("/dev/ttyACM0", "hall.zones.yaml"),
        ("sim:human", "hall.sim.zones.yaml"),
        ("replay:night.h5", "hall.sim.zones.yaml"),
    ],
)
def test_a_simulated_sensor_has_zones_of_its_own(port, name, tmp_path):
    config = Config(sensor={"name": "hall"}, service={"state_dir": tmp_path})
    assert saved_file(config, "zones", {}, port=port) == tmp_path / name


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("zones: {inside: []}\n", "not the zones that the dashboard saves"),
        ("zones: {include: [[2, 1]]}\n", "must be [from, to] in metres"),
        ("zones: {include: [", "not YAML"),
    ],
)
def test_a_file_that_was_tampered_with_is_named(saved, tmp_path, text, words):
    saved.write_text(text)
    with pytest.raises(ConfigError, match=r"radar\.zones\.yaml") as caught:
        load(tmp_path)
    assert words in str(caught.value)


def test_a_folder_that_takes_nothing_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be kept"):
        save_zones(tmp_path / "file" / "x.zones.yaml", [], [])
    with pytest.raises(OutputError, match="cannot be taken away"):
        forget(tmp_path)


def test_numbers_come_back_as_they_were(tmp_path):
    path = tmp_path / "radar.zones.yaml"
    save_zones(path, [(0.0, 0.011), (0.1, 999.0)], [(1.2345, 2)])
    (tmp_path / "c.yaml").write_text("{}")
    zones = load(tmp_path).config.zones
    assert json.loads(zones.model_dump_json()) == {
        "include": [[0.0, 0.011], [0.1, 999.0]],
        "exclude": [[1.234, 2.0]],
        "away": [],
    }
