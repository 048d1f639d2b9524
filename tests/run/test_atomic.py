"""Atomic writes: all of the old file or all of the new one, and nothing beside it."""

import os

import pytest

from x2radar.atomic import whole_file, write_atomically


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


def test_a_link_stays_a_link_and_leads_to_the_new_file(tmp_path):
    """As of a setting that lies on another disk; before, the link was replaced."""
    (tmp_path / "disk").mkdir()
    link = tmp_path / "file"
    link.symlink_to("disk/kept")
    for text in ("new", "newer"):
        write_atomically(link, text)
        assert (link.is_symlink(), (tmp_path / "disk" / "kept").read_text()) == (True, text)
    assert [each.name for each in (tmp_path / "disk").iterdir()] == ["kept"]


def test_what_is_no_file_is_written_to_and_not_replaced(tmp_path):
    """Before, root lost /dev/null to a file of that name."""
    pipe = tmp_path / "null"
    os.mkfifo(pipe)
    end = os.open(pipe, os.O_RDWR)
    try:
        write_atomically(pipe, "text")
        with whole_file(pipe) as lent:
            assert lent == pipe
        assert (os.read(end, 99), pipe.is_fifo()) == (b"text", True)
    finally:
        os.close(end)


def test_a_file_in_the_way_of_the_folder(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"."):
        write_atomically(tmp_path / "file" / "x", "x")
