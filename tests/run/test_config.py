from pathlib import Path

import pytest

from radard.config.config import Config, load_config
from radard.errors import ConfigError

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def write(text, name="config.yaml"):
    path = Path(name)
    path.write_text(text)
    return path


def test_built_in_values_without_any_file():
    assert load_config(environ={}) == Config()


def test_the_documented_default_is_the_built_in_one():
    assert load_config(ROOT / "config.yaml", environ={}) == Config()


def test_order_file_environment_options():
    write("gate: {false_alarms_per_day: 5, adapt_db: 1}\nmodel: {name: a}\n")
    environ = {"RADARD_GATE__ADAPT_DB": "2", "RADARD_MODEL__NAME": "b", "OTHER": "x"}
    config = load_config(environ=environ, options={"model": {"name": "c"}, "output": ["null"]})
    assert config.gate.false_alarms_per_day == 5
    assert config.gate.adapt_db == 2
    assert config.model.name == "c"
    assert config.output == ("null",)


def test_named_file_wins_over_the_one_that_lies_here():
    write("model: {name: here}")
    other = write("model: {name: there}", "other.yaml")
    assert load_config(other, environ={}).model.name == "there"
    assert load_config(environ={}).model.name == "here"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "gate:\n  false_alarm_per_day: 3\n",
            "config.yaml:2: unknown key 'gate.false_alarm_per_day'; "
            "did you mean 'false_alarms_per_day'",
        ),
        ("gates: {}\n", "config.yaml:1: unknown key 'gates'; did you mean 'gate'"),
        ("\nmodel:\n  xyzzy: 1\n", "config.yaml:3: unknown key 'model.xyzzy'; known: name"),
        ("gate: {false_alarms_per_day: high}", "config.yaml:1: gate.false_alarms_per_day"),
        ("gate: {false_alarms_per_day: -1}", "greater than 0"),
        ("decision: {pet_limit: 0.2}", "decision.pet_limit"),
        ("sensor: {name: 'a b'}", "sensor.name"),
        ("gate: 3", "config.yaml:1: gate"),
        ("- 1", "mapping of sections"),
        ("a: [", "not YAML"),
    ],
)
def test_faults_name_their_place(text, words):
    write(text)
    with pytest.raises(ConfigError) as caught:
        load_config(environ={})
    assert words in str(caught.value)
    assert caught.value.exit_code == 78


def test_all_faults_at_once():
    write("gate: {false_alarm_per_day: 1}\nmodle: {}\n")
    with pytest.raises(ConfigError, match=r"false_alarm_per_day.*modle"):
        load_config(environ={})


def test_environment_faults_name_the_variable():
    with pytest.raises(ConfigError, match="RADARD_GATE__THRESHOLD: unknown key"):
        load_config(environ={"RADARD_GATE__THRESHOLD": "3"})


@pytest.mark.parametrize("name", ["gone.yaml", "."])
def test_a_named_file_must_be_readable(name):
    with pytest.raises(ConfigError, match="cannot read"):
        load_config(Path(name), environ={})


def test_empty_file_is_fine():
    write("")
    assert load_config(environ={}) == Config()
