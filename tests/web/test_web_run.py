"""The dashboard as an output of a running daemon: it helps, and never hinders."""

import json
import os
import socket
import struct

import pytest

from radard.dsp.pictures import COLUMN_RATE_HZ
from tests.alarm_helpers import write_recording
from tests.radar_helpers import decisions, noise, records_in, run_radard, stable
from tests.web_helpers import Client, wait

pytestmark = pytest.mark.integration


def test_a_page_gets_decisions_and_pictures_of_a_live_stream(launched):
    running = launched("--port", "sim:human?seed=1", "--model", "none").wait_online()
    page = Client(running.port).socket()
    page.send('{"pictures": true}')
    texts, n_columns = {}, 0
    # What the ring still held, and what came meanwhile.
    while len(texts.get("decision", ())) < 2 or n_columns <= 3 * COLUMN_RATE_HZ:
        data = page.recv(60)
        if isinstance(data, str):
            message = json.loads(data)
            texts.setdefault(message["type"], []).append(message)
        elif data[0] == 1:
            n_columns += struct.unpack_from("<H", data, 2)[0]
    page.close()
    assert [m["type"] for m in texts["welcome"]] == ["welcome"]
    assert len(texts["axes"]) == 1
    assert running.status()["hello"]["port"] == "sim:human?seed=1"


def test_a_busy_port_is_a_warning_and_waited_for(launched, monkeypatch):
    monkeypatch.setattr("radard.web.sink._RETRY_S", 0.1)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        argv = ("--port", "sim:empty", "--model", "none", "--speed", "max", "--duration", "10")
        code, records, err = run_radard(*argv, "-o", "json", "-o", f"http://127.0.0.1:{port}")
        assert code == 0
        assert len(decisions(records)) == 8
        assert err.count("cannot listen") == 1
        assert f"Address already in use by process {os.getpid()} (" in err
        assert "listening at" not in err
        running = launched("--port", "sim:empty", "--model", "none", port=port)
        running.wait(lambda: "cannot listen" in running.log)
    running.wait_online()
    assert f"dashboard at http://127.0.0.1:{port}/" in running.log
    assert running.end() == 0


def test_decisions_are_the_same_with_a_dashboard_and_pages(launched, tmp_path):
    recording = tmp_path / "human.h5"
    made = ("--port", "sim:human?seed=2", "--duration", "12", "--record", str(recording))
    assert run_radard(*made, "--speed", "max")[0] == 0
    # A replay waits for a machine that is busy; a module would not.
    argv = ("--port", f"replay:{recording}")
    _, alone, _ = run_radard(*argv, "--speed", "max", "-o", "json")
    environ = {"RADARD_CLIPS__ENABLED": "false"}
    out = f"json:{tmp_path / 'o.jsonl'}"
    running = launched(*argv, "--speed", "3", "-o", out, environ=environ)
    pages = []
    for _ in range(5):
        page = wait(Client(running.port).socket)
        page.send('{"pictures": true}')
        # Some never read.
        pages.append(page)
    running.process.wait(60)
    assert stable(records_in(tmp_path / "o.jsonl")) == stable(alone)
    for page in pages:
        page.close()


def test_a_replay_is_paused_moved_and_let_go(launched, tmp_path):
    path = tmp_path / "r.h5"
    write_recording(path, noise(60 * 60))
    running = launched("--port", f"replay:{path}", "--model", "none", "--speed", "4")
    running.wait_online()

    def play(action, value=None):
        return running.post("/api/v1/playback", {"action": action, "value": value})

    assert play("pause")[0] == 202
    running.wait(lambda: running.status()["reason"] == "the replay is paused")
    held = running.status()
    assert (held["playback"]["length_s"], held["panel"]["open"]) == (60.0, {})
    assert play("seek", 50.0)[0] == 202
    assert play("seek", 61.0)[0] == 400
    assert play("speed", "fast")[0] == 400
    assert play("speed", 8)[0] == 202
    assert play("play")[0] == 202
    assert running.process.wait(60) == 0
    assert "Traceback" not in running.log
