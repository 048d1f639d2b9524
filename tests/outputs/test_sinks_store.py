"""The SQLite store: one row an event, an end to its growth, `radard events`."""

import json
import sqlite3

import pytest

from radard import cli
from radard.config.sink_table import SinkOptions, StoreSection
from radard.errors import OutputError
from radard.outputs import open_output
from radard.outputs.base import SinkContext
from radard.outputs.store import prune
from radard.outputs.store_query import parse_since, read_events
from tests.sink_helpers import decision, event, hello, status, ulid

NOW_S = 1_800_000_000.0


def filled(path, records, **section):
    options = SinkOptions(store=StoreSection(**section))
    sink = open_output(f"store:{path}", options, SinkContext(sensor="hall", can_wait=True))
    for record in (hello(), *records):
        sink.write(record)
    sink.close()
    return path


@pytest.fixture
def path(tmp_path):
    return tmp_path / "deep" / "radard.db"


def count(path, table):
    db = sqlite3.connect(path)
    n = db.execute(f"SELECT count(*) FROM {table}").fetchone()[0]  # noqa: S608 - a test's own
    db.close()
    return n


def test_an_event_is_one_row_with_its_last_phase(path):
    phases = [event(1), event(1, phase="update", t_s=3.0), event(1, phase="end", t_s=9.0)]
    filled(path, [*phases, event(2, kind="fault"), status("online"), decision(1), decision(2)])
    first, second = read_events(path)
    assert (first.id, first.phase, first.sensor) == (ulid(1), "end", "hall")
    assert first.start_time == "2026-11-21T06:00:01.000Z"
    assert first.end_time is not None
    assert (second.kind, second.end_time) == ("fault", None)
    assert (count(path, "decisions"), count(path, "statuses")) == (2, 1)


def test_an_alarm_keeps_why_it_began_and_its_clip(path, capsys):
    began = {**event(1), "clip": "a.h5"}
    ended = {**event(1, phase="end"), "reason": "nobody seen for 15 s"}
    tamper = event(2, kind="tamper")
    filled(path, [began, ended, tamper, {**tamper, "phase": "update", "reason": "covered"}])
    alarm, changed = read_events(path)
    assert (alarm.phase, alarm.reason, alarm.clip) == ("end", "human at 1.0 m", "a.h5")
    assert changed.reason == "covered"
    assert cli.main(["events", "--store", str(path)]) == 0
    assert "human at 1.0 m" in capsys.readouterr().out


def test_a_run_goes_on_where_the_last_ended(path):
    filled(path, [event(1)])
    filled(path, [event(1, phase="end"), event(2)])
    assert [(e.id, e.phase) for e in read_events(path)] == [(ulid(1), "end"), (ulid(2), "new")]


def test_decisions_can_be_left_out(path):
    filled(path, [decision(1), event(1)], decisions=False)
    assert (count(path, "decisions"), len(read_events(path))) == (0, 1)


def test_what_is_too_old_goes(path):
    filled(path, [event(1), decision(1), status("online")])
    db = sqlite3.connect(path, isolation_level=None)
    prune(db, StoreSection(keep_days=30), NOW_S + 86_400 * 365)
    db.close()
    assert [count(path, table) for table in ("events", "decisions", "statuses")] == [0, 0, 0]


def test_too_large_a_file_shrinks_and_keeps_its_events(path):
    long = "x" * 200
    filled(path, [event(1), *(decision(k, label=long) for k in range(1, 9001))])
    before = path.stat().st_size
    db = sqlite3.connect(path, isolation_level=None)
    prune(db, StoreSection(keep_mb=1, keep_days=36_500), NOW_S)
    newest = db.execute("SELECT max(seq), count(*) FROM decisions").fetchone()
    db.close()
    assert before > 2e6
    assert path.stat().st_size < 1.1e6
    assert newest[0] == 9000
    assert 0 < newest[1] < 9000
    assert len(read_events(path)) == 1


def test_a_damaged_file_is_put_aside(path, caplog):
    filled(path, [event(1)])
    path.write_bytes(b"not a database at all" * 400)
    filled(path, [event(2)])
    assert [e.id for e in read_events(path)] == [ulid(2)]
    assert path.with_name("radard.db.broken").exists()
    assert "put aside" in caplog.text


def test_another_programs_database_is_refused(tmp_path):
    path = tmp_path / "photos.db"
    db = sqlite3.connect(path)
    db.execute("CREATE TABLE photos (n)")
    db.commit()
    db.close()
    with pytest.raises(OutputError, match=r"photos\.db: cannot be used: a database of another"):
        open_output(f"store:{path}", SinkOptions(), SinkContext())
    assert count(path, "photos") == 0


def test_events_command(path, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    filled(path, [event(k, kind="fault" if k == 2 else "alarm") for k in (1, 2, 3)])
    assert cli.main(["events", "--store", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[2] for line in lines[1:]] == ["alarm", "fault", "alarm"]
    tmp_path.joinpath("config.yaml").write_text(f"output: ['store:{path}']\n")
    assert cli.main(["events", "--kind", "alarm", "--limit", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["id"] == ulid(3)
    assert cli.main(["events", "--since", "2026-11-21T07:00"]) == 0
    assert capsys.readouterr().out == "no events\n"


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ([], (2, "no store: give --store FILE")),
        (["--store", "nope.db"], (66, "nope.db: no such store")),
        (["--store", "text.db"], (66, "cannot be read as a store")),
        (["--store", "text.db", "--since", "soon"], (2, "--since 'soon'")),
        (["--store", "text.db", "--limit", "0"], (2, "--limit 0")),
    ],
)
def test_events_command_with_faults(more, expected, capsys, tmp_path, monkeypatch):
    code, words = expected
    monkeypatch.chdir(tmp_path)
    tmp_path.joinpath("text.db").write_text("no database " * 100)
    assert cli.main(["events", *more]) == code
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "s"), [("90s", 90), ("30min", 1800), ("24h", 86_400), ("1.5 d", 129_600)]
)
def test_since(text, s):
    assert parse_since(text, NOW_S) == NOW_S - s


OLD = """
CREATE TABLE events (id TEXT PRIMARY KEY, sensor TEXT NOT NULL, kind TEXT NOT NULL,
    phase TEXT NOT NULL, start_s REAL NOT NULL, end_s REAL, start_t_s REAL NOT NULL,
    end_t_s REAL, peak REAL NOT NULL, reason TEXT NOT NULL, clip TEXT);
CREATE TABLE statuses (n INTEGER PRIMARY KEY, time_s REAL NOT NULL, state TEXT NOT NULL,
    reason TEXT NOT NULL);
CREATE TABLE decisions (n INTEGER PRIMARY KEY, time_s REAL NOT NULL, seq INTEGER NOT NULL,
    t_s REAL NOT NULL, gate TEXT NOT NULL, power_db REAL, threshold_db REAL, p_human REAL,
    p_pet REAL, p_other REAL, label TEXT, alarm INTEGER NOT NULL, range_m REAL);
INSERT INTO events VALUES
    ('OLD', 'hall', 'alarm', 'end', 1.79e9, 1.79e9, 1.0, 2.0, 0.5, 'x', NULL);
PRAGMA application_id=1919185780; PRAGMA user_version=1;
"""


def test_a_store_of_the_first_version_goes_on_and_says_whose_decisions(path):
    path.parent.mkdir()
    db = sqlite3.connect(path)
    db.executescript(OLD)
    db.close()
    assert [e.id for e in read_events(path)] == ["OLD"]
    filled(path, [decision(1), {**decision(1), "sensor": "attic"}, status("online")])
    filled(path, [{**event(1), "sensor": "attic"}])
    db = sqlite3.connect(path)
    assert db.execute("SELECT sensor FROM decisions ORDER BY n").fetchall() == [
        ("hall",),
        ("attic",),
    ]
    db.close()
    assert [(e.id, e.sensor) for e in read_events(path)] == [("OLD", "hall"), (ulid(1), "attic")]


@pytest.mark.parametrize("mark", ["simulated", "replayed", "test", None])
def test_a_store_says_what_was_not_live(path, mark):
    marked = {**event(1), **({mark: True} if mark else {})}
    filled(path, [marked, {**marked, "phase": "end"}])
    (stored,) = read_events(path)
    assert stored.mark == mark
