"""YAML, calibrations and kept state that make no sense, or stand for more than they are."""

import pickle

import pytest

from campaigns.fuzz_targets import TARGETS
from radard.alarm.sensor_state import StateStore
from radard.config.config import load_config
from radard.detect.calibration import load_calibration
from radard.errors import ConfigError, RadardError
from radard.log import EventLog
from x2radar.errors import SceneError, SettingsError, X2RadarError
from x2radar.sim.scene.scene import load_scene


def laughs(last):
    """Lists of four aliases of the list before, from the anchor `a` on."""
    return "".join(
        f"  - &{chr(k + 1)} [{', '.join([f'*{chr(k)}'] * 4)}]\n" for k in range(97, last)
    )


@pytest.mark.parametrize(
    "text",
    [
        "steps:\n- body: human\n  duration_s:\n  - &a [x, x]\n" + laughs(121),
        "? &a [*a]\n: 1\n",
        "steps: " + "[" * 600,
        "steps: [{duration_s: 1" + ":1" * 6000 + "}]\n",
        "a: &a {b: 1}\nsteps: [{<<: [" + "*a, " * 20_000 + "*a]}]\n",
        "steps: !!binary 1\n",
        "steps: !!python/object/apply:os.system [true]\n",
        "steps: [{body: human, course: {a: 1}}]\n",
        "steps: [{body: human, duration_s: [[[1]], 2]}]\n",
        "like: [dog]\n",
        "x: 1\n" * 100_000,
    ],
)
def test_yaml_that_stands_for_more_than_it_is(tmp_path, text):
    path = tmp_path / "a.yaml"
    path.write_text(text)
    with pytest.raises(SceneError) as scene:
        load_scene(str(path))
    with pytest.raises(ConfigError) as config:
        load_config(path, environ={})
    for caught in (scene, config):
        assert len(str(caught.value)) <= 2000
        assert str(path) in str(caught.value)


def test_messages_stay_short_whatever_they_quote(tmp_path):
    """Found by fuzzing: a message was as long as the file made it."""
    path = tmp_path / "a.yaml"
    for text in (
        "output:\n  - &a [x, x]\n" + laughs(103),
        "".join(f"key{k}: 1\n" for k in range(3000)),
        "k" * 5000 + ": 1\n",
    ):
        path.write_text(text)
        with pytest.raises(ConfigError) as config:
            load_config(path, environ={})
        assert len(str(config.value)) <= 2000
        assert str(config.value).startswith(str(path))
    for kind in (X2RadarError, RadardError, SettingsError):
        long = kind("begin " + "x" * 9000 + " end")
        assert str(long).startswith("begin x")
        assert str(long).endswith("x end")
        assert " ... " in str(long)
        assert len(str(long)) == 2000
        assert str(pickle.loads(pickle.dumps(long))) == str(long)  # noqa: S301 - our own
        assert str(kind("a" * 2000)) == "a" * 2000


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("2026-02-01T12:00:00Z", "9" * 5000),
        ("60.0", "1" + "0" * 400),
        ("60.0", "[" * 3000 + "]" * 3000),
        ("-60.0", "1e300"),
        ('"provenance"', "9"),
        ("600", '"' + "x" * 5000 + '"'),
        ("2026-02-01T12:00:00Z", "9999-99-99"),
    ],
)
def test_calibrations_that_make_no_sense(tmp_path, before, after):
    text = TARGETS["calibration"].seeds(tmp_path)[1].decode()
    assert before in text
    (tmp_path / "a.json").write_text(text.replace(before, after, 1))
    with pytest.raises(ConfigError) as caught:
        load_calibration(tmp_path / "a.json")
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize(
    "text",
    [
        '{"is_armed": true, "alarm_peak": 1' + "0" * 400 + "}",
        '{"is_armed": true, "alarm_peak": ' + "[" * 3000 + "]" * 3000 + "}",
        "[" * 100_000,
        "7",
        '{"is_armed": true, "alarm_peak": {}}',
    ],
)
def test_kept_state_that_makes_no_sense_is_not_used(caplog, text):
    log = EventLog(None)
    log.keep("panel radar", text)
    kept = StateStore(log, "radar").load(is_armed=True)
    assert (kept.is_armed, kept.alarm_id) == (True, None)
    assert "unreadable and not used" in caplog.text
