import os
from pathlib import Path

import pytest

from radard.commands.config import run as run_config
from radard.commands.setup.files import first_config
from radard.config.config import Config, load_config
from radard.config.credentials import read_secret
from radard.config.directories import state_dir
from radard.config.sink_table import named_file
from radard.errors import ConfigError

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def write(text, name="config.yaml"):
    path = Path(name)
    path.write_text(text)
    return path


def test_built_in_values_without_a_file_with_an_empty_one_and_with_the_documented_one():
    assert load_config(environ={}) == Config()
    write("")
    assert load_config(environ={}) == Config()
    assert load_config(ROOT / "config.yaml", environ={}) == Config()


@pytest.mark.parametrize("nothing", ["", "  # a line\n", "~", "null"])
def test_a_heading_with_nothing_below_it_changes_nothing(nothing):
    """As where somebody has made comments of all lines below it."""
    headings = ["output", "sensors", "gate", "alarm", "mqtt"]
    write("".join(f"{name}: {nothing}\n" for name in headings))
    assert load_config(environ={}) == Config()
    write(f"alarm:\n  quiet: {nothing}\nzones:\n  include: {nothing}\n")
    assert load_config(environ={}) == Config()
    assert load_config(environ={"RADARD_OUTPUT": "", "RADARD_GATE": ""}) == Config()


def test_a_tilde_is_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    write("service: {state_dir: ~/state}\nmqtt: {code_file: ~/code, username: ~/x}\n")
    config = load_config(environ={"RADARD_CLIPS__DIR": "~/clips"})
    assert config.service.state_dir == tmp_path / "state"
    assert (config.mqtt.code_file, config.clips.dir) == (tmp_path / "code", tmp_path / "clips")
    assert config.mqtt.username == "~/x"
    assert named_file("store:~/a:b.db") == tmp_path / "a:b.db"


def test_a_file_that_is_named_and_not_there_is_said(capsys):
    write("", "ca.pem")
    write("mqtt: {password_file: gone, ca_file: ca.pem}\nweb: {labels_file: new.jsonl}\n")
    assert run_config(["check"]) == 0
    said = capsys.readouterr()
    assert said.err == "radard: mqtt.password_file: gone: no such file\n"
    assert said.out == "configuration ok, but for the above\n"


def test_order_file_environment_options():
    write("gate: {false_alarms_per_day: 5, adapt_db: 1}\nmodel: {name: a}\n")
    other = write("model: {name: there}", "other.yaml")
    assert load_config(other, environ={}).model.name == "there"
    environ = {"RADARD_GATE__ADAPT_DB": "2", "RADARD_MODEL__NAME": "b", "OTHER": "x"}
    config = load_config(environ=environ, options={"model": {"name": "c"}, "output": ["null"]})
    assert config.gate.false_alarms_per_day == 5
    assert config.gate.adapt_db == 2
    assert config.model.name == "c"
    assert config.output == ("null",)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("gate:\n  adapt: 3", "config.yaml:2: unknown key 'gate.adapt'; did you mean 'adapt_db'"),
        ("gates: {}\n", "config.yaml:1: unknown key 'gates'; did you mean 'gate'"),
        ("\nmodel: {xyzzy: 1}", "config.yaml:2: unknown key 'model.xyzzy'; known: name, profile"),
        ("gate: {false_alarms_per_day: high}", "config.yaml:1: gate.false_alarms_per_day"),
        ("gate: {false_alarms_per_day: -1}", "greater than 0"),
        ("decision: {pet_limit: 0.2}", "decision.pet_limit"),
        ("sensor: {name: 'a b'}", "sensor.name"),
        ("gate: 3", "config.yaml:1: gate: must be a section, with keys below it (got '3')"),
        ("output: json", "config.yaml:1: output: must be a list, as [a, b] (got 'json')"),
        ("Gate:\n", "config.yaml:1: unknown key 'Gate'; did you mean 'gate'"),
        ("alarm: {latch_s: }", "config.yaml:1: alarm.latch_s"),
        ("sensors: {a: {port: /x}, b: {port: '/x?rate=6'}}", "sensors.b have the same port, /x"),
        ("clips: {keep_mb: inf}", "config.yaml:1: clips.keep_mb: input should be a finite number"),
        ("web: {sensors: {attic: 'javascript:x'}}", "config.yaml:1: web.sensors.attic"),
        ("- 1", "mapping of sections"),
        ("a: [", "not YAML"),
        (
            "sensors:\n  hall: {port: sim:dog}\n  hall: {port: sim:cat}\n",
            "config.yaml:3: not YAML: the key 'hall' stands twice, in lines 2 and 3",
        ),
        ("alarm: {}\ngate: {}\nalarm: {}\n", "the key 'alarm' stands twice, in lines 1 and 3"),
        ("sensors: {a: {port: x, gate: {adapt: 3}}}", "did you mean 'adapt_db'"),
        ("sensors: {a: {port: x, prt: y}}", "unknown key 'sensors.a.prt'; did you mean 'port'"),
        ("sensors: {a: {}}", "sensors.a.port"),
        ("sensors: {'a b': {port: x}}", "sensors.a b"),
        ("sensors: {a: {port: x}}\nsensor: {port: y}", "one radar or several"),
        ("sensors: {a: 3}", "sensors.a"),
        ("sensors: {a: {port: x, alarm: {confirm_n: 2}}}\nalarm: {confirm_k: 3}", "confirm_k"),
        ("outbox:\n  attempts: 3\n", "config.yaml:1: outbox: is the section 'log' now"),
        # All at once.
        ("gate: {false_alarm_per_day: 1}\nmodle: {}\n", "gate.false_alarm_per_day"),
        ("gate: {false_alarm_per_day: 1}\nmodle: {}\n", "unknown key 'modle'"),
    ],
)
def test_faults_name_their_place(text, words):
    write(text)
    with pytest.raises(ConfigError) as caught:
        load_config(environ={})
    assert words in str(caught.value)
    assert caught.value.exit_code == 78


@pytest.mark.parametrize(
    ("name", "environ", "words"),
    [
        (None, {"RADARD_GATE__THRESHOLD": "3"}, "RADARD_GATE__THRESHOLD: unknown key"),
        (
            None,
            {"RADARD_SENSOR__NAME": "hall", "RADARD_Sensor__Name": "attic"},
            "RADARD_SENSOR__NAME and RADARD_Sensor__Name",
        ),
        ("gone.yaml", {}, "cannot read"),
        (".", {}, "cannot read"),
    ],
)
def test_faults_name_the_variable_or_the_file(name, environ, words):
    with pytest.raises(ConfigError, match=words):
        load_config(name and Path(name), environ=environ)


WORDS = ["on", "no", "null", "007", "1", "1.5e3", "0x10", "12_000", "2026-11-21", "~x"]


@pytest.mark.parametrize("word", [*WORDS, "{x}", "[a]", '{"a": 1}', "[", "# x", "*a", "'"])
def test_a_text_field_takes_what_is_written(word):
    """A variable's text is no YAML."""
    assert load_config(environ={"RADARD_MQTT__USERNAME": word}).mqtt.username == (
        None if word == "null" else word
    )
    if word in WORDS:
        write(f"mqtt: {{discovery_prefix: {word}, commands: off}}\nsensor: {{speed: {word}}}\n")
        config = load_config(environ={"RADARD_MODEL__NAME": word})
        texts = (config.mqtt.discovery_prefix, config.sensor.speed, config.model.name)
        assert texts == (word,) * 3
        assert config.mqtt.commands == "off"


@pytest.mark.parametrize("name", [word for word in WORDS if word.isalnum()])
def test_a_sensor_may_be_called_anything_that_is_a_name(name):
    assert load_config(environ={"RADARD_SENSOR__NAME": name}).sensor.name == name
    write(f"sensors: {{{name}: {{port: sim:empty}}}}\n")
    assert list(load_config(environ={}).sensors) == [name]
    write(first_config(name, "/dev/ttyACM0"))
    config = load_config(environ={})
    assert (config.sensor.name, config.sensor.port) == (name, "/dev/ttyACM0")


def test_variables_of_a_container_platform_are_left_out_with_a_warning(caplog):
    environ = {
        "RADARD_PORT": "tcp://10.0.0.1:8434",
        "RADARD__WEB_PORT": "tcp://10.0.0.1:8434",
        "RADARD_PORT_8434_TCP_ADDR": "10.0.0.1",
        "RADARD_SERVICE_HOST": "10.0.0.1",
        "RADARD_OUTPUT": "['null']",
    }
    assert load_config(environ=environ) == Config(output=("null",))
    left = [record.getMessage().partition(":")[0] for record in caplog.records]
    assert sorted(left) == sorted(set(environ) - {"RADARD_OUTPUT"})


@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize("end", ["", "\r\n", " \nmore"])
def test_the_first_line_of_a_file_or_a_variable_is_the_secret(tmp_path, monkeypatch, mark, end):
    file, text = tmp_path / "secret", f"{mark}wört{end}"
    file.write_bytes(text.encode())
    monkeypatch.setenv("SECRET", text)
    assert read_secret("x", file, None) == read_secret("x", None, "SECRET") == "wört"


@pytest.mark.parametrize(("home", "is_private"), [(None, True), (None, False), ("here", True)])
def test_who_has_no_home_keeps_state_in_temporary_files(tmp_path, monkeypatch, home, is_private):
    def nobody(number):
        raise KeyError(f"uid not found: {number}")

    monkeypatch.delenv("HOME", raising=False)
    if home is not None:
        monkeypatch.setenv("HOME", home)
    monkeypatch.setattr("pwd.getpwuid", nobody)
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path))
    folder = tmp_path / f"radard-{os.getuid()}"
    folder.mkdir(mode=0o700 if is_private else 0o755)
    if is_private:
        for environ in ({}, {"XDG_STATE_HOME": "here"}):
            assert state_dir(load_config(environ=environ), environ) == folder / "state"
    else:
        with pytest.raises(ConfigError, match=r"service\.state_dir"):
            load_config(environ={})
    assert load_config(environ={"STATE_DIRECTORY": str(tmp_path)}) == Config()
