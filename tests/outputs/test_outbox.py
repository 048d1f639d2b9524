"""The outbox: disks that fail, rows that nobody can read, clocks that are set."""

import json
import os
import sqlite3

import pytest

from radard.config.sink_table import SinkOptions
from radard.outputs import open_output
from radard.outputs.base import SinkContext
from radard.outputs.database import open_database
from radard.outputs.outbox import Outbox
from tests.sink_helpers import QUICK, WebServer, event, free_port, ulid, wait_for

HOUR_S = 3600.0
FAR_MOST = 10_000


@pytest.fixture
def path(tmp_path):
    return tmp_path / "outbox" / "x.db"


@pytest.fixture
def clock(monkeypatch):
    """The monotonic clock of the outbox, to be set by a test."""

    class Clock:
        now_s = 1000.0

    monkeypatch.setattr("radard.outputs.outbox.time.monotonic", lambda: Clock.now_s)
    return Clock


@pytest.fixture
def opened(path):
    """Open outboxes on one file; all are closed at the end."""
    made = []

    def begin(most=FAR_MOST):
        made.append(Outbox(path, most))
        made[-1].open()
        return made[-1]

    yield begin
    for box in made:
        box.close()


def delivered(box):
    """The ids of all events, each removed as if it were delivered."""
    found = []
    while (item := box.first()) is not None:
        found.append(item.record["id"])
        box.remove(item)
    return found


@pytest.mark.parametrize("damage", ["'{broken'", "'[1]'", "x'ff00fe'", "'null'", "'{\"a\":1e'"])
def test_a_row_that_cannot_be_read_is_skipped_counted_and_said_once(damage, path, opened, caplog):
    box = opened()
    for n in (1, 2, 3):
        box.put(event(n))
    box.close()
    db = sqlite3.connect(path, isolation_level=None)
    db.execute(f"UPDATE outbox SET record = {damage} WHERE n = 2")  # noqa: S608 - a test's own
    db.close()
    box = opened()
    assert delivered(box) == [ulid(1), ulid(3)]
    assert (box.take_unreadable(), box.take_unreadable(), len(box)) == (1, 0, 0)
    assert caplog.text.count("unreadable") == 1


def test_an_event_that_was_put_behind_others_costs_none_of_those_after_it(opened):
    box, found = opened(), []
    box.put(event(1))
    box.defer(box.first())
    for n in (2, 3):
        found += delivered(box)
        box.put(event(n))
    assert found + delivered(box) == [ulid(1), ulid(2), ulid(3)]


def test_late_updates_of_one_event_all_have_keys_of_their_own(opened):
    box = opened()
    for t_s in (1e6 + 0.45, 1e6 + 1.45, 1e6 + 2.45):
        box.put(event(1, phase="update", t_s=t_s))
    assert delivered(box) == [ulid(1)] * 3


def test_delivery_goes_on_behind_a_row_that_cannot_be_read(tmp_path):
    server = WebServer(port := free_port())
    server.close()
    context = SinkContext(sensor="hall", state_dir=tmp_path)
    url, options = f"webhook:http://127.0.0.1:{port}/", SinkOptions(outbox=QUICK)
    sink = open_output(url, options, context)
    for n in (1, 2):
        sink.write(event(n))
    wait_for(lambda: sink.state.n_waiting == 2 and not sink.state.is_ok)
    sink.close(0.3)
    (file,) = (tmp_path / "outbox").glob("*.db")
    db = sqlite3.connect(file, isolation_level=None)
    db.execute("UPDATE outbox SET record = '{' WHERE n = 1")
    db.close()
    server = WebServer(port)
    sink = open_output(url, options, context)
    sink.write(event(3))
    wait_for(lambda: sink.state.n_sent == 2)
    assert sink.state.n_dropped == 1
    sink.close()
    server.close()
    assert [json.loads(b)["id"] for _, _, b in server.posts] == [ulid(2), ulid(3)]


def test_waiting_is_counted_by_a_clock_that_nobody_sets(opened, clock, monkeypatch):
    box = opened()
    box.put(event(1))
    # The wall clock jumps by a year, as when a machine without a battery finds its time server.
    monkeypatch.setattr("radard.outputs.outbox.time.time", lambda: 4e9)
    assert clock.now_s - box.first().put_s == 0.0
    clock.now_s += 2 * HOUR_S
    box.tend()
    box.close()
    # A boot: the monotonic clock begins at another place, and the time that it was off is none.
    clock.now_s = 5.0
    box = opened()
    clock.now_s += HOUR_S
    box.put(event(2))
    ages_s = []
    while (item := box.first()) is not None:
        ages_s.append(clock.now_s - item.put_s)
        box.remove(item)
    assert ages_s == [pytest.approx(3 * HOUR_S), pytest.approx(0.0)]


def test_a_kill_before_the_count_is_noted_makes_nothing_old(path, opened, clock):
    box = opened()
    clock.now_s += 100 * HOUR_S
    box.put(event(1))
    # No `close`, as after a kill.
    db = sqlite3.connect(path, isolation_level=None)
    db.execute("UPDATE outbox SET put_s = 1e300 WHERE n = 1")
    db.close()
    again = opened()
    assert clock.now_s - again.first().put_s == 0.0


def test_an_outbox_of_the_previous_version_is_read(path, opened, clock):
    v1 = """CREATE TABLE outbox (n INTEGER PRIMARY KEY AUTOINCREMENT, key TEXT NOT NULL UNIQUE,
            put_s REAL NOT NULL, record TEXT NOT NULL)"""
    mark = int.from_bytes(b"rdob", "big")
    db = open_database(path, v1, application_id=mark, version=1)
    db.execute("INSERT INTO outbox VALUES (1, 'a', 1.8e9, ?)", (json.dumps(event(1)),))
    db.close()
    box = opened()
    item = box.first()
    assert (item.record["id"], clock.now_s - item.put_s) == (ulid(1), 0.0)


def test_a_disk_that_takes_nothing_costs_no_event_and_is_used_once_it_does(
    path, opened, clock, caplog
):
    path.parent.write_text("where the folder should be\n")
    box = opened()
    assert box.fault.startswith("events are kept in memory only: ")
    for n in (1, 2):
        box.put(event(n))
    first = box.first()
    assert (len(box), first.record["id"]) == (2, ulid(1))
    path.parent.unlink()
    clock.now_s += 60.0
    box.tend()
    assert (box.fault, box.unsaved(), len(box)) == ("", [], 2)
    # It was being delivered while it was written.
    box.remove(first)
    box.close()
    assert delivered(opened()) == [ulid(2)]
    assert caplog.text.count("in memory only") == 1


def test_alarms_are_delivered_without_a_state_directory(tmp_path):
    (tmp_path / "state").write_text("no folder\n")
    server = WebServer()
    context = SinkContext(sensor="hall", state_dir=tmp_path / "state")
    url = f"webhook:http://127.0.0.1:{server.port}/"
    sink = open_output(url, SinkOptions(outbox=QUICK), context)
    sink.write(event(1))
    wait_for(lambda: server.posts and sink.state.n_sent == 1)
    assert sink.state.status == "retrying"
    assert "in memory only" in sink.state.reason
    sink.close()
    server.close()


def test_a_full_disk_keeps_the_order(path, opened):
    box = opened()
    box.put(event(1))
    pages = box._db.execute("PRAGMA page_count").fetchone()[0]
    box._db.execute(f"PRAGMA max_page_count = {pages}")
    large = {**event(2), "reason": "x" * 100_000}
    box.put(large)
    box.put(event(3))
    assert "full" in box.fault
    assert len(box.unsaved()) == 2
    assert delivered(box) == [ulid(1), ulid(2), ulid(3)]


def test_its_files_are_for_their_owner_alone(path, opened):
    before = os.umask(0)
    try:
        opened().put(event(1))
        modes = {file.name: file.stat().st_mode & 0o777 for file in path.parent.iterdir()}
    finally:
        os.umask(before)
    assert set(modes.values()) == {0o600}
    assert "x.db-wal" in modes
    assert path.parent.stat().st_mode & 0o777 == 0o700


def test_what_is_deferred_comes_last_and_is_as_old_as_before(opened, clock):
    box = opened()
    for n in range(3):
        box.put(event(n))
    clock.now_s += 100
    first = box.first()
    box.defer(first)
    assert len(box) == 3
    # Another start finds it so, too.
    box.close()
    box = opened()
    assert len(box) == 3
    for n in (1, 2):
        assert box.first().record["id"] == event(n)["id"]
        box.remove(box.first())
    last = box.first()
    assert (last.key, last.put_s) == (first.key, pytest.approx(first.put_s))
    box.put(event(3))
    assert delivered(box) == [first.record["id"], event(3)["id"]]


def test_what_is_deferred_in_memory_comes_last(clock):
    box = Outbox(None, 10)
    for n in range(3):
        box.put(event(n))
    box.defer(box.first())
    assert delivered(box) == [event(n)["id"] for n in (1, 2, 0)]


def test_the_oldest_go_where_there_is_no_room(opened):
    box = opened(most=3)
    assert sum(box.put(event(n)) for n in range(1, 6)) == 2
    assert delivered(box) == [ulid(n) for n in (3, 4, 5)]
