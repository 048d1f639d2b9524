"""Settings, a test alarm and what helps to choose: the routes behind the set-up page."""

import gzip
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from radard.clips.spectrogram_png import encode_png
from radard.config.config import load_config
from radard.config.saved import change
from radard.detect.calibration import Calibration, restless_spans
from tests.dashboard_helpers import post
from tests.web_helpers import decision, event

ULID = "01J0000000000000000000000A"


def settings_file(client):
    return client.run.held.service.state_dir / "radar.sim.settings.yaml"


def test_variables_and_options_stand_before_what_was_saved(make, tmp_path):
    client = make()
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
    numbers = list(range(1, 41))

    def on_the_page():
        for n in numbers:
            change(path, "settings", {"alarm": {"entry_delay_s": n}})

    def over_mqtt():
        for _ in numbers:
            change(path, "settings", {"alarm": {"sensitivity": "high"}})

    others = [threading.Thread(target=each) for each in (on_the_page, over_mqtt)]
    for each in others:
        each.start()
    for n in numbers:
        change(path, "settings", {"mount": {"height_m": n / 10}})
    for each in others:
        each.join()
    text = path.read_text()
    for line in ("entry_delay_s: 40.000", 'sensitivity: "high"', "height_m: 4.000"):
        assert line in text


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
    ],
)
def test_what_may_not_be_set_is_refused_and_nothing_is_written(make, body, words):
    client = make()
    answer = post(client, f"/api/v1/{'zones' if 'include' in body else 'settings'}", body)
    assert answer.status_code == 400
    assert words in answer.json()["error"]
    assert not list(settings_file(client).parent.glob("*.yaml"))


def test_a_file_of_settings_that_was_tampered_with_is_named(make, tmp_path):
    client = make()
    path = settings_file(client)
    path.write_text("output:\n  - exec:/bin/sh\n")
    answer = post(client, "/api/v1/settings", {"alarm": {"sensitivity": "low"}})
    assert answer.status_code == 507
    assert "not the settings that the dashboard saves; take it away" in answer.json()["error"]
    # It is taken away by forgetting.
    assert post(client, "/api/v1/settings", {"forget": True}).status_code == 202
    assert not path.exists()


def test_the_calibration_is_told_with_its_restless_ranges_where_there_is_one(make, tmp_path):
    client = make()
    assert client.get("/api/v1/calibration").json() is None
    floor_db, threshold_db = np.full(40, -60.0), np.full(40, 3.0)
    # A fan at 1.6 to 2.1 m, with a bin between that is calm; one bin that is not enough.
    floor_db[[10, 11, 13, 14]], threshold_db[30] = -45.0, 12.0
    calibration = Calibration(
        frame_rate_hz=60.0,
        bin_length_m=0.1,
        range_offset_m=0.6,
        floor=10 ** (floor_db / 10),
        threshold_db=threshold_db,
    )
    calibration.save(tmp_path / "radar.sim.calibration.json")
    assert client.get("/api/v1/calibration").json()["restless"] == [[1.6, 2.1]]
    nothing = replace(calibration, floor=np.zeros(40), threshold_db=np.full(40, 3.0))
    assert restless_spans(nothing) == []


def test_an_alarm_links_to_the_decision_it_began_with(make):
    client = make()
    for seq in range(1, 5):
        client.tell(decision(seq, float(seq)))
    client.tell(event(ULID, start_t_s=4.0, t_s=4.0))
    # An hour and more later.
    for seq in range(5, 3700):
        client.tell(decision(seq, float(seq)))
    (found,) = client.get("/api/v1/events").json()["events"]
    assert found["why"] == 4
    why = client.get("/api/v1/decisions/4").json()
    assert why["decision"]["seq"] == 4
    assert client.get("/api/v1/decisions/5").status_code == 404
    other = "01J0000000000000000000000B"
    client.tell(event(other, start_t_s=9.0, t_s=9.0))
    found = client.get(f"/api/v1/events?text={other}").json()["events"]
    assert found[0]["why"] is None


def test_a_thumbnail_with_its_axes(make, tmp_path):
    client = make()
    clip = tmp_path / f"{ULID}.h5"
    clip.write_bytes(b"")
    client.tell(event(ULID, clip=str(clip)))
    path = f"/api/v1/events/{ULID}/thumbnail"
    assert client.get(path).status_code == 404
    assert client.get("/api/v1/events").json()["events"][0]["has_picture"] is False
    axes = {"velocity_mps": [-0.7, 0.7], "range_m": [0.6, 3.4], "length_s": 12.0}
    picture = np.zeros((40, 60, 3), np.uint8)
    Path(clip).with_suffix(".png").write_bytes(encode_png(picture, axes))
    assert client.get("/api/v1/events").json()["events"][0]["has_picture"] is True
    answer = client.get(path).json()
    assert answer["axes"] == axes
    assert answer["png"].startswith("data:image/png;base64,iVBOR")
    Path(clip).with_suffix(".png").write_bytes(b"no picture")
    assert client.get(path).status_code == 422


def test_files_of_the_pages_are_packed_for_those_who_ask(make):
    client = make()
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
