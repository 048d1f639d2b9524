"""Settings and zones from the dashboard: saved, taken up at once, there after a restart."""

import gzip
from dataclasses import replace

import numpy as np
import pytest

from radard.clips.spectrogram_png import encode_png
from radard.commands.config import shown
from radard.config import saved as saved_module
from radard.config.config import Config, load_config, load_with_origins
from radard.config.directories import saved_file
from radard.config.saved import change, forget
from radard.detect.calibration import Calibration, restless_spans
from radard.errors import ConfigError
from tests.dashboard_helpers import post
from tests.device_helpers import in_thread
from tests.waiting import wait_for
from tests.web_helpers import ULID, decision, event


def settings_file(client):
    return client.run.held.service.state_dir / "radar.sim.settings.yaml"


def test_variables_and_options_stand_before_what_was_saved(client, tmp_path):
    assert post(client, "/api/v1/settings", {"alarm": {"sensitivity": "low"}}).status_code == 202
    assert settings_file(client).is_file()
    base = {"service": {"state_dir": tmp_path}, "sensor": {"port": "sim:empty"}}
    assert load_config(environ={}, options=base).alarm.sensitivity == "low"
    environ = {"RADARD_ALARM__SENSITIVITY": "high"}
    assert load_config(environ=environ, options=base).alarm.sensitivity == "high"
    given = base | {"alarm": {"sensitivity": "high"}}
    assert load_config(environ={}, options=given).alarm.sensitivity == "high"


def test_changes_from_two_threads_at_once_are_all_kept(tmp_path):
    path = tmp_path / "radar.settings.yaml"

    def set_often(section, key, values):
        for value in values:
            change(path, "settings", {section: {key: value}})

    pages = ("alarm", "entry_delay_s", range(1, 41)), ("alarm", "sensitivity", ["high"] * 40)
    others = [in_thread(set_often, *each) for each in pages]
    set_often("mount", "height_m", [n / 10 for n in range(1, 41)])
    for each in others:
        each.join(60)
    text = path.read_text()
    for line in ("entry_delay_s: 40.000", 'sensitivity: "high"', "height_m: 4.000"):
        assert line in text


def test_what_is_forgotten_while_another_page_saves_stays_so(tmp_path, gate, monkeypatch):
    path = tmp_path / "radar.settings.yaml"
    change(path, "settings", {"alarm": {"sensitivity": "high"}})
    gate.before(monkeypatch, saved_module, "write_atomically")
    gate.shut()
    saves = in_thread(change, path, "settings", {"mount": {"height_m": 2.0}})
    wait_for(lambda: gate.n_before)
    forgets = in_thread(forget, path)
    forgets.join(0.3)
    gate.open()
    saves.join(60)
    forgets.join(60)
    assert not path.exists()


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"alarm": {"sensitivity": "huge"}}, "sensitivity"),
        ({"alarm": {"entry_delay_s": 1e9}}, "less than or equal to 600"),
        ({"alarm": {"quiet": ["00:00-24:00"]}}, "unknown key 'alarm.quiet'; known: sensitivity"),
        ({"output": {"x": 1}}, "unknown key 'output'"),
        ({"alarm": []}, "alarm: must be a section"),
        ({"include": []}, "zones.exclude: field required"),
        ({"include": [[2, 1]], "exclude": []}, "from below to"),
        ({"include": [[1, 1.001]], "exclude": []}, "at least 0.01 m"),
        ({"include": [[1, "x"]], "exclude": []}, "zones.include.0.1"),
        ({"include": [[k, k + 1] for k in range(33)], "exclude": []}, "more than 32"),
        ({"include": [[True, 2]], "exclude": []}, "zones.include.0.0: input should be a valid"),
        ({"alarm": {"entry_delay_s": True}}, "alarm.entry_delay_s: input should be a valid num"),
        ({"mount": {"height_m": "5 m"}}, "mount.height_m: input should be a valid num"),
    ],
)
def test_what_may_not_be_set_is_refused_and_nothing_is_written(client, body, words):
    answer = post(client, f"/api/v1/{'zones' if 'include' in body else 'settings'}", body)
    assert answer.status_code == 400
    assert words in answer.json()["error"]
    assert not list(settings_file(client).parent.glob("*.yaml"))


def test_a_file_of_settings_that_was_tampered_with_is_named(client, tmp_path):
    path = settings_file(client)
    path.write_text("output:\n  - exec:/bin/sh\n")
    answer = post(client, "/api/v1/settings", {"alarm": {"sensitivity": "low"}})
    assert answer.status_code == 507
    assert "not the settings that the dashboard saves; take it away" in answer.json()["error"]
    # It is taken away by forgetting.
    assert post(client, "/api/v1/settings", {"forget": True}).status_code == 202
    assert not path.exists()


def test_the_calibration_is_told_with_its_restless_ranges_where_there_is_one(client, tmp_path):
    assert client.get("/api/v1/calibration").json() is None
    floor_db, threshold_db = np.full(40, -60.0), np.full(40, 3.0)
    # A fan at 1.6 to 2.1 m, with a bin between that is calm; one bin that is not enough.
    floor_db[[10, 11, 13, 14]], threshold_db[30] = -45.0, 12.0
    axis = {"frame_rate_hz": 60.0, "bin_length_m": 0.1, "range_offset_m": 0.6}
    calibration = Calibration(**axis, floor=10 ** (floor_db / 10), threshold_db=threshold_db)
    calibration.save(tmp_path / "radar.sim.calibration.json")
    assert client.get("/api/v1/calibration").json()["restless"] == [[1.6, 2.1]]
    nothing = replace(calibration, floor=np.zeros(40), threshold_db=np.full(40, 3.0))
    assert restless_spans(nothing) == []


def test_an_alarm_links_to_the_decision_it_began_with(client):
    for seq in range(1, 5):
        client.tell(decision(seq, float(seq)))
    client.tell(event(start_t_s=4.0, t_s=4.0))
    # An hour and more later.
    for seq in range(5, 3700):
        client.tell(decision(seq, float(seq)))
    (found,) = client.get("/api/v1/events").json()["events"]
    assert found["why"] == 4
    assert client.get("/api/v1/decisions/4").json()["decision"]["seq"] == 4
    assert client.get("/api/v1/decisions/5").status_code == 404
    other = "01J0000000000000000000000B"
    client.tell(event(other, start_t_s=9.0, t_s=9.0))
    found = client.get(f"/api/v1/events?text={other}").json()["events"]
    assert found[0]["why"] is None


def test_a_thumbnail_with_its_axes(client, tmp_path):
    clip = tmp_path / f"{ULID}.h5"
    clip.write_bytes(b"")
    client.tell(event(clip=str(clip)))
    path = f"/api/v1/events/{ULID}/thumbnail"
    assert client.get(path).status_code == 404
    assert client.get("/api/v1/events").json()["events"][0]["has_picture"] is False
    axes = {"velocity_mps": [-0.7, 0.7], "range_m": [0.6, 3.4], "length_s": 12.0}
    png = clip.with_suffix(".png")
    png.write_bytes(encode_png(np.zeros((40, 60, 3), np.uint8), axes))
    assert client.get("/api/v1/events").json()["events"][0]["has_picture"] is True
    answer = client.get(path).json()
    assert answer["axes"] == axes
    assert answer["png"].startswith("data:image/png;base64,iVBOR")
    png.write_bytes(b"no picture")
    assert client.get(path).status_code == 422


def test_files_of_the_pages_are_packed_for_those_who_ask(client):
    plain = client.get("/static/pages/live.js")
    packed = client.get("/static/pages/live.js", {"Accept-Encoding": "gzip, br"})
    assert packed.headers["content-encoding"] == "gzip"
    assert gzip.decompress(packed.content) == plain.content
    assert len(packed.content) < len(plain.content) / 2
    kept = {"Accept-Encoding": "gzip", "If-None-Match": packed.headers["etag"]}
    assert client.get("/static/pages/live.js", kept).status_code == 304
    worker = client.get("/sw.js")
    assert worker.headers["content-type"].startswith("text/javascript")
    assert worker.content == client.get("/static/sw.js").content


@pytest.fixture
def run(launched, tmp_path):
    """A daemon before an empty room, whose configuration has a zone of its own."""
    (tmp_path / "config.yaml").write_text("zones: {include: [[0.5, 5.0]]}\n")
    argv = ("--port", "sim:empty", "--model", "none", "--config", str(tmp_path / "config.yaml"))
    return lambda: launched(*argv).wait_online()


def save_zones(path, include, exclude):
    change(path, "zones", {"zones": {"include": include, "exclude": exclude}})


@pytest.mark.integration
def test_saved_zones_hold_at_once_and_after_a_restart(run, tmp_path):
    running = run()
    wanted = {"include": [], "exclude": [[1.2, 1.9], [3.0, 4.25]], "away": [[0.5, 0.8]]}
    assert running.post("/api/v1/zones", wanted)[0] == 202
    running.wait(lambda: running.status()["zones"] == wanted)
    assert running.status()["has_saved_zones"] is True
    before = running.status()["panel"]["seq"]
    running.wait(lambda: running.status()["panel"]["seq"] > before)
    assert running.end() == 0
    again = run()
    assert again.status()["zones"] == wanted
    # What is in the file of the configuration holds again once they are forgotten.
    assert again.post("/api/v1/zones", {"forget": True})[0] == 202
    own = {"include": [[0.5, 5.0]], "exclude": [], "away": []}
    again.wait(lambda: again.status()["zones"] == own)
    assert again.status()["has_saved_zones"] is False
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
    running.wait(lambda: running.status()["zones"] == wanted)
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
        return next(line for line in shown(*load(tmp_path, **environ)) if "  include" in line)

    assert "[[1.0, 2.5]]" in told()
    assert told().endswith(f"# {saved}:3, saved on the dashboard")
    assert told(RADARD_ZONES__INCLUDE="[[3, 4]]").endswith("# RADARD_ZONES__INCLUDE")
    assert load(tmp_path)[0].zones.exclude == ()
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
    with pytest.raises(NotADirectoryError):
        save_zones(tmp_path / "file" / "x.zones.yaml", [], [])
    with pytest.raises(IsADirectoryError):
        forget(tmp_path)


def test_numbers_come_back_as_they_were(tmp_path):
    save_zones(tmp_path / "radar.zones.yaml", [(0.0, 0.011), (0.1, 999.0)], [(1.2345, 2)])
    (tmp_path / "c.yaml").write_text("{}")
    zones = load(tmp_path)[0].zones
    assert (zones.include, zones.exclude) == (((0.0, 0.011), (0.1, 999.0)), ((1.234, 2.0),))
