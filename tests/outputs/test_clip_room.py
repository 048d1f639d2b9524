"""Room for clips: which go and which stay, whatever clock, card and other copies say."""

import contextlib
import os
import shutil

import pytest

from radard.clips.room import date_last, limit_size, prepare_folder
from radard.errors import OutputError


def clip_of(folder, k, at_s=None):
    """The two files of a clip, of a thousand bytes each."""
    for suffix in ("h5", "png"):
        path = folder / f"{str(k) * 26}.{suffix}"
        path.write_bytes(b"x" * 1000)
        if at_s is not None:
            os.utime(path, (at_s, at_s))
    return path


def kept(folder):
    return "".join(sorted({path.name[0] for path in folder.iterdir()}))


def test_retention_takes_the_oldest_clips_and_nothing_else(tmp_path):
    for k in range(5):
        clip_of(tmp_path, k, 1000 + k)
    (tmp_path / "holiday.h5").write_bytes(b"x" * 10_000)
    limit_size(tmp_path, keep_bytes=6000)
    assert kept(tmp_path) == "234h"
    limit_size(tmp_path, keep_bytes=0)
    assert kept(tmp_path) == "4h"


@pytest.mark.parametrize(
    ("free", "floor", "left"), [(5000, 5000, "012"), (5000, 7000, "12"), (0, 6001, "012")]
)
def test_nothing_is_deleted_unless_that_makes_the_room(tmp_path, monkeypatch, free, floor, left):
    for k in range(3):
        clip_of(tmp_path, k, 1000 + k)
    whole = 6000 + free

    def usage(folder):
        used = sum(path.stat().st_size for path in folder.iterdir())
        return shutil._ntuple_diskusage(whole, used, whole - used)

    monkeypatch.setattr("radard.clips.room.shutil.disk_usage", usage)
    with contextlib.nullcontext() if left != "012" or free else pytest.raises(OutputError):
        prepare_folder(tmp_path, free_bytes=floor)
    assert kept(tmp_path) == left


def test_a_clip_that_a_backup_has_too_makes_no_room_and_stays(tmp_path, monkeypatch):
    folder = tmp_path / "clips"
    folder.mkdir()
    for k in range(3):
        clip_of(folder, k, 1e9 + k)
    for path in folder.iterdir():
        (tmp_path / path.name).hardlink_to(path)
    monkeypatch.setattr(
        "radard.clips.room.shutil.disk_usage", lambda _: shutil._ntuple_diskusage(9000, 9000, 0)
    )
    with pytest.raises(OutputError, match="are free"):
        prepare_folder(folder, free_bytes=1000)
    assert kept(folder) == "012"


@pytest.mark.parametrize("grain_ns", [1, 2 * 10**9], ids=["ext4", "FAT"])
def test_a_clock_that_was_ahead_takes_no_later_clip(tmp_path, grain_ns):
    """Names tell nothing of the order, and a card may keep times to 2 s."""
    for k in (9, 8, 7):
        clip_of(tmp_path, k, 4e9 - 2 * k)
    for k in (6, 5, 4):
        date_last(clip_of(tmp_path, k))
        for path in tmp_path.iterdir():
            kept_ns = path.stat().st_mtime_ns // grain_ns * grain_ns
            os.utime(path, ns=(kept_ns, kept_ns))
        limit_size(tmp_path, keep_bytes=6000)
    assert kept(tmp_path) == "456"
