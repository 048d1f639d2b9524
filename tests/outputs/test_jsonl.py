"""JSON Lines files on disks that fail for a while, and who may read what outputs write."""

import errno
import os

import pytest

from radard.config.sink_table import JsonlSection, SinkOptions
from radard.errors import OutputError
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
def test_a_file_goes_on_after_a_full_disk_with_whole_lines_also_at_a_rotation(
    tmp_path, disk, rotate_mb
):
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
    sink = open_sink(f"json:{path}", SinkOptions())
    sink.write(hello())
    sink.write(event(1))
    wait_for(lambda: not sink.state.is_ok)
    disk.is_full = False
    wait_for(lambda: sink.state.n_sent == 2)
    sink.close()
    assert [line["type"] for line in records_in(path)] == ["hello", "event"]
    disk.is_full = True
    with pytest.raises(OutputError, match="cannot write there"):
        open_sink(f"json:{tmp_path / 'b'}", SinkOptions(), can_wait=True)


def test_a_recording_or_a_configuration_gets_no_lines(tmp_path):
    path = tmp_path / "night.h5"
    for text in (b"\x89HDF\r\n\x1a\n", b"sensors:\n"):
        path.write_bytes(text)
        with pytest.raises(OutputError, match="no JSON Lines"):
            open_sink(f"json:{path}", SinkOptions())
        assert path.read_bytes() == text


def test_a_stream_that_waits_is_told_of_a_full_disk_once(tmp_path, disk, caplog):
    """Before, also by a line of the log, which a command without one printed beside its own."""
    sink = open_sink(f"json:{tmp_path / 'a'}", SinkOptions(), can_wait=True)
    disk.is_full = True
    sink.write(hello())
    with pytest.raises(OutputError, match="a: No space left on device"):
        wait_for(lambda: sink.write(hello()))
    sink.write(hello())
    sink.close()
    assert caplog.text == ""


def mode_of(path):
    return path.stat().st_mode & 0o777


@pytest.mark.parametrize("umask", [0, 0o077])
def test_files_are_for_their_owner_alone_whatever_the_umask(tmp_path, umask):
    before = os.umask(umask)
    try:
        for name in ("json:a.jsonl", "store:a.db"):
            scheme, file = name.split(":")
            sink = open_sink(f"{scheme}:{tmp_path / file}", SinkOptions())
            for record in (hello(), status("online"), event(1), decision(1)):
                sink.write(record)
            wait_for(lambda s=sink: s.state.n_sent >= 3 and not s.state.n_waiting)
            modes = {each.name: mode_of(each) for each in tmp_path.iterdir()}
            sink.close()
            assert set(modes.values()) == {0o600}, modes
    finally:
        os.umask(before)


def test_the_mode_of_files_that_are_there_is_left(tmp_path):
    path, store = tmp_path / "a.jsonl", tmp_path / "a.db"
    for file in (path, store):
        file.touch()
        file.chmod(0o640)
    options = SinkOptions(jsonl=JsonlSection(rotate_mb=0.0005))
    sink = open_sink(f"json:{path}", options, sensor="hall")
    for n in range(6):
        sink.write(event(n))
    wait_for(lambda: sink.state.n_sent == 6)
    sink.close()
    other = open_sink(f"store:{store}", SinkOptions())
    other.close()
    # The next file of a rotation is read by whoever read the one before.
    assert (tmp_path / "a.jsonl.2").exists()
    assert {mode_of(each) for each in tmp_path.iterdir()} == {0o640}


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
