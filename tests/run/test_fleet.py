"""`radard fleet`: radars of several processes at one real broker."""

import json
import socket

import pytest

from radard.cli import main
from radard.commands.fleet import Fleet, table
from tests.waiting import free_port, wait_for


def asked(capsys, *argv):
    """Exit code and objects of one look at the fleet."""
    code = main(["fleet", *argv, "--once", "--json"])
    lines = capsys.readouterr().out.splitlines()
    return code, {row["sensor"]: row for row in map(json.loads, filter(None, lines))}


@pytest.mark.integration
def test_two_processes_with_three_radars_are_one_fleet(tmp_path, launch, broker, capsys, listen):
    url = f"mqtt://127.0.0.1:{broker.port}/house"
    listener = listen()
    two = {"hall": {"port": "sim:human?seed=1"}, "attic": {"port": str(tmp_path / "absent")}}
    launch(sensors=two, output=[url], alarm={"armed": False})
    second = launch(
        sensor={"name": "shed", "port": "sim:empty", "speed": "10"},
        service={"runtime_dir": tmp_path / "b", "state_dir": tmp_path / "b" / "state"},
        output=[url],
    )
    for name in ("hall-simulated", "shed-simulated"):
        wait_for(lambda name=name: listener.on(f"house/{name}/state"))
        wait_for(lambda name=name: b"online" in listener.on(f"house/{name}/availability"))
    wait_for(lambda: listener.on("house/attic/health"))
    code, rows = asked(capsys, url)
    assert code == 1
    assert list(rows) == ["attic", "hall-simulated", "shed-simulated"]
    assert [row["state"] for row in rows.values()] == ["offline", "online", "online"]
    assert rows["attic"]["reason"].startswith("device absent")
    assert [row["armed"] for row in rows.values()] == [None, False, True]
    assert rows["shed-simulated"]["sees"] == "nobody"
    # One that is killed is offline, by its last will; here a clean end says the same.
    assert second.stop() == 0
    wait_for(lambda: listener.on("house/shed-simulated/availability")[-1] == b"offline")
    # The broker passes a message on before it retains it.
    wait_for(lambda: asked(capsys, url)[1]["shed-simulated"]["state"] == "offline")
    # As people see it, by the configuration's own broker.
    config = tmp_path / "radard.yaml"
    config.write_text(f"output: ['{url}']\n")
    assert main(["fleet", "--once", "--config", str(config)]) == 1
    shown = capsys.readouterr().out
    assert shown.startswith("3 radars, 1 online, 0 with an alarm\n")
    assert "attic           offline" in shown


@pytest.mark.integration
@pytest.mark.parametrize(
    ("argv", "code", "word"),
    [
        ((), 2, "no broker: give mqtt://HOST"),
        (("mqtt://127.0.0.1:{free}",), 1, "cannot connect: Connection refused"),
        (("mqtt://",), 2, "no host"),
        (("mqtt://me:secret@host",), 2, "no password in the URL"),
        (("mqtt://127.0.0.1:{free}", "--wait", "nan"), 2, "must be 0.001 to"),
        (("mqtt://127.0.0.1:{silent}", "--config", "{config}"), 1, "no answer"),
    ],
)
def test_what_cannot_be_watched_is_one_line(argv, code, word, capsys, tmp_path):
    config = tmp_path / "radard.yaml"
    config.write_text("mqtt: {keepalive_s: 1}\n")
    with socket.create_server(("127.0.0.1", 0)) as silent:
        ports = {"free": free_port(), "silent": silent.getsockname()[1]}
        argv = [a.format(config=config, **ports) for a in argv]
        assert main(["fleet", *argv, "--once"]) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert word in line
    assert "secret" not in line.replace("me:secret@host", "")


def test_a_stranger_at_the_broker_changes_nothing_and_does_not_steer_the_terminal():
    fleet = Fleet("radard")
    told = {"state": "online", "tamper": "\x1b[2J", "fault": ["\x07"], "reason": {"a": 1}}
    fleet.take("radard/hall/availability", b"online", 1.0)
    fleet.take("radard/hall/health", json.dumps(told).encode(), 1.0)
    for payload in (b"\xff", b"[1]", b"{", b"9" * 5000, b"[" * 100_000):
        for kind in ("state", "health"):
            fleet.take(f"radard/hall/{kind}", payload, 2.0)
    fleet.take("radard/hall/availability", b"\xff", 2.0)
    fleet.take("radard/a/b/state", b"{}", 2.0)
    fleet.take("elsewhere/hall/state", b"{}", 2.0)

    for armed in (3, "yes", [], {}, None):
        state = {"armed": armed, "label": "\x9b", "alarm": "x"}
        fleet.take("radard/hall/state", json.dumps(state).encode(), 2.0)
        (row,) = fleet.rows(3.0)
        assert (row["sensor"], row["state"], row["armed"]) == ("hall", "online", None)
        assert all(line.isprintable() for line in table([row]))
        assert (row["tamper"], row["sees"]) == ("?[2J", "?")
    fleet.take("radard/\x1bc/availability", b"online", 3.0)
    assert len(fleet.rows(3.0)) == 1


def test_alarms_come_first_then_trouble_and_what_was_removed_is_gone():
    fleet = Fleet("radard")
    for name, state in (("a", "online"), ("b", "degraded"), ("c", "online")):
        fleet.take(f"radard/{name}/availability", b"online", 0.0)
        health = {"state": state, "reason": "2 frames missing", "fault": None, "tamper": None}
        fleet.take(f"radard/{name}/health", json.dumps(health).encode(), 0.0)
        told = {"armed": True, "alarm": name == "c", "gate": "open", "label": "human"}
        fleet.take(f"radard/{name}/state", json.dumps(told).encode(), 0.0)
    assert [row["sensor"] for row in fleet.rows(1.0)] == ["c", "b", "a"]
    first, _, alarm, trouble, _ = table(fleet.rows(61.0))
    assert first == "3 radars, 2 online, 1 with an alarm"
    assert alarm.split()[:4] == ["c", "online", "armed", "ALARM"]
    assert "61 s" in alarm
    assert trouble.endswith("2 frames missing")
    for kind in ("availability", "health", "state"):
        fleet.take(f"radard/c/{kind}", b"", 62.0)
    assert [row["sensor"] for row in fleet.rows(63.0)] == ["b", "a"]
