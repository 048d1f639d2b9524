"""An event that came out anywhere comes out everywhere, whatever is killed in between."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from radard.alarm.state_store import KeptState
from radard.config.config import load_config
from radard.outputs import journal as journal_module
from radard.outputs.database import open_database
from radard.outputs.fanout import Outputs
from radard.outputs.journal import EventJournal
from radard.outputs.store_query import read_events
from tests.host_helpers import FakeHost
from tests.run.test_tamper_commands import Room
from tests.sink_helpers import WebServer, event, hello, ulid
from tests.waiting import wait_for

ROOT = Path(__file__).parents[2]
TOLD = """
import json, sys
sys.path[:0] = [{root!r}, {daemon!r}]
from tests.outputs.test_event_journal import outputs_of
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
            "outbox": {"first_retry_s": 0.02, "longest_retry_s": 0.05},
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
        code = TOLD.format(root=str(ROOT), daemon=str(ROOT / "daemon"))
        self._process = subprocess.Popen(
            [sys.executable, "-c", code, json.dumps([str(folder), *names])],
            stdin=subprocess.PIPE,
            text=True,
        )

    def put(self, record):
        self._process.stdin.write(json.dumps(record) + "\n")
        self._process.stdin.flush()

    def kill(self):
        self._process.send_signal(signal.SIGKILL)
        self._process.wait(60)
        self._process.stdin.close()


@pytest.fixture
def server():
    made = WebServer()
    yield made
    made.close()


def ids_in(path):
    lines = path.read_text().splitlines() if path.exists() else []
    return [row["id"] for row in map(json.loads, lines) if row["type"] == "event"]


def journal_of(tmp_path):
    with closing(sqlite3.connect(tmp_path / "journal.db", timeout=60)) as db:
        has_table = db.execute("SELECT count(*) FROM sqlite_schema WHERE type = 'table'")
        return db.execute("SELECT key FROM journal").fetchall() if has_table.fetchone()[0] else []


def test_a_kill_behind_the_first_outputs_word_costs_the_others_nothing(tmp_path, server):
    store, lines = tmp_path / "events.db", tmp_path / "out.jsonl"
    outputs_of(tmp_path, f"store:{store}").close()
    names = (f"json:{lines}", f"store:{store}", f"webhook:http://127.0.0.1:{server.port}/")
    told = Told(tmp_path, *names)
    told.put(hello())
    wait_for(lambda: lines.exists() and "hello" in lines.read_text())
    # While somebody holds both databases, neither the store nor the outbox gets anything.
    outbox = next(iter((tmp_path / "outbox").glob("*.db")))
    with closing(sqlite3.connect(store)) as a, closing(sqlite3.connect(outbox)) as b:
        a.execute("BEGIN EXCLUSIVE")
        b.execute("BEGIN EXCLUSIVE")
        server.code = 500
        told.put(event(1))
        wait_for(lambda: ids_in(lines) == [ulid(1)])
        # A kill before the journal knows that the file has it would let it be told there twice.
        wait_for(lambda: len(journal_of(tmp_path)) == 2)
        told.kill()
    assert read_events(store) == []
    server.code = 200
    n_before = len(server.posts)
    out = outputs_of(tmp_path, *names)
    out.put(hello())
    wait_for(lambda: len(server.posts) > n_before and read_events(store))
    wait_for(lambda: not journal_of(tmp_path))
    out.close()
    assert [row.id for row in read_events(store)] == [ulid(1)]
    assert json.loads(server.posts[-1][2])["id"] == ulid(1)
    # Who has spoken before is not told again.
    assert ids_in(lines) == [ulid(1)]


def test_what_all_have_kept_is_not_told_again(tmp_path, server):
    names = (f"json:{tmp_path / 'out.jsonl'}", f"webhook:http://127.0.0.1:{server.port}/")
    for k in (1, 2):
        out = outputs_of(tmp_path, *names)
        out.put(hello())
        out.put(event(k))
        wait_for(lambda k=k: len(server.posts) >= k)
        wait_for(lambda: not journal_of(tmp_path))
        out.close()
    assert ids_in(tmp_path / "out.jsonl") == [ulid(1), ulid(2)]
    assert [json.loads(body)["id"] for _, _, body in server.posts] == [ulid(1), ulid(2)]


def test_what_an_output_had_no_room_for_at_the_end_comes_after_the_next_start(tmp_path):
    store = tmp_path / "events.db"
    outputs_of(tmp_path, f"store:{store}").close()
    out = outputs_of(tmp_path, f"store:{store}")
    out.put(hello())
    with closing(sqlite3.connect(store)) as db:
        db.execute("BEGIN EXCLUSIVE")
        out.put(event(1))
        wait_for(lambda: not out.sinks[0][1].state.is_ok)
        out.close()
    out = outputs_of(tmp_path, f"store:{store}")
    out.put(hello())
    wait_for(lambda: [row.id for row in read_events(store)] == [ulid(1)])
    out.close()


def test_no_journal_for_a_test_a_replay_or_what_nobody_must_keep(tmp_path):
    out = outputs_of(tmp_path, f"json:{tmp_path / 'out.jsonl'}", "null")
    out.put(hello())
    out.put({**event(1), "test": True})
    out.close()
    out = outputs_of(tmp_path, "null")
    out.put(event(2))
    out.close()
    out = outputs_of(tmp_path, f"json:{tmp_path / 'two.jsonl'}", port="replay:x.h5")
    out.put(event(3))
    out.close()
    assert ids_in(tmp_path / "two.jsonl") == [ulid(3)]
    assert not (tmp_path / "journal.db").exists() or journal_of(tmp_path) == []


# ---------------------------------------------------------------- the journal by itself


def left_in(path):
    journal = EventJournal(path)
    left = journal.left()
    journal.close()
    return {name: [row["id"] for row in rows] for name, rows in left.items()}


def test_it_holds_for_each_output_what_that_has_not_kept(tmp_path):
    path = tmp_path / "journal.db"
    journal = EventJournal(path)
    assert journal.left() == {}
    journal.note(event(1), ["a", "b"])
    journal.note(event(2), ["b", "a"])
    journal.note(event(2), ["a"])
    journal.taken("a", event(1))
    journal.taken("c", event(1))
    journal.close()
    assert left_in(path) == {"b": [ulid(1), ulid(2)], "a": [ulid(2)]}
    assert path.stat().st_mode & 0o077 == 0
    # Too late, but no fault.
    journal.taken("b", event(1))
    journal.note(event(3), ["a"])


def test_phases_of_one_event_are_kept_apart(tmp_path):
    journal = EventJournal(tmp_path / "journal.db")
    journal.note(event(1), ["a"])
    journal.note(event(1, phase="end"), ["a"])
    journal.taken("a", event(1))
    journal.close()
    left = EventJournal(tmp_path / "journal.db").left()
    assert [row["phase"] for row in left["a"]] == ["end"]


def test_it_is_bounded_and_drops_the_oldest(tmp_path, monkeypatch):
    monkeypatch.setattr(journal_module, "_MOST", 3)
    journal = EventJournal(tmp_path / "journal.db")
    for k in range(6):
        journal.note(event(k), ["a"])
    journal.close()
    assert left_in(tmp_path / "journal.db") == {"a": [ulid(3), ulid(4), ulid(5)]}


def test_without_a_path_nothing_is_kept():
    journal = EventJournal(None)
    journal.note(event(1), ["a"])
    journal.taken("a", event(1))
    assert journal.left() == {}
    journal.close()


def test_a_disk_that_takes_nothing_is_said_once_and_costs_no_event(tmp_path, caplog):
    path = tmp_path / "journal.db"
    path.mkdir()
    journal = EventJournal(path)
    assert journal.left() == {}
    journal.note(event(1), ["a"])
    journal.note(event(2), ["a"])
    assert caplog.text.count("a kill may cost events") == 1
    path.rmdir()
    journal.note(event(3), ["a"])
    journal.close()
    assert left_in(path) == {"a": [ulid(3)]}


def test_a_disk_that_hangs_delays_an_event_by_half_a_second_at_most(tmp_path):
    path = tmp_path / "journal.db"
    journal = EventJournal(path)
    journal.note(event(1), ["a"])
    with closing(sqlite3.connect(path)) as db:
        db.execute("BEGIN EXCLUSIVE")
        journal.note(event(2), ["a"])
        assert journal._n_done == 1
    journal.close()
    assert left_in(path) == {"a": [ulid(1), ulid(2)]}


def test_rows_that_cannot_be_read_cost_only_themselves(tmp_path, caplog):
    path = tmp_path / "journal.db"
    journal = EventJournal(path)
    journal.note(event(1), ["a"])
    journal.close()
    with closing(sqlite3.connect(path)) as db:
        for n, text in enumerate((b"\xff\xfe", "[1]", "{}", "nonsense", "null")):
            row = ("a", f"k{n}", text)
            db.execute("INSERT INTO journal (output, key, record) VALUES (?, ?, ?)", row)
        db.commit()
    assert left_in(path) == {"a": [ulid(1)]}
    assert caplog.text.count("unreadable, skipped") == 5


def test_a_damaged_file_is_put_aside_and_a_foreign_one_left_alone(tmp_path, caplog):
    path = tmp_path / "journal.db"
    path.write_bytes(os.urandom(5000))
    assert left_in(path) == {}
    assert (tmp_path / "journal.db.broken").exists()
    other = tmp_path / "other.db"
    schema = "CREATE TABLE IF NOT EXISTS t (n INTEGER);"
    open_database(other, schema, application_id=7, version=1).close()
    journal = EventJournal(other)
    assert journal.left() == {}
    journal.note(event(1), ["a"])
    journal.close()
    assert "a database of another program" in caplog.text


# ---------------------------------------------------------------- the worker's order


def test_a_new_alarm_is_kept_before_it_is_told_and_an_end_is_told_before_that_is_kept():
    room, order = Room(), []
    store = room.worker._store
    store.save = lambda state: order.append(("kept", state.alarm_id))
    room.outputs.put = lambda record, **_: order.append((record["type"], record.get("phase")))
    kept = KeptState(is_armed=True, entry_reason="human at 2.0 m")
    room.worker._emit(room.worker.tracker.resume(kept))
    (_, alarm_id), told = order
    assert alarm_id is not None
    assert told == ("event", "new")
    order.clear()
    room.command("disarm")
    assert order == [("event", "end"), ("kept", None)]
