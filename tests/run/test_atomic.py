"""Atomic writes: all of the old file or all of the new one, and nothing beside it."""

import os

import pytest

from x2radar.atomic import write_atomically


def test_a_file_and_its_folder_are_made_for_those_who_may_read_them(tmp_path):
    path = tmp_path / "deep" / "file"
    write_atomically(path, "\u00e9\n", mode=0o600)
    assert path.read_bytes() == b"\xc3\xa9\n"
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700
    write_atomically(path, b"new", sync=False)
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o644


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_disk_that_takes_nothing_leaves_what_was_there(call, tmp_path, monkeypatch):
    path = tmp_path / "file"
    write_atomically(path, "old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(*((os, call) if call == "fsync" else (type(path), call)), full)
    with pytest.raises(OSError, match="No space"):
        write_atomically(path, "new")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_file_in_the_way_of_the_folder(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"."):
        write_atomically(tmp_path / "file" / "x", "x")
