"""`radard status`, `top`, `arm`, `disarm`, `ack`, `test-alarm`: the command line and a daemon."""

import contextlib
import json
import os
import pty
import shutil
import socket
import stat
import threading
import time

import numpy as np
import pytest

from radard.alarm.sensor_state import KeptState, SensorState, StateStore
from radard.cli import main
from radard.health.heartbeat import status_path
from radard.log import EventLog
from radard.run import control
from radard.run.control import ask, control_path, range_time
from tests.daemon_helpers import told
from tests.processes import environ, started
from tests.radar_helpers import copy_ring, events, faults, frames_of, noise, records_in, walker
from tests.sink_helpers import FakeHost, WebServer
from tests.waiting import free_port, wait_for
from tests.web_helpers import HEADERS
from tests.web_helpers import ask as web_ask

pytestmark = pytest.mark.integration


@pytest.fixture
def said(tmp_path, monkeypatch, capsys):
    """Run a command beside the daemon; return its exit code and what it prints."""
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    monkeypatch.setenv("RADARD_SERVICE__RUNTIME_DIR", str(tmp_path))

    def run(*argv):
        capsys.readouterr()
        code = main(list(argv))
        found = capsys.readouterr()
        return code, (found.out + found.err).strip()

    return run


def running(launch, tmp_path, **options):
    daemon = launch(**options)
    wait_for(lambda: daemon.panel().get("seq", 0) >= 1)
    wait_for(control_path(tmp_path, "radar").exists)
    return daemon


def test_disarm_arm_and_status_over_the_socket(tmp_path, launch, said):
    daemon = running(launch, tmp_path, alarm={"exit_delay_s": 600, "armed": False})
    mode = control_path(tmp_path, "radar").stat().st_mode
    assert stat.S_ISSOCK(mode)
    assert stat.S_IMODE(mode) == 0o600
    wait_for(lambda: "disarmed, nobody moves" in said("status")[1])
    assert said("arm")[1].startswith("armed in ")
    code, line = said("arm", "--home")
    assert (code, line.startswith("armed at home in ")) == (0, True)
    panel = daemon.panel()
    assert (panel["armed"], panel["panel"], panel["mode"]) == (True, "exit", "home")
    wait_for(lambda: "armed at home, exit delay, " in said("status")[1])
    line = said("status")[1]
    assert line.startswith("online, ")
    assert line.endswith(" s ago, simulated")
    assert json.loads(said("status", "--json")[1])["simulated"] is True
    assert said("disarm") == (0, "disarmed")
    assert daemon.panel()["armed"] is False
    assert daemon.stop() == 0
    assert said("status") == (1, "offline: stopped")
    assert not control_path(tmp_path, "radar").exists()
    code, line = said("arm")
    assert (code, "no radard runs here" in line) == (1, True)


@pytest.mark.parametrize("text", ["alarm: {nosuch: 1}\n", "sensor: {port: 'socket://h:99999'}\n"])
def test_a_configuration_that_is_edited_keeps_nobody_from_the_daemon(tmp_path, launch, said, text):
    """Before, `disarm` ended with 78, and so did `health`, on which a container is restarted."""
    config = tmp_path / "radard.yaml"
    config.write_text(text)
    assert said("disarm", "--config", str(config))[0] == 78
    daemon = running(launch, tmp_path)
    wait_for(status_path(tmp_path, "radar").exists)
    code, line = said("disarm", "--config", str(config))
    assert (code, "asked is who runs here: radar" in line) == (0, True)
    assert daemon.panel()["armed"] is False
    for name in ("health", "status", "top"):
        assert said(name, "--config", str(config))[0] == 0
    assert said("disarm", "--sensor", "attic", "--config", str(config))[0] == 2


def test_a_folder_of_any_length_has_a_socket(tmp_path):
    radar = FakeHost()
    radar.why_lost, radar.state = "", SensorState(armed=False)
    folder = tmp_path / ("state" * 20) / ("radar" * 20)
    server = control.ControlServer(folder)
    server.start([radar])
    try:
        answer = ask(control_path(folder, "radar"), "disarm")
        assert (answer["ok"], radar.asked) == (True, ["disarm"])
    finally:
        server.stop()
    assert list(folder.iterdir()) == []


def test_a_test_alarm_goes_through_every_output_and_says_what_each_answers(tmp_path, launch, said):
    out, server, nobody = tmp_path / "out.jsonl", WebServer(), free_port()
    outputs = [
        f"json:{out}",
        f"store:{tmp_path / 'radar.db'}",
        f"webhook:http://127.0.0.1:{server.port}/",
        f"webhook:http://127.0.0.1:{nobody}/",
    ]
    daemon = running(launch, tmp_path, output=outputs)
    code, text = said("test-alarm")
    assert [line.rpartition(": ")[2] for line in text.splitlines()[:3]] == ["taken"] * 3
    assert f":{nobody}" in text.splitlines()[3]
    assert "failed" in text.splitlines()[3]
    assert code == 1
    assert json.loads(server.posts[0][2])["test"] is True
    assert daemon.panel()["panel"] == "armed"
    assert daemon.stop() == 0
    records = records_in(out)
    new, end = events(records, "alarm")
    assert (new["phase"], end["phase"], new["id"]) == ("new", "end", end["id"])
    assert new["test"] is end["test"] is new["simulated"] is True
    assert faults(records) == []


def test_another_user_gives_no_commands(tmp_path, launch, monkeypatch):
    daemon = running(launch, tmp_path)
    monkeypatch.setattr(control, "_user_of", lambda _line: os.geteuid() + 12345)
    with pytest.raises((ValueError, OSError)):
        ask(control_path(tmp_path, "radar"), "disarm")
    assert daemon.panel()["armed"] is True


@pytest.mark.parametrize(
    "line", [b"\n", b"[]\n", b"{}\n", b"[" * 9000 + b"\n", b'{"command": "dance"}\n']
)
def test_what_is_no_command_is_refused_and_does_no_harm(tmp_path, launch, line):
    running(launch, tmp_path)
    path = control_path(tmp_path, "radar")
    with socket.socket(socket.AF_UNIX) as end:
        end.settimeout(60)
        end.connect(str(path))
        end.sendall(line)
        end.shutdown(socket.SHUT_WR)
        answer = end.makefile().read()
    assert json.loads(answer)["ok"] is False
    assert ask(path, "disarm")["armed"] is False


REFUSED = SensorState(armed=False, open={"tamper": "covered; arming was refused"})


@pytest.mark.parametrize(
    ("name", "state"),
    [
        ("arm", REFUSED),
        ("arm", SensorState(armed=False)),
        ("ack", SensorState(alarm_id="X")),
        ("disarm", SensorState(armed=True)),
    ],
)
def test_a_command_that_is_not_taken_up_is_no_success(launch, said, monkeypatch, name, state):
    """Before, `radard arm` said "disarmed", and ended with 0."""
    monkeypatch.setattr(control, "_TAKEN_UP_S", 0.3)
    daemon = launch()
    wait_for(lambda: daemon.panel().get("seq"))
    monkeypatch.setattr(daemon.radar, "panel", lambda: state)
    monkeypatch.setattr(daemon.radar, "command", lambda _name: None)
    words = "covered; arming was refused" if state is REFUSED else "not taken up within"
    code, line = said(name)
    assert (code, line.count("\n"), words in line) == (1, 0, True)


def test_the_socket_of_a_daemon_that_is_killed_hides_no_other(tmp_path, launch, said, monkeypatch):
    dead = tmp_path / "system"
    dead.mkdir()
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(control_path(dead, "radar")))
    running(launch, tmp_path)
    found = (dead, tmp_path)
    monkeypatch.setattr("radard.commands.control.status_dirs", lambda _config: found)
    assert said("disarm") == (0, "disarmed")
    found = (dead,)
    code, line = said("disarm")
    assert (code, line.endswith("no radard answers (Connection refused)")) == (1, True)


@pytest.mark.parametrize("answer", [{"ok": True}, {"ok": True, "armed": True}, [], None])
@pytest.mark.parametrize("command", ["arm", "ack", "test-alarm", "top"])
def test_a_daemon_of_another_version_is_said(tmp_path, said, answer, command):
    """As one that was not started again since an update; before, an internal error."""
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(str(control_path(tmp_path, "radar")))
        end.listen()

        def serve():
            line, _ = end.accept()
            with line:
                line.recv(4096)
                line.sendall(json.dumps(answer).encode() + b"\n")

        server = threading.Thread(target=serve)
        server.start()
        code, text = said(command)
        server.join(60)
    assert (code, text.count("\n"), "internal" in text) == (1, 0, False)
    assert ("another version" in text) == isinstance(answer, dict)


def test_one_of_several_that_does_not_answer_leaves_the_others_told(tmp_path, launch, said):
    daemon = launch(sensors={"hall": {"port": "sim:empty"}})
    wait_for(lambda: daemon.panel().get("seq"))
    config = tmp_path / "radard.yaml"
    sensors = {"cellar": {"port": "sim:empty"}, "hall": {"port": "sim:empty"}}
    config.write_text(json.dumps({"sensors": sensors}))
    code, text = said("disarm", "--config", str(config))
    assert (code, "cellar: no radard runs here" in text) == (1, True)
    assert "hall: disarmed" in text
    assert daemon.panel()["armed"] is False


def test_a_socket_left_behind_is_replaced_and_one_in_use_is_not(tmp_path, launch, said, caplog):
    path = control_path(tmp_path, "radar")
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    running(launch, tmp_path)
    inode = path.stat().st_ino
    assert said("disarm") == (0, "disarmed")
    assert control._listen(path) is None
    assert said("disarm") == (0, "disarmed")
    # Who only looked whether it is in use asked for nothing.
    assert "was not answered" not in caplog.text
    assert path.stat().st_ino == inode


HUMAN = {
    "sensor": {"port": "sim:human", "speed": "10"},
    "model": {"name": "thesis"},
    "alarm": {"sensitivity": "high", "latch_s": 86_400, "refractory_s": 3600},
}


def test_while_an_alarm_is_on_no_test_is_made_and_it_is_acknowledged_once(tmp_path, launch, said):
    daemon = running(launch, tmp_path, **HUMAN)
    wait_for(lambda: daemon.panel().get("alarm_id"))
    code, line = said("test-alarm")
    assert (code, "an alarm is on" in line) == (1, True)
    code, line = said("ack")
    assert (code, line.startswith("acknowledged: ")) == (0, True)
    assert (daemon.panel()["panel"], daemon.panel()["armed"]) == ("armed", True)
    assert said("ack") == (0, "no alarm is on")


def test_top_shows_state_decisions_range_over_time_and_outputs(tmp_path, launch, said):
    daemon = running(launch, tmp_path, output=["null", f"mqtt://127.0.0.1:{free_port()}"], **HUMAN)
    wait_for(lambda: daemon.panel().get("alarm_id") and daemon.panel()["seq"] > 8)

    def lines_of_a_person():
        code, text = said("top")
        assert code == 0
        lines = text.splitlines()
        parts = (
            [each for each in lines if each.startswith("person \N{FULL BLOCK}") and "%" in each],
            [each for each in lines if " m " in each and "\N{FULL BLOCK}" in each],
            [each for each in lines if " s  open " in each and "human ALARM" in each],
        )
        return lines if all(parts) else []

    # He stands still now and then, and nobody is seen.
    lines = wait_for(lines_of_a_person)
    assert lines[0].startswith("radar: ")
    assert any(line.startswith("ALARM: ") for line in lines)
    (row,) = [line for line in lines if line.startswith("mqtt://")]
    assert " retrying " in row


def test_top_has_a_line_for_each_of_several(tmp_path, launch, said, monkeypatch):
    sensors = {"hall": {"port": "sim:empty"}, "attic": {"port": str(tmp_path / "absent")}}
    daemon = launch(sensors=sensors)
    wait_for(lambda: told(daemon.run.sensors[0]).get("seq"))
    wait_for(control_path(tmp_path, "attic").exists)
    config = tmp_path / "radard.yaml"
    config.write_text(json.dumps({"sensors": sensors}))
    code, text = said("top", "--config", str(config))
    head, hall, attic = (line.split() for line in text.splitlines())
    assert (code, head[:2], hall[0], attic[0]) == (0, ["sensor", "sees"], "hall", "attic")
    assert "offline:" in attic
    code, text = said("top", "--config", str(config), "--sensor", "cellar")
    assert (code, "no sensor 'cellar'" in text) == (2, True)


def test_top_is_live_on_a_terminal_until_q(tmp_path, launch):
    daemon = running(launch, tmp_path)
    near, far = pty.openpty()
    own = {"RUNTIME_DIRECTORY": str(tmp_path), "RADARD_SERVICE__RUNTIME_DIR": str(tmp_path)}
    ends = {"stdin": far, "stdout": far, "stderr": far, "env": environ(TERM="xterm", **own)}
    top = started("-m", "radard", "top", **ends)
    os.close(far)
    shown = b""
    while shown.count(b"person") < 3:
        shown += os.read(near, 65536)
    assert daemon.stop() == 0
    while b"no radard runs here" not in shown:
        shown += os.read(near, 65536)
    os.write(near, b"q")
    with contextlib.suppress(OSError):
        while part := os.read(near, 65536):
            shown += part
    os.close(near)
    assert (top.wait(60), shown.endswith(b"\x1b[?1049l")) == (0, True)


def test_range_over_time_shows_who_walks_where_and_when():
    ring = copy_ring(120, 60.0)
    frames = noise(240) + walker(240, 60.0, speed_mps=0.3, start_m=2.0, level=20.0)
    assert range_time(ring)["columns"] == []
    for frame in frames_of(frames.astype(np.complex64)):
        ring.push(frame)
        with contextlib.suppress(TimeoutError):
            ring.next_item(0)
    made = range_time(ring)
    near_m, far_m = made["range_m"]
    for k, column in enumerate(made["columns"], made["first"]):
        at_m = near_m + (column.index("4") + 0.5) / len(column) * (far_m - near_m)
        t_s = (k + 0.5) * made["column_s"]
        assert at_m == pytest.approx(2.0 - 0.3 * t_s, abs=0.15)
        assert column.count("0") >= len(column) - 4
    assert made["first"] + len(made["columns"]) == 16


def killed(tmp_path, name, is_armed):
    """How the next run would find itself armed, were this one killed now."""
    copy = shutil.copytree(tmp_path / "state", tmp_path / f"killed{time.monotonic_ns()}")
    events = EventLog(copy / "log.db")
    kept = StateStore(events, name).load(is_armed=is_armed)
    events.close()
    return kept


def test_what_was_answered_is_on_disk_and_holds_after_a_kill(tmp_path, launch, said):
    running(launch, tmp_path)
    for command, is_armed in (("disarm", False), ("arm", True)):
        assert said(command)[0] == 0
        assert killed(tmp_path, "radar.sim", not is_armed).is_armed is is_armed


def test_what_is_commanded_before_there_is_a_stream_holds_after_a_kill(tmp_path, launch, said):
    """Before, it was in memory, and of an alarm that is on nobody was told."""
    events = EventLog(tmp_path / "state" / "log.db")
    alarm = KeptState(is_armed=True, alarm_id="X", alarm_reason="human at 2.0 m")
    StateStore(events, "radar").save(alarm)
    events.close()
    absent, out = str(tmp_path / "ttyX2"), tmp_path / "out.jsonl"
    sensor = {"port": absent, "wait": True}
    base = f"http://127.0.0.1:{free_port()}"
    daemon = launch(sensor=sensor, output=[f"json:{out}", base], alarm={"exit_delay_s": 600})
    wait_for(control_path(tmp_path, "radar").exists)
    asked = {"data": '{"command": "calibrate"}', "headers": HEADERS}
    wait_for(lambda: web_ask(f"{base}/api/v1/command", **asked)[0] == 409)
    assert said("disarm") == (0, "disarm: taken, there is no stream yet")
    kept = killed(tmp_path, "radar", is_armed=True)
    assert (kept.is_armed, kept.alarm_id) == (False, None)
    assert said("arm", "--home")[0] == 0
    kept = killed(tmp_path, "radar", is_armed=False)
    assert (kept.is_armed, kept.mode, 0 < kept.exit_left_s <= 600) == (True, "home", True)
    assert daemon.stop() == 0
    (end,) = [r for r in map(json.loads, out.read_text().splitlines()) if r["type"] == "event"]
    assert (end["id"], end["phase"], end["reason"]) == ("X", "end", "disarmed")


def test_a_command_that_no_disk_takes_says_how_long_it_holds(tmp_path, launch, said):
    (tmp_path / "state").write_text("no folder")
    running(launch, tmp_path)
    code, line = said("disarm")
    assert (code, line.startswith("disarmed, until it is started again: ")) == (0, True)
