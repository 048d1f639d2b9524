"""Hold up each thread of a running daemon in turn: systemd's notification must stop."""

import pytest

from radard.health.heartbeat import Heartbeat
from radard.health.status_file import read_status, status_path
from radard.pipeline import Pipeline
from radard.run.os_signals import Signals
from radard.run.worker import Worker
from radard.stream.source import LiveSource
from tests.daemon_helpers import Gate
from tests.waiting import wait_for

pytestmark = pytest.mark.integration
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
def test_a_thread_that_stands_still_stops_the_notification(
    where, tmp_path, monkeypatch, launch, gate
):
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


def test_a_daemon_that_is_well_is_fed_and_says_its_end(tmp_path, launch):
    daemon = launch()
    daemon.far.wait_for("READY")
    for _ in range(5):
        daemon.far.wait_for("WATCHDOG")
    daemon.ask("stop")
    assert daemon.far.wait_for("STOPPING")["STATUS"] == "stopped"
    assert daemon.stop() == 0
    assert status(tmp_path).line == "offline: stopped"


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
