"""The same input gives the same output: nothing changes unasked, and demos leave nothing."""

import json
from pathlib import Path

import pytest

from radard.alarm.sensor_state import KeptState, StateStore
from radard.cli import main
from radard.config.config import load_config
from radard.config.directories import clip_dir, demo_state, log_path, own_folder, saved_file
from radard.config.saved import change
from radard.log import EventLog
from tests.alarm_helpers import write_recording
from tests.processes import environ, ran
from tests.radar_helpers import decisions, events, noise, run_radard, stable
from tests.waiting import free_port

PORT = "sim:thesis_human?run=test"
COMMON = ("--speed", "max", "--duration", "9", "-o", "json")
SETTINGS = "alarm: {sensitivity: low, entry_delay_s: 6.0}\n"
ZONES = "zones: {include: [[0.6, 0.7]], exclude: []}\n"


@pytest.fixture
def state(tmp_path, monkeypatch):
    """The user's state directory, and a folder without a config.yaml to run in."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "home"))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    return tmp_path / "home" / "radard"


def yesterday(folder):
    """Leave what a page, a command or another run leaves."""
    folder.mkdir(parents=True)
    events = EventLog(folder / "log.db")
    for mark in ("", ".sim"):
        StateStore(events, f"radar{mark}").save(KeptState(is_armed=False))
        (folder / f"radar{mark}.settings.yaml").write_text(SETTINGS)
        (folder / f"radar{mark}.zones.yaml").write_text(ZONES)
        (folder / f"radar{mark}.room.npz").write_text("{}")
        (folder / f"radar{mark}.calibration.json").write_text("{}")
    events.close()


def told(*argv):
    """What a run says: hello apart, then its lines without the clock on the wall."""
    code, records, err = run_radard(*argv)
    assert code == 0
    return records[0], stable(records), err


@pytest.mark.parametrize("what", ["simulated", "replayed"])
def test_a_state_directory_changes_nothing_of_what_is(what, state, tmp_path):
    port = PORT
    if what == "replayed":
        told("--port", PORT, *COMMON, "--record", str(tmp_path / "r.h5"))
        port = f"replay:{tmp_path / 'r.h5'}"
    hello, before, err = told("--port", port, *COMMON)
    assert (hello["taken"], err) == ([], "")
    assert events(before, "alarm")
    yesterday(state)
    hello, after, err = told("--port", port, *COMMON)
    assert (hello["taken"], err) == ([], "")
    assert after == before
    assert sorted(p.name for p in state.parent.iterdir()) == ["radard"]


def test_what_is_asked_for_is_taken_and_said(state, tmp_path):
    yesterday(tmp_path / "mine")
    hello, lines, err = told("--port", PORT, *COMMON, "--state", str(tmp_path / "mine"))
    assert hello["sensitivity"] == "low"
    assert not events(lines, "alarm")
    names = {line.partition(":")[0].rpartition("/")[2] for line in hello["taken"]}
    expected = {"radar.sim.settings.yaml", "radar.sim.zones.yaml", "log.db"}
    assert names == {*expected, "radar.sim.room.npz"}
    (line,) = [line for line in err.splitlines() if "nobody named" in line]
    assert all(each in line for each in hello["taken"])
    assert "alarm.entry_delay_s, alarm.sensitivity" in line
    assert not state.exists()


def test_a_recording_is_judged_alike_by_both_commands(state, tmp_path, capsys):
    write_recording(tmp_path / "r.h5", noise(600))
    yesterday(state)
    config = tmp_path / "own.yaml"
    config.write_text("sensor: {port: /dev/ttyACM0}\nmodel: {name: none}\n")
    assert load_config(config).alarm.sensitivity == "low"
    assert load_config(config, port="replay:r.h5").alarm.sensitivity == "normal"
    assert main(["detect", "r.h5", "--config", str(config), "--to", "jsonl"]) == 0
    capsys.readouterr()


def test_a_file_that_nobody_named_is_said_with_what_it_changes(state, tmp_path):
    (tmp_path / "config.yaml").write_text("gate: {adapt_db: 40.0, learn_s: 30.0}\n")
    hello, _, err = told("--port", "sim:empty", "--speed", "max", "--duration", "3", "-o", "json")
    assert hello["taken"] == ["config.yaml: gate.learn_s"]
    assert "config.yaml: gate.learn_s" in err
    named = ("--config", "config.yaml")
    hello, _, err = told("--port", "sim:empty", *COMMON, *named)
    assert (hello["taken"], err) == ([], "")


@pytest.mark.integration
def test_a_demos_page_changes_its_own_run_and_no_later_one(state):
    options = {"sensor": {"port": "sim:human"}}
    config = load_config(options=options)
    change(saved_file(config, "settings"), "settings", {"alarm": {"sensitivity": "high"}})
    # As after `reload`.
    assert load_config(options=options).alarm.sensitivity == "high"
    code = "from radard.config.config import load_config; "
    code += f"print(load_config(options={options}).alarm.sensitivity)"
    assert ran("-c", code, check=True).stdout.strip() == "normal"
    assert not state.exists()


@pytest.mark.parametrize(
    ("name", "argv"),
    [
        ("explain", ()),
        ("walktest", ("--port", "replay:r.h5")),
        ("bench", ("--port", "replay:r.h5", "--rounds", "1", "--duration", "4")),
        ("detect", ("r.h5",)),
        ("why", ("r.h5", "--at", "3")),
    ],
)
def test_commands_say_what_they_take_from_a_file_nobody_named(name, argv, state, capsys, caplog):
    write_recording("r.h5", noise(300))
    Path("config.yaml").write_text("model: {name: none}\n")
    assert main([name, *argv]) == 0
    lines = [*capsys.readouterr().err.splitlines(), *caplog.messages]
    told = [line for line in lines if "nobody named" in line]
    assert [line.rpartition("nobody named: ")[2] for line in told] == ["config.yaml: model.name"]
    caplog.clear()
    assert main([name, *argv, "--config", "config.yaml"]) == 0
    assert "nobody named" not in capsys.readouterr().err + caplog.text


KEPT = ("t_s", "gate", "power_db", "noise_floor_db", "p_human", "p_pet", "p_other", "range_m")
SCENES = {"human": "thesis", "human_with_dog": "fast", "dog": "balanced", "curtain": "accurate"}


@pytest.mark.parametrize(("scene", "model"), SCENES.items())
def test_decisions_are_those_of_before(scene, model, golden):
    argv = ("--port", f"sim:{scene}?seed=5", "--model", model, "--duration", "14")
    code, records, err = run_radard(*argv, "--speed", "max", "-o", "json")
    assert (code, err) == (0, "")
    made = [{k: d[k] for k in KEPT} for d in decisions(records)]
    wanted = golden(f"decisions_{scene}.jsonl", made)
    assert len(made) == len(wanted) == 12
    for now, before in zip(made, wanted, strict=True):
        # Processors round differently; a network shows it more than a power does.
        near = {k: pytest.approx(v, abs=0.02) for k, v in before.items() if isinstance(v, float)}
        assert now == before | near


NEXT_DOG_S = 42.0
PAGE = "http://127.0.0.1:8434"


@pytest.mark.integration
def test_the_alarm_ends_before_the_next_dog_and_its_clip_with_the_demo(tmp_path):
    (tmp_path / "tmp").mkdir()
    command = ["-m", "radard", "--port", "sim:demo?seed=1", "--speed", "max"]
    command += ["--duration", "44", "-o", "json", "-o", f"http://127.0.0.1:{free_port()}"]
    home = environ(HOME=str(tmp_path / "home"), TMPDIR=str(tmp_path / "tmp"))
    done = ran(*command, env=home, cwd=tmp_path, check=True)
    assert "clips, labels and settings end with it; --state DIR keeps them" in done.stderr
    alarms = events([json.loads(line) for line in done.stdout.splitlines()], "alarm")
    assert (alarms[0]["phase"], alarms[-1]["phase"]) == ("new", "end")
    assert len({e["id"] for e in alarms}) == 1
    assert alarms[0]["reason"].startswith("human")
    assert alarms[-1]["end_t_s"] < NEXT_DOG_S
    clip = Path(alarms[0]["clip"])
    assert clip.is_relative_to(tmp_path / "tmp")
    assert not clip.parent.parent.exists()
    assert not (tmp_path / "home").exists()


def made_of(port, *outputs, **sections):
    options = {"sensor": {"port": port}, "output": list(outputs), **sections}
    config = load_config(environ={}, options=options)
    return config, demo_state(config, {})


def test_a_folder_of_its_own_is_for_simulations_on_a_page_alone(tmp_path):
    _, made = made_of("sim:cat", "json", PAGE)
    assert clip_dir(made, {}) == own_folder() / "clips"
    assert log_path(made, {}) == own_folder() / "log.db"
    named = {"service": {"state_dir": tmp_path}}
    for config, same in (
        made_of("sim:cat", "json"),
        made_of("/dev/ttyACM0", PAGE),
        made_of("replay:night.h5", PAGE),
        made_of("sim:cat", PAGE, **named),
    ):
        assert same is config
