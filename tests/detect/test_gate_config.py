import pytest

from radard.config.config import Config, load_config
from radard.config.sections import GateSection, GateSettings
from radard.errors import ConfigError
from radard.pipeline import Pipeline
from tests.radar_helpers import BASEBAND
from x2radar.frame import StreamInfo

KEYS = {
    "false_alarms_per_day": 0.5,
    "adapt_db": 30.0,
    "memory_s": 90.0,
    "learn_s": 30.0,
    "in_place_m": 0.3,
    "floor_rate_db_per_s": 0.25,
}


def test_every_key_reaches_the_gate():
    assert set(KEYS) == set(GateSettings.model_fields)
    pipeline = Pipeline(StreamInfo(BASEBAND, 60.0, "test"), Config(gate=GateSection(**KEYS)))
    settings = pipeline._gate._settings
    assert {key: getattr(settings, key) for key in KEYS} == KEYS


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{floor_rate_db_per_s: -1}", "gate.floor_rate_db_per_s"),
        ("{false_alarms_per_day: perhaps}", "gate.false_alarms_per_day"),
        ("{false_alarms_per_day: 0}", "gate.false_alarms_per_day"),
    ],
)
def test_faults_are_told(tmp_path, text, words):
    path = tmp_path / "config.yaml"
    path.write_text(f"gate: {text}")
    with pytest.raises(ConfigError, match=words):
        load_config(path, environ={})
