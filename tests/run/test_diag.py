"""radard diag: all that helps, and no secrets."""

import json
import tarfile
from pathlib import Path

import pytest

from radard.cli import main
from radard.commands.diag import gather, scrub
from radard.health.health import Status
from radard.health.heartbeat import status_path, write_status
from x2radar.device.discovery import PortRow

pytestmark = pytest.mark.integration  # the name of the platform is asked of a program, once

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


def test_no_secret_gets_through_also_of_a_wrong_configuration(config, tmp_path):
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("gate: {false_alarm_per_day: 1}\nmqtt: {password: t0psecret-token}\n")
    for path in (config, wrong):
        parts = gather(path, {"RADARD_MQTT__PASSWORD": "t0psecret-token"})
        told = "\n".join(parts.values())
        assert all(secret not in told for secret in SECRETS)
        assert str(Path.home()) + "/" not in told or Path.home() == Path("/")
    assert "unknown key 'gate.false_alarm_per_day'" in parts["config.txt"]
    assert scrub(f"a geheim {Path.home()}/x", ["geheim"]) == "a *** ~/x"


def test_serial_numbers_are_masked_and_what_cannot_be_told_stops_nothing(config, monkeypatch):
    def fail():
        raise OSError(19, "no bus")

    monkeypatch.setattr("radard.commands.diag.list_ports", fail)
    assert "no bus" in gather(config, {})["ports.json"]
    row = PortRow("/dev/ttyX", "0403:6001", serial_number="FT123", by_id="/dev/by-id/FT123")
    monkeypatch.setattr("radard.commands.diag.list_ports", lambda: [row])
    (port,) = json.loads(gather(config, {})["ports.json"])
    assert "FT123" not in str(port)
    assert (port["usb_id"], port["access"]) == ("0403:6001", "gone")


def test_a_bundle_and_recordings_only_when_named(config, tmp_path, capsys):
    clip, out, twice = (tmp_path / name for name in ("clip.h5", "report.tar.gz", "twice"))
    twice.mkdir()
    for file in (clip, twice / "clip.h5"):
        file.write_bytes(b"frames")

    def made(*argv):
        return main(["diag", "--config", str(config), "--out", *map(str, argv)])

    assert made(out) == 0
    assert capsys.readouterr().out == f"{out}\n"
    assert out.stat().st_mode & 0o777 == 0o600
    assert made(tmp_path / "with", "--add", clip) == 0
    for file, n_clips in ((out, 0), (tmp_path / "with", 1)):
        with tarfile.open(file) as tar:
            names = [each.name.removeprefix("radard-diag/") for each in tar.getmembers()]
        assert {"README.txt", "config.txt", "decisions.txt", "limits.json"} <= set(names)
        assert names.count("added/clip.h5") == n_clips
    for argv, words in (
        ([out], "exists already"),
        ([tmp_path / "b", "--add", tmp_path / "gone.h5"], "gone.h5"),
        ([tmp_path / "b", "--add", twice], "Is a directory"),
        ([tmp_path / "b", "--add", clip, "--add", twice / "clip.h5"], "one name"),
    ):
        assert made(*argv) == 1
        assert words in capsys.readouterr().err
        assert not (tmp_path / "b").exists()
