"""Passages and their tables: nothing is lost between memory, shards and back."""

import numpy as np
import pytest

from radard.errors import UsageError
from tests.report_helpers import passage, table_of
from tests.shard_helpers import Draws
from x2radar.errors import RecordingError
from x2train.judge.table import FLAGS, NUMBERS, SERIES, TEXTS, PassageTable
from x2train.sets.shard_run import make_shards

COLUMNS = ("n_decisions", *TEXTS, *NUMBERS, *FLAGS, *SERIES)


def assert_same(a, b):
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def made(k):
    return None if k == 4 else passage([0.5] * k, build=f"build {k}")


def test_a_table_is_its_passages_in_memory_and_on_disk(tmp_path):
    make_shards(tmp_path, {}, 7, made, per_shard=3)
    table = PassageTable.load(tmp_path)
    assert_same(table, table_of(*(made(k) for k in range(7) if k != 4)))
    assert table.build.tolist() == [f"build {k}" for k in range(7) if k != 4]
    assert table.first.tolist() == [0, 0, 1, 3, 6, 11, 17]
    assert table.passage.tolist() == np.repeat(np.arange(6), [0, 1, 2, 3, 5, 6]).tolist()
    table.save(tmp_path / "again", {"what": "test"})
    assert_same(PassageTable.load(tmp_path / "again"), table)
    assert_same(table.chosen(table.build == "build 3"), table_of(made(3)))
    assert len(table_of()) == 0


def test_what_is_no_passage_is_refused():
    with pytest.raises(UsageError, match=r"label 'dog': must be one of human, pet, other, empty"):
        passage([0.5], "dog")
    with pytest.raises(UsageError, match=r"power_db: shape \(2,\), not \(1,\)"):
        passage([0.5], power_db=np.zeros(2))


def test_no_set_and_other_sets_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="no set of shards"):
        PassageTable.load(tmp_path / "missing")
    make_shards(tmp_path, {}, 3, Draws())
    with pytest.raises(UsageError, match="without the column 'n_decisions'"):
        PassageTable.load(tmp_path)
