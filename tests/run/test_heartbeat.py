"""Who tells of health: the status file, the heartbeat, systemd, `radard health`."""

import errno
import json
import os
import time

import pytest

from radard.cli import main
from radard.config.config import load_config
from radard.config.directories import clip_dir, runtime_dir, state_dir, status_dirs
from radard.health import heartbeat as beats
from radard.health.health import Health, Status
from radard.health.heartbeat import Notifier, Watched, read_status, status_path, write_status
from tests.alarm_helpers import NotifySocket


@pytest.fixture
def health():
    return Health(stale_s=5.0, clock=lambda: 100.0)


@pytest.mark.integration
@pytest.mark.parametrize("name", ["{}/notify", "@radard-test-{}"])
def test_messages_reach_the_service_manager(name, tmp_path):
    where = name.format(tmp_path if "/" in name else os.getpid())
    far = NotifySocket(where)
    notifier = Notifier({"NOTIFY_SOCKET": where, "WATCHDOG_USEC": "10000000"})
    assert notifier.is_watching
    notifier.ready("online")
    assert far.next() == {"READY": "1", "STATUS": "online"}
    notifier.feed("online")
    assert far.next()["WATCHDOG"] == "1"
    notifier.reloading()
    message = far.next()
    assert message["RELOADING"] == "1"
    assert abs(int(message["MONOTONIC_USEC"]) / 1e6 - time.monotonic()) < 60
    notifier.feed("online")
    assert far.next()["WATCHDOG"] == "1"
    notifier.send("STOPPING=1", "STATUS=stopped")
    assert far.next() == {"STOPPING": "1", "STATUS": "stopped"}
    far.close()
    notifier.ready("nobody listens")


@pytest.mark.parametrize(
    "environ",
    [
        {},
        {"WATCHDOG_USEC": "x"},
        {"WATCHDOG_USEC": "10000000", "WATCHDOG_PID": "1"},
        {"NOTIFY_SOCKET": "/nowhere/at/all"},
    ],
)
def test_without_a_watchdog_nothing_is_fed(environ):
    notifier = Notifier(environ)
    assert not notifier.is_watching
    notifier.feed("online")
    notifier.send("READY=1")


def make_heart(health, tmp_path):
    watched = Watched("radar", health, status_path(tmp_path, "radar"), lambda: {"seq": 7})
    heartbeat = beats.Heartbeat(Notifier({"WATCHDOG_USEC": "2000000"}))
    heartbeat.add(watched)
    return heartbeat


def test_the_status_file_of_another_process_is_left_alone(health, tmp_path, caplog):
    path = status_path(tmp_path, "radar")
    write_status(path, Status("online", ""), {"pid": os.getppid()})
    heartbeat = make_heart(health, tmp_path)
    heartbeat.start()
    heartbeat.stop()
    assert json.loads(path.read_text())["pid"] == os.getppid()
    assert "belongs to process" in caplog.text


def test_a_sensor_removed_while_the_heart_beats_leaves_no_status_file(health, tmp_path):
    heartbeat = make_heart(health, tmp_path)
    path = status_path(tmp_path, "attic")
    removes = []

    def panel():
        if removes:
            heartbeat.remove(removes.pop())
        return {}

    heartbeat.add(Watched("attic", health, path, panel))
    heartbeat.beat()
    assert path.exists()
    # The beat that is under way when it is removed writes its file once more.
    removes.append("attic")
    heartbeat.beat()
    heartbeat.beat()
    assert not path.exists()
    assert status_path(tmp_path, "radar").exists()
    # Another of the same name, as when a port changes, has the file again.
    heartbeat.add(Watched("attic", health, path, panel))
    heartbeat.beat()
    assert path.exists()


def test_a_full_disk_silences_the_status_while_it_is_full(health, tmp_path, monkeypatch, caplog):
    heartbeat = make_heart(health, tmp_path)
    path = status_path(tmp_path, "radar")

    def full(*_args, **_more):
        raise OSError(errno.ENOSPC, "No space left on device")

    for _ in range(2):
        with monkeypatch.context() as disk:
            disk.setattr("radard.health.heartbeat.write_status", full)
            for _ in range(3):
                heartbeat.beat()
        assert not path.exists()
        heartbeat.beat()
        path.unlink()
    assert caplog.text.count("No space left on device") == 2


def asked(capsys, *argv):
    return main(["health", *argv]), capsys.readouterr().out.strip()


def test_radard_health(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    path = status_path(tmp_path, "hall")
    code, line = asked(capsys, "--sensor", "hall")
    assert (code, "no radard runs here" in line) == (1, True)
    for status, code in (
        (Status("online", ""), 0),
        (Status("degraded", "9 frames missing"), 0),
        (Status("starting", "waiting"), 1),
        (Status("offline", "device absent: x"), 1),
    ):
        write_status(path, status, {})
        expected = f"{status.state}: {status.reason}" if status.reason else status.state
        assert asked(capsys, "--sensor", "hall") == (code, expected)
    code, line = asked(capsys, "--sensor", "hall", "--json")
    assert json.loads(line)["healthy"] is False
    assert path.stat().st_mode & 0o777 == 0o644


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t_mono_s": -1e9}, "stuck or killed"),
        ({"t_mono_s": 1e12}, "before the last boot"),
        ({"t_mono_s": "x"}, "cannot be read"),
        ({"state": None, "reason": None, "t_mono_s": None}, "cannot be read"),
    ],
)
def test_a_status_that_is_not_of_now_is_no_good_news(tmp_path, change, words):
    path = status_path(tmp_path, "radar")
    write_status(path, Status("online", ""), {})
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    report = read_status(path)
    assert not report.is_healthy
    assert words in report.line
    path.write_text("{")
    assert not read_status(path).is_healthy


def test_folders():
    config = load_config(environ={})
    assert str(state_dir(config, {"STATE_DIRECTORY": "/var/lib/radard"})) == "/var/lib/radard"
    assert str(state_dir(config, {"XDG_STATE_HOME": "/s"})) == "/s/radard"
    assert str(runtime_dir(config, {"RUNTIME_DIRECTORY": "/run/radard"})) == "/run/radard"
    assert str(runtime_dir(config, {"XDG_RUNTIME_DIR": "/run/user/1"})) == "/run/user/1/radard"
    assert str(clip_dir(config, {"STATE_DIRECTORY": "/v"})) == "/v/clips"
    assert clip_dir(config, {"XDG_STATE_HOME": "/s"}) is None
    found = [str(p) for p in status_dirs(config, {"XDG_RUNTIME_DIR": "/u"})]
    assert found == ["/run/radard", "/u/radard"]
    named = load_config(environ={"RADARD_SERVICE__STATE_DIR": "/a", "RADARD_CLIPS__DIR": "/c"})
    assert (str(state_dir(named, {})), str(clip_dir(named, {}))) == ("/a", "/c")
