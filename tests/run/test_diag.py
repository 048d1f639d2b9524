"""radard diag: all that helps, and no secrets."""

import json
import tarfile
from pathlib import Path

import pytest

from radard.cli import main
from radard.commands.diag import gather, scrub
from radard.health.health import Status
from radard.health.status_file import status_path, write_status

SECRETS = ("hunter2hunter2", "t0psecret-token", "0urbroker-pw", "pathofthehook")
CONFIG = """\
sensor: {{name: hall, port: 'socket://me:hunter2hunter2@host:7000'}}
output:
  - json:{log}
  - mqtt://me:0urbroker-pw@broker
  - webhook:https://example.org/pathofthehook
  - exec:notify --token t0psecret-token
service: {{runtime_dir: {folder}, state_dir: {folder}}}
"""


@pytest.fixture
def config(tmp_path):
    log = tmp_path / "log.jsonl"
    lines = [json.dumps({"type": "decision", "seq": k}) for k in range(500)]
    lines.append(json.dumps({"reason": "mqtt://me:0urbroker-pw@broker refused hunter2hunter2"}))
    log.write_text("\n".join(lines) + "\n")
    write_status(status_path(tmp_path, "hall"), Status("online", ""), {"seq": 7})
    path = tmp_path / "mine.yaml"
    path.write_text(CONFIG.format(log=log, folder=tmp_path))
    return path


def test_parts_tell_what_helps(config):
    parts = gather(config, {"RADARD_GATE__FALSE_ALARMS_PER_DAY": "7"})
    assert "false_alarms_per_day: 7" in parts["config.txt"]
    assert json.loads(parts["environment.json"]) == {"RADARD_GATE__FALSE_ALARMS_PER_DAY": "7"}
    (status,) = json.loads(parts["status.json"]).values()
    assert (status["line"], status["seq"]) == ("online", 7)
    assert '"seq": 499' in parts["decisions.txt"]
    assert '"seq": 200}' not in parts["decisions.txt"]
    assert json.loads(parts["versions.json"])["model"] == "accurate"
    assert json.loads(parts["limits.json"])["cores"] >= 1
    assert json.loads(parts["calibration.json"])["asked"] == "auto"


def test_no_secret_gets_through(config, monkeypatch):
    parts = gather(config, {"RADARD_MQTT__PASSWORD": "t0psecret-token"})
    told = "\n".join(parts.values())
    assert all(secret not in told for secret in SECRETS)
    assert str(Path.home()) + "/" not in told or Path.home() == Path("/")


def test_a_wrong_configuration_is_part_of_the_report(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("gate: {false_alarm_per_day: 1}\nmqtt: {password: t0psecret-token}\n")
    parts = gather(path, {})
    assert "unknown key 'gate.false_alarm_per_day'" in parts["config.txt"]
    assert "t0psecret-token" not in "\n".join(parts.values())


def test_what_cannot_be_told_stops_nothing(config, monkeypatch):
    def fail():
        msg = "no bus"
        raise OSError(msg)

    monkeypatch.setattr("radard.commands.diag.list_ports", fail)
    parts = gather(config, {})
    assert "no bus" in parts["ports.json"]
    assert "cores" in parts["limits.json"]


def test_serial_numbers_are_masked(config, monkeypatch):
    from x2radar.device.discovery import PortRow

    row = PortRow("/dev/ttyX", "0403:6001", serial_number="FT123", by_id="/dev/by-id/FT123")
    monkeypatch.setattr("radard.commands.diag.list_ports", lambda: [row])
    (port,) = json.loads(gather(config, {})["ports.json"])
    assert "FT123" not in str(port)
    assert (port["usb_id"], port["access"]) == ("0403:6001", "gone")


def test_what_is_secret_or_looks_like_it_is_scrubbed():
    assert scrub("a geheim b", ["geheim"]) == "a *** b"
    given = "x\nmqtt://u:pw@h\nwebhook:https://h/abc"
    assert scrub(given) == "x\nmqtt://u:***@h\nwebhook:https://h/***"
    assert scrub(f"{Path.home()}/x") == "~/x"


def names(path):
    with tarfile.open(path) as tar:
        return {each.name.removeprefix("radard-diag/") for each in tar.getmembers()}


def test_bundle(config, tmp_path, capsys):
    out = tmp_path / "report.tar.gz"
    assert main(["diag", "--config", str(config), "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    assert out.stat().st_mode & 0o777 == 0o600
    assert {"README.txt", "config.txt", "decisions.txt", "limits.json"} <= names(out)
    assert not [name for name in names(out) if name.endswith(".h5")]
    assert main(["diag", "--out", str(out)]) == 1
    assert "exists already" in capsys.readouterr().err


def test_recordings_go_along_only_when_named(config, tmp_path, capsys):
    clip, out = tmp_path / "clip.h5", tmp_path / "report.tar.gz"
    clip.write_bytes(b"frames")
    assert main(["diag", "--out", str(out), "--add", str(clip)]) == 0
    assert "added/clip.h5" in names(out)
    assert main(["diag", "--out", str(tmp_path / "b"), "--add", str(tmp_path / "gone.h5")]) == 1
    assert "gone.h5" in capsys.readouterr().err
    (tmp_path / "twice").mkdir()
    for bad, words in (
        (tmp_path / "twice", "Is a directory"),
        (tmp_path / "twice/clip.h5", "one name"),
    ):
        (tmp_path / "twice/clip.h5").write_bytes(b"other frames")
        argv = ["diag", "--out", str(tmp_path / "b"), "--add", str(clip), "--add", str(bad)]
        assert main(argv) == 1
        assert words in capsys.readouterr().err
        assert not (tmp_path / "b").exists()
