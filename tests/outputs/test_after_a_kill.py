"""An event that came out anywhere comes out everywhere, whatever is killed in between."""

import json
import signal
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path

import pytest

from radard.alarm.state_store import KeptState
from radard.config.config import load_config
from radard.log_file import read_events
from radard.outputs.fanout import Outputs
from tests.host_helpers import FakeHost
from tests.processes import started
from tests.run.test_tamper_commands import Room
from tests.sink_helpers import event, hello, ulid
from tests.waiting import wait_for

pytestmark = pytest.mark.integration
TOLD = """
import json, sys
from tests.outputs.test_after_a_kill import outputs_of
out = outputs_of(*json.loads(sys.argv[1]))
for line in sys.stdin:
    out.put(json.loads(line))
"""


def outputs_of(folder, *names, port="/dev/nothing"):
    """Outputs as of a daemon with this state directory."""
    config = load_config(
        environ={},
        options={
            "sensor": {"name": "hall", "port": port},
            "service": {"state_dir": Path(folder)},
            "log": {"first_retry_s": 0.02, "longest_retry_s": 0.05},
            "output": list(names),
        },
    )
    out = Outputs(stdout_is_terminal=False)
    out.add(FakeHost("hall"))
    out.open(config)
    return out


class Told:
    """Outputs in a process of their own, which can be killed."""

    def __init__(self, folder, *names):
        argv = ["-c", TOLD, json.dumps([str(folder), *names])]
        pipes = {"stdin": subprocess.PIPE, "stdout": None, "stderr": None}
        self._process = started(*argv, text=True, **pipes)

    def put(self, record):
        self._process.stdin.write(json.dumps(record) + "\n")
        self._process.stdin.flush()

    def kill(self):
        self._process.send_signal(signal.SIGKILL)
        self._process.wait(60)
        self._process.stdin.close()


def ids_in(path):
    lines = path.read_text().splitlines() if path.exists() else []
    return [row["id"] for row in map(json.loads, lines) if row["type"] == "event"]


def n_done(folder):
    """How many outputs have all events, as the file of the log knows."""
    with closing(sqlite3.connect(folder / "log.db", timeout=60)) as db:
        return db.execute("SELECT count(*) FROM cursors WHERE done = seen").fetchone()[0]


def test_a_kill_behind_the_first_outputs_word_costs_the_others_nothing(tmp_path, server):
    store, lines = tmp_path / "events.db", tmp_path / "out.jsonl"
    outputs_of(tmp_path, f"store:{store}").close()
    names = (f"json:{lines}", f"store:{store}", f"webhook:http://127.0.0.1:{server.port}/")
    told = Told(tmp_path, *names)
    told.put(hello())
    wait_for(lambda: lines.exists() and "hello" in lines.read_text())
    server.code = 500
    # Somebody holds the store, and the server takes nothing.
    with closing(sqlite3.connect(store)) as db:
        db.execute("BEGIN EXCLUSIVE")
        told.put(event(1))
        wait_for(lambda: ids_in(lines) == [ulid(1)])
        # A kill before the log knows that the file has it would let it be told there twice.
        wait_for(lambda: n_done(tmp_path) == 1)
        told.kill()
    assert read_events(store) == []
    server.code = 200
    n_before = len(server.posts)
    out = outputs_of(tmp_path, *names)
    out.put(hello())
    wait_for(lambda: len(server.posts) > n_before and read_events(store))
    wait_for(lambda: n_done(tmp_path) == 3)
    out.close()
    assert [row.id for row in read_events(store)] == [ulid(1)]
    assert json.loads(server.posts[-1][2])["id"] == ulid(1)
    # Who has spoken before is not told again, now and in the run after it.
    outputs_of(tmp_path, *names).close()
    assert ids_in(lines) == [ulid(1)]


def test_a_replay_leaves_nothing_for_the_next_run(tmp_path):
    out = outputs_of(tmp_path, f"json:{tmp_path / 'out.jsonl'}", port="replay:x.h5")
    out.put(hello())
    out.put(event(3))
    out.close()
    assert ids_in(tmp_path / "out.jsonl") == [ulid(3)]
    assert not (tmp_path / "log.db").exists()


def test_a_new_alarm_is_kept_before_it_is_told_and_an_end_is_told_before_that_is_kept():
    room, order = Room(), []
    store = room.worker._store
    store.save = lambda state: order.append(("kept", state.alarm_id))
    room.worker._put = lambda record, **_: order.append((record["type"], record.get("phase")))
    kept = KeptState(is_armed=True, entry_reason="human at 2.0 m")
    room.worker._emit(room.worker.tracker.resume(kept))
    (_, alarm_id), told = order
    assert alarm_id is not None
    assert told == ("event", "new")
    order.clear()
    room.command("disarm")
    assert order == [("event", "end"), ("kept", None)]
