"""Sets of shards: the same ones on any worker, and whatever happens on the way."""

import errno
import json
import os
import signal

import numpy as np
import pytest

from radard.errors import RadardError, UsageError
from tests.processes import started
from tests.shard_helpers import Draws
from tests.waiting import wait_for
from x2radar.errors import RecordingError
from x2train.sets.shards import MANIFEST, ShardSet, make_shards
from x2train.sets.workers import Crew

N, PER_SHARD = 53, 20
ABOUT = {"set": "test", "rate": 60}
ARRAYS = {"x": np.arange(12, dtype=np.float32).reshape(4, 3), "y": np.array([0, 1, 0, 1])}


@pytest.fixture
def made(tmp_path):
    kept = ShardSet(tmp_path / "set", ABOUT)
    kept.write("a", ARRAYS)
    return kept


def test_what_is_written_is_read_by_a_later_run(made):
    later = ShardSet(made.folder, ABOUT)
    assert list(later.names()) == ["a"]
    assert "b" not in later
    for key, value in later.read("a").items():
        assert value.dtype == ARRAYS[key].dtype
        np.testing.assert_array_equal(value, ARRAYS[key])
    assert not list(made.folder.glob(".*"))
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


def test_a_full_disk_leaves_the_set_as_it_was(made, monkeypatch):
    def full_disk(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(RecordingError, match=r"b\.npz: cannot write: No space left"):
        made.write("b", ARRAYS)
    monkeypatch.undo()
    later = ShardSet(made.folder, ABOUT)
    assert list(later.names()) == ["a"]
    assert not list(made.folder.glob(".*"))
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


def checksums(folder):
    shards = json.loads((folder / "manifest.json").read_text())["shards"]
    return {name: shard["sha256"] for name, shard in shards.items()}


def make(folder, draws, n=N, **more):
    return make_shards(folder, {"seed": draws.seed}, n, draws, Crew(**more), per_shard=PER_SHARD)


@pytest.fixture(autouse=True)
def pinned(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")


@pytest.fixture
def alone(tmp_path):
    """Checksums of the set made in this process."""
    make(tmp_path / "alone", Draws())
    return checksums(tmp_path / "alone")


def test_rows_of_all_elements_in_order(tmp_path):
    shards = make(tmp_path, Draws())
    assert list(shards.names()) == ["shard-00000", "shard-00001", "shard-00002"]
    kept = [k for k in range(N) if k % 5 != 4]
    parts = [shards.read(name) for name in shards.names()]
    names = np.concatenate([part["name"] for part in parts])
    assert names.tolist() == [f"element {k}" for k in kept]
    x = np.concatenate([part["x"] for part in parts])
    assert np.array_equal(x, np.concatenate([Draws()(k)["x"] for k in kept]))
    assert x.dtype == np.float32
    assert [len(part["name"]) for part in parts] == [16, 16, 11]


@pytest.mark.integration
def test_two_workers_give_the_same_bytes(tmp_path, alone):
    draws = Draws(meets=2, log=tmp_path / "log")
    make(tmp_path / "two", draws, workers=2)
    assert checksums(tmp_path / "two") == alone
    numbers, processes = draws.made()
    assert sorted(numbers) == list(range(N))
    assert len(processes) == 2
    assert os.getpid() not in processes


@pytest.mark.integration
@pytest.mark.parametrize("workers", [1, 2])
def test_failed_element_is_named_and_the_run_goes_on_later(tmp_path, alone, workers):
    with pytest.raises(RadardError, match=r"^element 25: ValueError: bad draw$"):
        make(tmp_path, Draws(fails_at=25), workers=workers)
    draws = Draws(log=tmp_path / "log")
    make(tmp_path, draws)
    assert draws.made()[0] == list(range(PER_SHARD, N))
    assert checksums(tmp_path) == alone


@pytest.mark.integration
def test_progress_counts_to_the_end_and_on_from_earlier(tmp_path):
    told = []
    make(tmp_path, Draws(), report=lambda *now: told.append(now))
    assert told == [(done, N) for done in (0, 8, 16, 20, 28, 36, 40, 48, 53)]
    (tmp_path / "shard-00001.npz").unlink()
    told.clear()
    make(tmp_path, Draws(), report=lambda *now: told.append(now))
    assert told == [(done, N) for done in (33, 41, 49, 53)]
    # A dead worker is told.
    with pytest.raises(RadardError, match="run again to go on"):
        make(tmp_path / "dead", Draws(dies_at=30), workers=2)


@pytest.mark.integration
def test_ctrl_c_ends_cleanly_and_the_run_goes_on(tmp_path, alone):
    code = (
        "import sys; from pathlib import Path; from tests.shard_helpers import Draws\n"
        "from x2train.sets.shards import make_shards\n"
        "from x2train.sets.workers import Crew\n"
        "if __name__ == '__main__':\n"
        "    folder = Path(sys.argv[1])\n"
        "    try:\n"
        "        draws = Draws(1, waits_at=30, log=folder / 'log')\n"
        "        make_shards(folder / 'set', {'seed': 1}, 53, draws, Crew(2), per_shard=20)\n"
        "    except KeyboardInterrupt:\n"
        "        print('ended')\n"
    )
    script = tmp_path / "script.py"
    script.write_text(code)
    process = started(script, tmp_path, text=True, start_new_session=True)
    draws = Draws(log=tmp_path / "log")
    manifest = tmp_path / "set" / "manifest.json"
    wait_for(lambda: manifest.exists() and "shard-00000" in manifest.read_text())
    wait_for(lambda: 30 in draws.made()[0])
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (out, err) == ("ended\n", "")
    draws.log.unlink()
    make(tmp_path / "set", draws)
    assert min(draws.made()[0]) == 20
    assert checksums(tmp_path / "set") == alone


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as made:
        yield made


@pytest.mark.integration
def test_cluster_gives_the_same_bytes_also_when_a_worker_is_killed(tmp_path, alone, cluster):
    draws = Draws(killed_once_at=25, meets=2, log=tmp_path / "log")
    make(tmp_path / "cluster", draws, cluster=cluster.scheduler_address)
    assert checksums(tmp_path / "cluster") == alone
    numbers, processes = draws.made()
    assert numbers.count(25) == 2
    assert set(numbers) == set(range(N))
    assert len(processes) >= 2
