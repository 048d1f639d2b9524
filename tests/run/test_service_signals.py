"""A daemon as a service manager sees it: signals, reloads, restarts, threads that stand still."""

import fcntl
import json
import signal
import sys
import termios
from functools import partial
from pathlib import Path

import pytest

from radard.health.heartbeat import Heartbeat, read_status, status_path
from radard.pipeline import Pipeline
from radard.run.os_signals import Signals
from radard.run.worker import Worker
from radard.stream.source import LiveSource
from tests.alarm_helpers import NotifySocket
from tests.daemon_helpers import Gate
from tests.device_helpers import plugged
from tests.processes import environ, started
from tests.radar_helpers import decisions, events, records_in
from tests.waiting import wait_for

pytestmark = pytest.mark.integration


@pytest.fixture
def far(tmp_path):
    """The service manager of a daemon in a process of its own."""
    end = NotifySocket(tmp_path / "notify")
    yield end
    end.close()


def start(*argv, **more):
    return started("-m", "tests.busy_machine", *argv, text=True, env=environ(**more))


def records_until(process, what, most=400):
    records = []
    for line in process.stdout:
        records.append(json.loads(line))
        if what in line:
            return records
        assert len(records) < most
    raise AssertionError(records)


def over_floor_db(record):
    return round(record["threshold_db"] - record["noise_floor_db"])


def finish(process):
    """Read what is left (communicate would lose what was read ahead) and wait."""
    out, err = process.stdout.read(), process.stderr.read()
    process.stdout.close()
    process.stderr.close()
    process.wait(timeout=60)
    return out, err


def reload(process, far):
    """Have it read its configuration again, and wait for that."""
    process.send_signal(signal.SIGHUP)
    assert "MONOTONIC_USEC" in far.wait_for("RELOADING")
    far.wait_for("READY")


def test_hup_reloads_without_losing_the_stream_and_usr1_dumps(tmp_path, far):
    config = tmp_path / "config.yaml"
    config.write_text("gate: {false_alarms_per_day: 1000}\nmodel: {name: none}\n")
    argv = ("--port", "sim:empty", "--speed", "8", "-o", "json")
    env = environ(NOTIFY_SOCKET=far.name)
    process = started("-m", "tests.busy_machine", *argv, text=True, env=env, cwd=tmp_path)
    before = records_until(process, '"seq":3,')
    far.wait_for("READY")
    config.write_text(
        "gate: {false_alarms_per_day: 0.01}\nmodel: {name: none}\nsensor: {name: other}\n"
    )
    reload(process, far)
    between = []
    while not between or over_floor_db(between[-1]) != 9:
        new = records_until(process, '"decision"', most=50)
        between += [r for r in new if r["type"] == "decision"]
        assert len(between) < 400
    config.unlink()
    reload(process, far)
    config.write_text("gate: {false_alarm_per_day: 9}\n")
    reload(process, far)
    process.send_signal(signal.SIGUSR1)
    after = records_until(process, '"decision"')
    process.send_signal(signal.SIGTERM)
    out, err = finish(process)
    assert process.returncode == 0
    records = before + between + after + [json.loads(line) for line in out.splitlines()]
    made = decisions(records)
    assert [d["seq"] for d in made] == list(range(1, len(made) + 1))
    assert [d["t_s"] for d in made] == [round(2.45 + k, 3) for k in range(len(made))]
    over = [over_floor_db(d) for d in made]
    assert over[0] == 7
    assert over[-1] == 9
    assert over == sorted(over)
    assert {r["type"] for r in records} == {"hello", "status", "decision"}
    assert "changes of 'sensor' take a restart" in err
    assert "the old configuration stays: config.yaml: is gone" in err
    (dump,) = [line for line in err.splitlines() if " state {" in line]
    state = json.loads(dump.partition(" state ")[2])
    assert (state["state"], state["reason"][:7]) == ("degraded", "reload:")
    assert "did you mean 'false_alarms_per_day'" in state["reason"]
    assert {"MainThread", "reader", "heartbeat"} <= set(state["threads"])
    assert any(name.startswith("worker") for name in state["threads"])


def test_absent_at_boot_then_plugged_in(tmp_path, far):
    name = tmp_path / "ttyX2"
    process = start(
        *("--port", str(name), "--wait", "--model", "none", "-o", "json"),
        NOTIFY_SOCKET=far.name,
        WATCHDOG_USEC="1000000",
        RADARD_SERVICE__RUNTIME_DIR=str(tmp_path),
    )
    assert far.wait_for("READY")["STATUS"].startswith("offline: device absent")
    far.wait_for("WATCHDOG")
    assert json.loads((tmp_path / "radar.status.json").read_text())["state"] == "offline"
    with plugged(speed=5.0) as pty:
        name.symlink_to(pty.path)
        assert records_until(process, '"decision"')[0]["type"] == "hello"
        process.send_signal(signal.SIGTERM)
        far.wait_for("STOPPING")
        out, _ = finish(process)
        assert process.returncode == 0
        last = json.loads(out.splitlines()[-1])
        assert last == {"type": "status", "state": "offline", "reason": "stopped"}


def test_a_second_signal_forces_the_end():
    process = start("--port", "sim:empty", "--speed", "max", "-o", "json", "--model", "none")
    fcntl.fcntl(process.stdout, fcntl.F_SETPIPE_SZ, 4096)
    process.stdout.read(1)
    # Nobody reads on: the pipe fills up, and the worker stands in a write.
    n_unread = partial(fcntl.ioctl, process.stdout, termios.FIONREAD, bytes(4))
    wait_for(lambda: int.from_bytes(n_unread(), sys.byteorder) > 2000)
    process.send_signal(signal.SIGTERM)
    wait_for(lambda: process.poll() is not None or process.send_signal(signal.SIGTERM))
    assert process.returncode == -signal.SIGTERM
    process.stdout.close()
    process.stderr.close()


def panel_of(daemon, key, wanted):
    wait_for(lambda: daemon.panel().get(key) == wanted)


@pytest.mark.parametrize(
    ("entry_delay_s", "panel", "phases"),
    [(0, "alarm", ["update", "end"]), (600, "entry", ["new", "end"])],
)
def test_an_alarm_and_an_entry_delay_outlive_a_restart_until_acknowledged(
    tmp_path, launch, entry_delay_s, panel, phases
):
    alarm = {"sensitivity": "high", "latch_s": 86_400, "refractory_s": 3600}
    options = {"model": {"name": "thesis"}, "alarm": {**alarm, "entry_delay_s": entry_delay_s}}
    daemon = launch(sensor={"port": "sim:human", "speed": "max"}, **options)
    panel_of(daemon, "panel", panel)
    # The panel may say it a moment before the event is there.
    alarm_id = wait_for(lambda: panel == "entry" or daemon.panel().get("alarm_id"))
    assert daemon.stop() == 0
    out = tmp_path / "out.jsonl"
    sensor = {"port": "sim:empty", "speed": "max"}
    daemon = launch(**options, sensor=sensor, output=[f"json:{out}"])
    panel_of(daemon, "panel", "alarm")
    wait_for(lambda: daemon.panel()["seq"] >= 2)
    assert panel == "entry" or daemon.panel()["alarm_id"] == alarm_id
    daemon.radar.command("ack")
    panel_of(daemon, "panel", "armed")
    assert daemon.stop() == 0
    alarms = events(records_in(out), "alarm")
    assert [e["phase"] for e in alarms] == phases
    assert alarms[-1]["reason"] == "acknowledged"
    if panel == "entry":
        assert "restarted during the entry delay" in alarms[0]["reason"]
        assert Path(alarms[0]["clip"]).is_file()


def test_reload_changes_the_policy_the_outputs_and_the_clips(tmp_path, launch):
    configs = []
    first, second = tmp_path / "a.jsonl", tmp_path / "b.jsonl"
    daemon = launch(reload=configs.pop, output=[f"json:{first}"], alarm={"armed": True})
    panel_of(daemon, "gate", "closed")
    assert daemon.radar.worker.parts.clips is not None
    changes = {
        "clips": daemon.config.clips.model_copy(update={"enabled": False}),
        "alarm": daemon.config.alarm.model_copy(update={"sensitivity": "low"}),
        "model": daemon.config.model.model_copy(update={"name": "thesis"}),
        "output": (f"json:{first}", f"json:{second}", "json:/nowhere/x"),
    }
    rotated = tmp_path / "a.old"
    first.rename(rotated)
    configs.append(daemon.config.model_copy(update=changes))
    daemon.ask("reload")
    wait_for(lambda: second.exists() and daemon.radar.worker.parts.clips is None)
    seq = daemon.panel()["seq"]
    wait_for(lambda: daemon.panel()["seq"] >= seq + 2)
    assert daemon.radar.worker.parts.policy.k == 3
    assert daemon.radar.worker.parts.pipeline.classifier is not None
    assert daemon.stop() == 0
    for path in (first, second):
        records = records_in(path)
        assert records[0]["type"] == "hello"
        assert [r for r in records if r["type"] == "hello"][-1]["sensitivity"] == "low"
        assert "decision" in {r["type"] for r in records}
    assert "hello" in rotated.read_text()


def test_a_reload_before_there_is_a_stream_holds_for_it(tmp_path, launch):
    """Before, it was said to be done, and the stream began with the old configuration."""
    choices, name = [], tmp_path / "ttyX2"
    daemon = launch(sensor={"port": str(name), "wait": True}, reload=lambda: choices[0])
    wait_for(lambda: daemon.radar.health.status.state == "offline")
    alarm = daemon.config.alarm.model_copy(update={"latch_s": 99.0})
    model = daemon.config.model.model_copy(update={"name": "thesis"})
    choices.append(daemon.config.model_copy(update={"alarm": alarm, "model": model}))
    daemon.ask("reload")
    wait_for(lambda: daemon.radar.config().alarm == alarm)
    with plugged(speed=5.0) as pty:
        name.symlink_to(pty.path)
        wait_for(lambda: daemon.panel().get("seq"))
        parts = daemon.radar.worker.parts
        assert (parts.policy.latch_s, parts.pipeline.classifier.bundle.name) == (99.0, "thesis")
        assert daemon.stop() == 0


STALE_S = 1.5
WHERE = {
    "reader, waiting for the port": (Gate.before_each, LiveSource, "frames"),
    "reader, holding frames": (Gate.before, Worker, "hold"),
    "worker, deciding": (Gate.before, Pipeline, "decide"),
    "worker, writing": (Gate.before, Worker, "_emit"),
    "main": (Gate.before, Signals, "take"),
    "heartbeat": (Gate.before, Heartbeat, "_write"),
}


def status(tmp_path):
    return read_status(status_path(tmp_path, "radar"))


@pytest.mark.parametrize("where", WHERE)
def test_a_thread_that_stands_still_stops_notification(where, tmp_path, monkeypatch, launch, gate):
    put, cls, name = WHERE[where]
    put(gate, monkeypatch, cls, name)
    daemon = launch(stale_s=STALE_S)
    daemon.far.wait_for("READY")
    daemon.far.wait_for("WATCHDOG")
    gate.shut()
    wait_for(lambda: daemon.far.silent_for(0.6))
    if where not in {"main", "heartbeat"}:
        wait_for(lambda: "no decision" in (report := status(tmp_path)).line and report)
        assert status(tmp_path).content["state"] == "offline"
    gate.open()
    assert daemon.far.wait_for("WATCHDOG")


def test_a_thread_that_never_comes_back_does_not_hold_up_the_end(monkeypatch, launch):
    gate, forced = Gate(), []
    gate.before(monkeypatch, Pipeline, "decide")
    monkeypatch.setattr("radard.run.running._JOIN_S", 0.2)
    monkeypatch.setattr("radard.run.process._DEADLINE_S", 0.6)
    monkeypatch.setattr("radard.run.os_signals.os._exit", forced.append)
    daemon = launch()
    daemon.far.wait_for("READY")
    gate.shut()
    wait_for(lambda: gate.n_before)
    result = daemon.stop()
    assert str(result) == "stuck and left behind: worker"
    assert result.exit_code == 1
    wait_for(lambda: forced)
    gate.open()
    assert forced == [1]
