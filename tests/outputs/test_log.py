"""The event log by itself: what its file promises, slow disks, files that are not ours."""

import sqlite3
import time
from contextlib import closing

import pytest

from radard import log as log_module
from radard.log import EventLog
from radard.log_file import LogFile, StoreError, fold_events, newest_events, read_events
from tests.sink_helpers import event, status, ulid
from tests.waiting import wait_for


@pytest.fixture
def path(tmp_path):
    return tmp_path / "state" / "log.db"


@pytest.fixture
def opened(path):
    made = []

    def begin(**more):
        for each in made:
            each.close()
        made.append(EventLog(path, **more))
        return made[-1]

    yield begin
    for each in made:
        each.close()


@pytest.fixture
def log(opened):
    return opened()


def everything(_record):
    return True


def ids(cursor):
    """The ids of all that is owed, each delivered by that."""
    found = []
    while (entry := cursor.first()) is not None:
        found.append(entry.record["id"])
        cursor.done(entry)
    return found


def filled(log, n=3):
    for k in range(1, n + 1):
        log.append(event(k))


@pytest.mark.parametrize("was_there", [True, False])
def test_an_output_that_is_new_or_was_absent_begins_with_what_comes_next(opened, was_there):
    if was_there:
        ids(opened().cursor("a", everything))
    filled(opened())
    log = opened()
    cursor = log.cursor("a", everything)
    log.append(event(4))
    assert ids(cursor) == [ulid(4)]


def test_an_output_with_another_filter_keeps_what_it_is_owed(log):
    log.cursor("a", everything)
    log.append(event(1, kind="fault"))
    log.append(event(2))
    cursor = log.cursor("a", lambda record: record["kind"] == "alarm")
    assert ids(cursor) == [ulid(2)]
    log.forget("a")
    log.append(event(3))
    assert ids(cursor) == []


def test_what_was_put_off_stays_so_whatever_its_place_and_whoever_takes_over(log):
    cursor = log.cursor("a", everything)
    filled(log, 4)
    _, second, third, _ = cursor.waiting()
    cursor.defer(third)
    cursor.defer(second)
    cursor.defer(third)
    assert ids(log.cursor("a", everything)) == [ulid(k) for k in (1, 4, 2, 3)]


def test_a_cursor_says_what_waits_in_order_and_up_to_a_record(log):
    cursor = log.cursor("a", everything)
    filled(log, 4)
    first, second, third, _ = cursor.waiting()
    assert (len(cursor), cursor.first()) == (4, first)
    cursor.defer(first)
    waiting = [entry.record["id"] for entry in cursor.waiting()]
    assert (len(cursor), waiting) == (4, [ulid(k) for k in (2, 3, 4, 1)])
    assert cursor.waiting(event(3)) == [second, third]
    assert cursor.waiting(event(2)) == [second]
    cursor.done(third)
    cursor.done(third)
    cursor.defer(third)
    assert cursor.waiting(event(3)) == []
    assert [entry.record["id"] for entry in cursor.waiting(event(4))] == [ulid(2), ulid(4)]
    assert len(cursor) == 3


@pytest.mark.parametrize("act", ["done", "defer"])
def test_what_a_cursor_does_alone_is_written(opened, log, path, act, monkeypatch):
    """Also when nothing is appended that would be written with it, and at once."""
    monkeypatch.setattr(log_module, "_TEND_S", 3600.0)
    cursor = log.cursor("a", everything)
    filled(log, 3)
    log.keep("word", "before")
    getattr(cursor, act)(cursor.first())
    rest = [ulid(2), ulid(3), *[ulid(1)] * (act == "defer")]
    place = "SELECT done, seen, deferred FROM cursors WHERE name = 'a'"
    expected = (1, 3, "[1]" if act == "defer" else "[]")
    with closing(sqlite3.connect(path)) as db:
        wait_for(lambda: db.execute(place).fetchone() == expected)
    assert ids(opened().cursor("a", everything)) == rest


def test_only_who_wants_a_record_hears_that_there_is_one(log):
    heard = []
    for name, wants in (("a", everything), ("b", lambda _: False)):
        log.cursor(name, wants).on_put = lambda name=name: heard.append(name)
    log.append(event(1))
    assert heard == ["a"]


def test_what_is_on_is_known_to_the_next_run_too(opened):
    log = opened()
    for record in (event(1), event(2), event(2, phase="end"), event(1, phase="update")):
        log.append(record)
    for each in (log, opened()):
        assert [(on["id"], on["phase"]) for on in each.open_events()] == [(ulid(1), "update")]


def test_what_an_output_never_had_is_nothing_that_was_lost(opened):
    log = opened(max_events=2)
    cursor = log.cursor("a", lambda record: record["kind"] == "alarm")
    log.append(event(1, kind="fault"))
    log.append(event(2))
    cursor.defer(cursor.first())
    filled(log, 2)
    assert (cursor.n_lost, ids(cursor)) == (1, [ulid(1), ulid(2)])


def test_numbers_and_keys_are_never_given_twice_also_when_nothing_is_left(opened, path):
    log, keys, numbers = opened(), set(), []
    for _ in range(3):
        entries = [log.append(event(1)) for _ in range(2)]
        keys |= {entry.key for entry in entries}
        numbers += [entry.n for entry in entries]
        log.close()
        with closing(sqlite3.connect(path)) as db, db:
            db.execute("DELETE FROM log")
        log = opened()
    assert len(keys) == 6
    assert numbers == sorted(set(numbers))


def test_too_many_events_drop_the_oldest_and_that_is_said(opened, caplog):
    log = opened(max_events=3)
    cursor, other = log.cursor("a", everything), log.cursor("b", everything)
    filled(log, 3)
    ids(other)
    assert log.fault == ""
    filled(log, 2)
    assert (cursor.n_lost, other.n_lost) == (2, 0)
    assert "the oldest were dropped" in log.fault
    assert caplog.text.count("the oldest were dropped") >= 1
    assert ids(cursor) == [ulid(3), ulid(1), ulid(2)]


def test_a_disk_that_hangs_delays_an_event_by_half_a_second_at_most(opened, log, path):
    cursor = log.cursor("a", everything)
    with closing(sqlite3.connect(path)) as db:
        db.execute("BEGIN EXCLUSIVE")
        began_s = time.monotonic()
        log.append(event(1))
        log.keep("panel", "armed")
        # After a second the file is given up, and that is said.
        assert log.why_lost("panel", "armed") != ""
        # Two waits of half a second, on a machine that may be busy.
        assert time.monotonic() - began_s < 3.0
        assert cursor.first().record["id"] == ulid(1)
    wait_for(lambda: log.why_lost("panel", "armed") == "")
    assert ids(opened().cursor("a", everything)) == [ulid(1)]


def test_what_came_before_the_file_could_be_read_comes_behind_what_it_holds(opened, log, path):
    log.cursor("a", everything)
    filled(log, 2)
    log.keep("panel", "armed")
    log.close()
    aside = path.with_name("aside")
    path.rename(aside)
    path.mkdir()
    log = opened()
    cursor = log.cursor("a", everything)
    log.append(event(3))
    assert "in memory only" in log.fault
    assert log.why_lost("panel", "anything") in log.fault
    path.rmdir()
    aside.rename(path)
    log.append(event(4))
    assert log.fault == ""
    assert log.kept("panel") == "armed"
    assert ids(cursor) == [ulid(k) for k in (1, 2, 3, 4)]


def test_a_file_that_comes_late_tells_no_output_of_what_was_before_its_time(opened, path):
    ids(opened().cursor("a", everything))
    log = opened()
    filled(log)
    log.close()
    aside = path.rename(path.with_name("aside"))
    path.mkdir()
    log = opened()
    cursor = log.cursor("a", everything)
    log.append(event(4))
    path.rmdir()
    aside.rename(path)
    log.append(event(5))
    assert [each.record["id"] for each in cursor.waiting()] == [ulid(4), ulid(5)]


def test_waiting_is_counted_by_a_clock_that_nobody_sets(opened, path, monkeypatch):
    now_s = [1000.0]
    monkeypatch.setattr(log_module.time, "monotonic", lambda: now_s[0])
    log = opened()
    log.cursor("a", everything)
    log.append(event(1))
    now_s[0] += 7200.0
    log.keep("any", "word")
    # A boot: the monotonic clock begins at another place, and the time that it was off is none.
    log.close()
    now_s[0] = 5.0
    log = opened()
    assert now_s[0] - log.cursor("a", everything).first().put_s == pytest.approx(7200.0)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("UPDATE log SET run_s = 1e300")
    log = opened()
    assert now_s[0] - log.cursor("a", everything).first().put_s == pytest.approx(0.0)


@pytest.mark.parametrize("damage", ["'{broken'", "'[1]'", "x'ff00fe'", "'null'", "'{\"a\":1e'"])
def test_a_row_that_cannot_be_read_is_skipped_and_said(damage, path, opened, log, caplog):
    log.cursor("a", everything)
    filled(log)
    log.close()
    with closing(sqlite3.connect(path)) as db, db:
        db.execute(f"UPDATE log SET record = {damage} WHERE n = 2")  # noqa: S608 - a test's own
    log = opened()
    assert ids(log.cursor("a", everything)) == [ulid(1), ulid(3)]
    assert "entry 2 is unreadable" in log.fault
    assert [e.id for e in read_events(path)] == [ulid(1), ulid(3)]


def test_a_damaged_file_is_put_aside_and_said_for_an_hour(path, opened, caplog):
    filled(opened())
    opened().close()
    path.write_bytes(b"no database at all" * 400)
    log = opened()
    assert path.with_name("log.db.broken").read_bytes().startswith(b"no database")
    assert "put aside as log.db.broken" in log.fault
    log.append(event(4))
    assert [e.id for e in read_events(path)] == [ulid(4)]


@pytest.mark.parametrize("gone", ["log.db", "log.db-wal", "log.db-shm"])
def test_whatever_part_of_the_file_is_taken_away_nothing_is_lost(path, opened, log, gone):
    filled(log)
    path.with_name(gone).unlink()
    log.append(event(4))
    assert "taken away" in log.fault
    assert [e.id for e in opened().events()] == [ulid(k) for k in range(1, 5)]


def test_a_file_that_goes_while_it_is_checked_is_written_again(path, opened, log, monkeypatch):
    filled(log)
    whole = LogFile.check

    def check(_file, _every_s):
        monkeypatch.setattr(LogFile, "check", whole)
        path.unlink()
        msg = "unable to open database file"
        raise sqlite3.OperationalError(msg)

    monkeypatch.setattr(LogFile, "check", check)
    monkeypatch.setattr(log_module, "_WAIT_S", 60.0)
    log.append(event(4))
    assert "in memory only" in log.fault
    log.append(event(5))
    assert "taken away" in log.fault
    assert [e.id for e in opened().events()] == [ulid(k) for k in range(1, 6)]


def test_another_programs_database_is_left_alone(path, opened):
    path.parent.mkdir()
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("CREATE TABLE photos (n)")
    before = path.read_bytes()
    log = opened()
    log.append(event(1))
    assert "a database of another program" in log.fault
    assert path.read_bytes() == before
    with pytest.raises(StoreError, match="another program"):
        read_events(path)


def test_a_log_of_a_newer_version_is_left_alone(path, opened):
    filled(opened(), 1)
    opened().close()
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA user_version = 99")
    assert "newer version" in opened().fault


def test_the_file_is_for_its_owner_alone(path, opened):
    filled(opened())
    assert {each.stat().st_mode & 0o777 for each in path.parent.iterdir()} == {0o600}


def test_without_events_the_file_has_what_is_kept_alone(path, opened):
    log = opened(keeps_events=False)
    cursor = log.cursor("a", everything)
    log.append(event(1))
    log.keep("panel", "armed")
    assert ids(cursor) == [ulid(1)]
    log = opened(keeps_events=False)
    assert (log.kept("panel"), log.events()) == ("armed", [])


def test_phases_become_one_event_in_memory_in_the_file_and_in_sql_alike(path, log):
    began = {**event(1), "clip": "a.h5", "peak": 0.5, "sensor": "hall", "simulated": True}
    tamper = {**event(2, kind="tamper"), "sensor": "hall"}
    for record in (
        began,
        tamper,
        {**began, "phase": "update", "peak": 0.9, "reason": "gone", "t_s": 2.0, "clip": None},
        {**tamper, "phase": "update", "reason": "covered"},
        {**began, "phase": "end", "reason": "nobody seen", "t_s": 9.0},
        {**status("online"), "time": "2026-11-21T06:00:00.500Z", "sensor": "hall"},
    ):
        log.append(record)
    first, second = log.events()
    told = (first.phase, first.reason, first.peak, first.clip, first.end_t_s, first.mark)
    assert told == ("end", "human at 1.0 m", 0.9, "a.h5", 9.0, "simulated")
    assert (second.reason, second.end_time) == ("covered", None)
    assert read_events(path) == log.events()
    assert newest_events(log.events(), kinds=("tamper",)) == [second]
    assert newest_events(fold_events([began]), since_s=2e9) == []
    assert (first.lasted_s, second.lasted_s) == (8.0, None)
    columns = "id, sensor, kind, phase, start_t_s, end_t_s, peak, reason, clip, mark"
    with closing(sqlite3.connect(path)) as db:
        rows = db.execute(f"SELECT {columns} FROM events").fetchall()  # noqa: S608
        (state,) = db.execute("SELECT time_s, state, sensor FROM statuses").fetchall()
    assert rows == [tuple(getattr(e, c) for c in columns.split(", ")) for e in log.events()]
    assert (round(state[0], 3), *state[1:]) == (1795240800.5, "online", "hall")


@pytest.mark.parametrize(
    ("began", "ended", "start_t_s", "lasted_s"),
    [
        # The clock was set while it lasted: forward by years, back by an hour.
        ("1970-01-01T00:00:10.000Z", "2026-11-21T06:00:00.000Z", 1.0, 8.0),
        ("2026-11-21T06:00:00.000Z", "2026-11-21T05:00:08.000Z", 1.0, 8.0),
        # Over a restart of the daemon, which begins to count again.
        ("2026-11-21T06:00:00.000Z", "2026-11-21T06:10:00.000Z", 0.0, 600.0),
        ("2026-11-21T06:00:00.000Z", "2026-11-21T05:00:08.000Z", 0.0, None),
    ],
)
def test_how_long_an_event_lasted_is_not_a_matter_of_the_clock(began, ended, start_t_s, lasted_s):
    first = {**event(1), "time": began}
    last = {**event(1, phase="end", t_s=9.0), "time": ended, "start_t_s": start_t_s}
    (told,) = fold_events([first, last])
    assert told.lasted_s == lasted_s
