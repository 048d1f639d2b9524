import errno
import os

import numpy as np
import pytest

from radard.errors import UsageError
from x2radar.errors import RecordingError
from x2train.sets.shards import MANIFEST, ShardSet

ABOUT = {"set": "test", "rate": 60}
ARRAYS = {"x": np.arange(12, dtype=np.float32).reshape(4, 3), "y": np.array([0, 1, 0, 1])}


@pytest.fixture
def made(tmp_path):
    kept = ShardSet(tmp_path / "set", ABOUT)
    kept.write("a", ARRAYS)
    return kept


def hidden(folder):
    return [p.name for p in folder.iterdir() if p.name.startswith(".")]


def test_what_is_written_is_read_by_a_later_run(made):
    later = ShardSet(made.folder, ABOUT)
    assert list(later.names()) == ["a"]
    assert "b" not in later
    for key, value in later.read("a").items():
        assert value.dtype == ARRAYS[key].dtype
        np.testing.assert_array_equal(value, ARRAYS[key])
    assert not hidden(made.folder)
    # A set that was made otherwise is refused.
    with pytest.raises(UsageError, match="made otherwise \\(rate: 60, not 200\\)"):
        ShardSet(made.folder, ABOUT | {"rate": 200})


@pytest.mark.parametrize("byte", [0, 100, -1])
def test_a_wrong_checksum_is_one_line(made, byte):
    path = made.folder / "a.npz"
    data = bytearray(path.read_bytes())
    data[byte] ^= 1
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"a\.npz: its checksum is not that of") as caught:
        made.read("a")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"version": 1}', '{"version": 9, "about": {}, "shards": {}}', "\xff"]
)
def test_a_damaged_manifest(made, text):
    (made.folder / MANIFEST).write_bytes(text.encode("latin-1"))
    with pytest.raises(RecordingError, match="remove the folder"):
        ShardSet(made.folder, ABOUT)


def full_disk(descriptor):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_leaves_the_set_as_it_was(made, monkeypatch):
    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(RecordingError, match=r"b\.npz: cannot write: No space left"):
        made.write("b", ARRAYS)
    monkeypatch.undo()
    later = ShardSet(made.folder, ABOUT)
    assert list(later.names()) == ["a"]
    assert not hidden(made.folder)
    later.write("b", ARRAYS)
    assert list(ShardSet(made.folder, ABOUT).names()) == ["a", "b"]


def test_a_shard_that_is_gone_is_due_again_and_a_half_one_not_trusted(made):
    (made.folder / ".b.npz.123.new").write_bytes(b"half")
    (made.folder / "c.npz").write_bytes(b"never entered")
    later = ShardSet(made.folder, ABOUT)
    assert list(later.names()) == ["a"]
    assert "c" not in later
    (made.folder / "a.npz").unlink()
    assert "a" not in made
    assert list(made.names()) == []
    with pytest.raises(RecordingError, match=r"a\.npz: cannot read"):
        made.read("a")
