"""Passages and their tables: nothing is lost between memory, shards and back."""

import json

import numpy as np
import pytest

from radard.errors import UsageError
from tests.report_helpers import drawn, passage, table_of
from tests.shard_helpers import Draws
from x2radar.errors import RecordingError
from x2train.report import PassageTable
from x2train.report.table import FLAGS, NUMBERS, SERIES, TEXTS
from x2train.sets.shard_run import make_shards

COLUMNS = ("n_decisions", *TEXTS, *NUMBERS, *FLAGS, *SERIES)


def assert_same(a, b):
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_passages_come_back_out_of_a_table():
    first = passage([0.1, 0.9], family="walker", suite="walk test", speed_mps=1.0)
    second = passage([], "empty", enters_s=np.nan, family="empty room")
    third = passage([0.99] * 5, "pet", build="dog 7")
    table = table_of(first, second, third)
    assert len(table) == 3
    assert table.first.tolist() == [0, 2, 2, 7]
    assert table.passage.tolist() == [0, 0, 2, 2, 2, 2, 2]
    for k, was in enumerate((first, second, third)):
        for name in (*TEXTS, *NUMBERS, *FLAGS, *SERIES):
            np.testing.assert_array_equal(getattr(table[k], name), getattr(was, name))


def test_empty_table():
    table = table_of()
    assert len(table) == 0
    assert table.t_s.shape == (0,)


def test_table_comes_back_from_disk(tmp_path):
    table = drawn(20)
    table.save(tmp_path, {"what": "test"})
    assert_same(PassageTable.load(tmp_path), table)


def test_shards_of_a_farm_are_a_table(tmp_path):
    make_shards(tmp_path, {}, 7, columns_of, per_shard=3)
    table = PassageTable.load(tmp_path)
    assert table.build.tolist() == [f"build {k}" for k in range(7) if k != 4]
    assert_same(table, table_of(*(made(k) for k in range(7) if k != 4)))


def made(k):
    return passage([0.5] * k, build=f"build {k}")


def columns_of(k):
    return None if k == 4 else made(k).columns()


def test_chosen_passages_keep_their_decisions():
    table = drawn(30)
    keep = table.label == "pet"
    pets = table.chosen(keep)
    assert_same(pets, PassageTable.of(table[k] for k in np.flatnonzero(keep)))


def test_unknown_label_is_refused():
    with pytest.raises(UsageError, match=r"label 'dog': must be one of human, pet, other, empty"):
        table_of(passage([0.5], "dog"))


def test_arrays_of_other_lengths_are_refused():
    with pytest.raises(UsageError, match=r"power_db: shape \(2,\), not \(1,\)"):
        table_of(passage([0.5], power_db=np.zeros(2)))


def test_columns_of_other_lengths_are_refused():
    columns = {name: getattr(drawn(3), name) for name in COLUMNS}
    with pytest.raises(UsageError, match=r"family: shape \(2,\), not \(3,\)"):
        PassageTable(**columns | {"family": np.array(["a", "b"])})


def test_no_set_and_other_sets_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="no set of passages"):
        PassageTable.load(tmp_path / "missing")
    make_shards(tmp_path, {}, 3, Draws())
    with pytest.raises(UsageError, match="without the column 'n_decisions'"):
        PassageTable.load(tmp_path)


def test_damaged_shard_is_refused(tmp_path):
    drawn(3).save(tmp_path, {})
    shard = tmp_path / "shard-00000.npz"
    shard.write_bytes(shard.read_bytes()[:-1] + b"x")
    assert json.loads((tmp_path / "manifest.json").read_text())["shards"]
    with pytest.raises(RecordingError, match="checksum"):
        PassageTable.load(tmp_path)
