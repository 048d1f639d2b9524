"""JSON Lines and the SQLite store: what they hold, full disks, modes, and `radard events`."""

import errno
import json
import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from radard import cli
from radard.config.sink_table import JsonlSection, SinkOptions, StoreSection
from radard.errors import OutputError
from radard.log_file import LogFile, open_log_file, parse_since, read_events
from radard.outputs import store as store_module
from radard.outputs.store import prune
from tests.radar_helpers import records_in
from tests.sink_helpers import decision, event, hello, open_sink, status, ulid
from tests.waiting import wait_for


class Disk:
    """A disk that can be full: it takes a piece of a line, and no more."""

    def __init__(self, monkeypatch):
        self.is_full = False
        self._n = 0
        self._plain_write, self._plain_open = os.write, os.open
        monkeypatch.setattr("radard.outputs.jsonl.os.write", self._write)
        monkeypatch.setattr("radard.outputs.jsonl.os.open", self._open)

    def _write(self, fd, data):
        self._n += self.is_full
        if self.is_full and self._n % 2:
            return self._plain_write(fd, data[:7])
        self._refuse(self.is_full)
        return self._plain_write(fd, data)

    def _open(self, path, flags, *mode, **more):
        self._refuse(self.is_full and flags & os.O_CREAT)
        return self._plain_open(path, flags, *mode, **more)

    def _refuse(self, is_full):
        if is_full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.fixture
def disk(monkeypatch):
    return Disk(monkeypatch)


@pytest.mark.parametrize("rotate_mb", [100.0, 0.0005])
def test_a_file_goes_on_after_a_full_disk_with_whole_lines(tmp_path, disk, rotate_mb):
    path = tmp_path / "a.jsonl"
    sink = open_sink(f"json:{path}", SinkOptions(jsonl=JsonlSection(rotate_mb=rotate_mb)))
    for record in (hello(), event(1)):
        sink.write(record)
    wait_for(lambda: sink.state.n_sent == 2)
    disk.is_full = True
    sink.write(event(2))
    wait_for(lambda: sink.state.reason == "No space left on device")
    disk.is_full = False
    wait_for(lambda: sink.state.n_sent == 3)
    assert sink.state.is_ok
    sink.close()
    before = records_in(tmp_path / "a.jsonl.1") if rotate_mb < 1 else []
    # Each file has its hello, and no line is lost.
    ids = [line["id"] for line in (*before, *records_in(path)) if line["type"] == "event"]
    assert (records_in(path)[0]["type"], ids) == ("hello", [ulid(1), ulid(2)])


def test_a_file_that_cannot_be_made_on_a_full_disk_is_made_later(tmp_path, disk):
    path = tmp_path / "a.jsonl"
    disk.is_full = True
    sink = open_sink(f"json:{path}")
    for record in (hello(), event(1)):
        sink.write(record)
    wait_for(lambda: not sink.state.is_ok)
    disk.is_full = False
    wait_for(lambda: sink.state.n_sent == 2)
    sink.close()
    assert [line["type"] for line in records_in(path)] == ["hello", "event"]
    disk.is_full = True
    with pytest.raises(OutputError, match="cannot write there"):
        open_sink(f"json:{tmp_path / 'b'}", can_wait=True)


def test_a_recording_or_a_configuration_gets_no_lines(tmp_path):
    path = tmp_path / "night.h5"
    for text in (b"\x89HDF\r\n\x1a\n", b"sensors:\n"):
        path.write_bytes(text)
        with pytest.raises(OutputError, match="no JSON Lines"):
            open_sink(f"json:{path}")
        assert path.read_bytes() == text


def test_a_stream_that_waits_is_told_of_a_full_disk_once(tmp_path, disk, caplog):
    """Before, also by a line of the log, which a command without one printed beside its own."""
    sink = open_sink(f"json:{tmp_path / 'a'}", can_wait=True)
    disk.is_full = True
    sink.write(hello())
    with pytest.raises(OutputError, match="a: No space left on device"):
        wait_for(lambda: sink.write(hello()))
    sink.write(hello())
    sink.close()
    assert caplog.text == ""


def modes_in(folder):
    return {path.stat().st_mode & 0o777 for path in folder.iterdir()}


@pytest.mark.parametrize("umask", [0, 0o077])
def test_files_are_for_their_owner_alone_whatever_the_umask(tmp_path, umask):
    before = os.umask(umask)
    try:
        for scheme in ("json", "store"):
            sink = open_sink(f"{scheme}:{tmp_path / scheme}")
            for record in (hello(), status("online"), event(1), decision(1)):
                sink.write(record)
            wait_for(lambda s=sink: s.state.n_sent >= 3 and not s.state.n_waiting)
            modes = modes_in(tmp_path)
            sink.close()
            assert modes == {0o600}
    finally:
        os.umask(before)


def test_the_mode_of_files_that_are_there_is_left(tmp_path):
    path, store = tmp_path / "a.jsonl", tmp_path / "a.db"
    for file in (path, store):
        file.touch()
        file.chmod(0o640)
    sink = open_sink(f"json:{path}", SinkOptions(jsonl=JsonlSection(rotate_mb=0.0005)))
    for n in range(6):
        sink.write(event(n))
    wait_for(lambda: sink.state.n_sent == 6)
    sink.close()
    opened(store).close()
    # The reader of one file of a rotation can read the next one.
    assert (tmp_path / "a.jsonl.2").exists()
    assert modes_in(tmp_path) == {0o640}


@pytest.mark.integration
@pytest.mark.parametrize("scheme", ["json", "store", "exec"])
def test_names_with_bytes_that_are_no_text_are_taken(tmp_path, scheme):
    path = tmp_path / os.fsdecode(b"k\xfcche")
    if scheme == "exec":
        path.write_text("#!/bin/sh\ncat > /dev/null\n")
        path.chmod(0o755)
    sink = open_sink(f"{scheme}:{path}", state_dir=tmp_path)
    sink.write({**event(1), "clip": str(path)})
    wait_for(lambda: sink.state.n_sent == 1)
    sink.close()
    assert sink.log.events()[0].clip == str(path)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "deep" / "radard.db"


def opened(path, *, can_wait=False, **section):
    options = SinkOptions(store=StoreSection(**section))
    return open_sink(f"store:{path}", options, can_wait=can_wait)


def filled(path, records, **section):
    sink = opened(path, can_wait=True, **section)
    for record in (hello(), *records):
        sink.write(record)
    sink.close()
    return path


def query(path, text):
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        return db.execute(text).fetchall()


def counts(path):
    tables = ("events", "decisions", "statuses")
    return [query(path, f"SELECT count(*) FROM {table}")[0][0] for table in tables]  # noqa: S608


def ids(path):
    return [each.id for each in read_events(path)]


def test_a_run_goes_on_where_the_last_ended(path):
    filled(path, [event(1), status("online"), decision(1), {**decision(2), "sensor": "attic"}])
    filled(path, [event(1, phase="end", t_s=9.0), {**event(2), "sensor": "attic"}])
    first, second = read_events(path)
    assert (first.id, first.phase, first.sensor, first.end_t_s) == (ulid(1), "end", "hall", 9.0)
    assert (first.start_time, second.sensor) == ("2026-11-21T06:00:01.000Z", "attic")
    assert counts(path) == [2, 2, 1]
    assert query(path, "SELECT sensor FROM decisions ORDER BY n") == [("hall",), ("attic",)]
    assert query(path, "SELECT state, sensor FROM statuses") == [("online", "hall")]


def test_decisions_can_be_left_out(path):
    filled(path, [decision(1), event(1)], decisions=False)
    assert counts(path) == [1, 0, 0]


def test_only_running_time_makes_anything_old(path, monkeypatch):
    filled(path, [event(1), decision(1), status("online")])
    # A clock that is years ahead, and back again.
    monkeypatch.setattr(store_module.time, "time", lambda: 4e9)
    with closing(open_log_file(path)) as db:
        prune(db, StoreSection(keep_days=30))
        assert counts(path) == [1, 1, 1]
        db.execute("UPDATE stand SET run_s = run_s + 31 * 86400")
        prune(db, StoreSection(keep_days=30))
    assert counts(path) == [0, 0, 0]


def test_too_large_a_file_shrinks_and_keeps_its_events(path):
    long = "x" * 200
    filled(path, [event(1), *(decision(k, label=long) for k in range(1, 9001))])
    before = path.stat().st_size
    with closing(open_log_file(path)) as db:
        prune(db, StoreSection(keep_mb=1, keep_days=36_500))
    ((newest, n),) = query(path, "SELECT max(seq), count(*) FROM decisions")
    assert before > 2e6
    assert path.stat().st_size < 1.1e6
    assert (newest, 0 < n < 9000, ids(path)) == (9000, True, [ulid(1)])


@pytest.mark.parametrize("gone", ["damaged", "radard.db", "radard.db-wal"])
def test_a_file_that_is_damaged_or_gone_at_work_is_begun_anew_and_said(path, monkeypatch, gone):
    def check(_file, _every_s):
        monkeypatch.undo()
        error = sqlite3.DatabaseError("database disk image is malformed")
        error.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
        raise error

    if gone == "damaged":
        monkeypatch.setattr(LogFile, "check", check)
    sink = opened(path)
    sink.write(event(1))
    if gone == "damaged":
        wait_for(lambda: "put aside as radard.db.broken" in sink.state.remark)
    else:
        wait_for(lambda: sink.state.n_sent == 1)
        path.with_name(gone).unlink()
    sink.write(event(2))
    wait_for(lambda: sink.state.n_sent == 2)
    sink.close()
    assert ids(path)[-1] == ulid(2)
    if gone == "damaged":
        assert (sink.state.is_ok, ids(path)) == (True, [ulid(2)])
        assert ids(path.with_name("radard.db.broken")) == [ulid(1)]
    else:
        assert "taken away" in sink.state.remark


def test_another_programs_database_is_refused(tmp_path):
    path = tmp_path / "photos.db"
    query(path, "CREATE TABLE photos (n)")
    with pytest.raises(OutputError, match=r"photos\.db: cannot be used: a database of another"):
        opened(path)
    assert query(path, "SELECT count(*) FROM photos") == [(0,)]


def test_events_command(path, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    filled(path, [event(k, kind="fault" if k == 2 else "alarm") for k in (1, 2, 3)])
    assert cli.main(["events", "--store", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[2] for line in lines[1:]] == ["alarm", "fault", "alarm"]
    assert "human at 1.0 m" in lines[1]
    tmp_path.joinpath("config.yaml").write_text(f"output: ['store:{path}']\n")
    assert cli.main(["events", "--kind", "alarm", "--limit", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["id"] == ulid(3)
    assert cli.main(["events", "--since", "2026-11-21T07:00"]) == 0
    assert capsys.readouterr().out == "no events\n"


def test_a_name_that_sqlite_knows_is_a_file_all_the_same(tmp_path, monkeypatch):
    """Before, all went into memory, and a file of that name stayed empty."""
    monkeypatch.chdir(tmp_path)
    assert ids(filled(Path(":memory:"), [event(1)])) == [ulid(1)]


def test_what_is_no_file_and_a_file_of_another_kind_are_left_alone(tmp_path):
    """A typing error took /etc/passwd for a damaged store, which is put aside."""
    other = tmp_path / "passwd"
    other.write_text("root:x:0:0:root:/root:/bin/bash\n")
    with pytest.raises(OutputError, match="passwd: cannot be used: file is not a database"):
        filled(other, [event(1)])
    assert [path.name for path in tmp_path.iterdir()] == ["passwd"]
    assert other.read_text().startswith("root:")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="pipe: cannot be used: it is no file"):
        filled(tmp_path / "pipe", [event(1)])
    assert (tmp_path / "pipe").is_fifo()


def test_events_command_without_a_store_lists_the_daemons_own_log(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RADARD_SERVICE__STATE_DIR", str(tmp_path))
    sink = open_sink("null", state_dir=tmp_path)
    sink.write(event(7))
    sink.close()
    assert cli.main(["events", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["id"] == ulid(7)


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ([], (2, "no store: give --store FILE")),
        (["--store", "nope.db"], (66, "nope.db: no such store")),
        (["--store", "text.db"], (66, "cannot be read as a store")),
        (["--store", "text.db", "--since", "soon"], (2, "since 'soon'")),
        (["--store", "text.db", "--limit", "0"], (2, "--limit 0")),
    ],
)
def test_events_command_with_faults(more, expected, capsys, tmp_path, monkeypatch):
    code, words = expected
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RADARD_SERVICE__STATE_DIR", str(tmp_path))
    tmp_path.joinpath("text.db").write_text("no database " * 100)
    assert cli.main(["events", *more]) == code
    assert words in capsys.readouterr().err


def test_since():
    texts = {"90s": 90, "30min": 1800, "24h": 86_400, "1.5 d": 129_600}
    assert {text: -parse_since(text, 0.0) for text in texts} == texts
