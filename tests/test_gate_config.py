import pytest

from radard.config.config import Config, load_config
from radard.config.sections import GateSection
from radard.detect.gate import GateSettings
from radard.errors import ConfigError
from radard.pipeline import Pipeline
from tests.radar_helpers import BASEBAND
from x2radar.frame import StreamInfo

KEYS = {
    "threshold_db": 7.0,
    "adapt_db": 30.0,
    "memory_s": 90.0,
    "learn_s": 30.0,
    "in_place_m": 0.3,
    "floor_rate_db_per_s": 0.25,
    "adaptive": True,
    "least_db": 4.0,
    "most_db": 12.0,
    "threshold_rate_db_per_s": 0.02,
}


def gate_settings(section):
    pipeline = Pipeline(StreamInfo(BASEBAND, 60.0, "test"), Config(gate=section))
    return pipeline._gate._settings


def test_every_key_reaches_the_gate():
    # The calibration is no setting of the gate but a file of its own, and so is its making.
    others = {"calibration", "calibrate_s", "calibrate_after_s"}
    assert set(KEYS) == set(GateSection.model_fields) - others
    wanted = {**KEYS, "is_adaptive": KEYS["adaptive"]}
    del wanted["adaptive"]
    assert gate_settings(GateSection(**KEYS)) == GateSettings(**wanted)


def test_built_in_values_are_those_of_the_gate():
    assert gate_settings(GateSection()) == GateSettings()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{least_db: 9, most_db: 8}", "gate: least_db cannot be more than most_db"),
        ("{adaptive: true, threshold_db: 20}", "begin between least_db and most_db"),
        ("{adaptive: true, threshold_db: 2}", "begin between least_db and most_db"),
        ("{threshold_rate_db_per_s: 0}", "gate.threshold_rate_db_per_s"),
        ("{floor_rate_db_per_s: -1}", "gate.floor_rate_db_per_s"),
        ("{adaptive: perhaps}", "gate.adaptive"),
    ],
)
def test_faults_are_told(tmp_path, text, words):
    path = tmp_path / "config.yaml"
    path.write_text(f"gate: {text}")
    with pytest.raises(ConfigError, match=words):
        load_config(path, environ={})
