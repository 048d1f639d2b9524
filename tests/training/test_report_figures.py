"""The report's figures: passages made by hand, whose verdicts and windows are known."""

import math

import numpy as np
import pytest

from radard.errors import UsageError
from tests.report_helpers import drawn, passage, table_of
from tests.shard_helpers import Draws
from x2radar.errors import RecordingError
from x2train.judge.table import FLAGS, NUMBERS, SERIES, TEXTS, PassageTable
from x2train.judge.verdicts import Sweep, evidence, limit_evidence, outcome, verdicts
from x2train.judge.windows import (
    Windows,
    balanced_accuracy,
    baselines,
    confusion,
    is_in_view,
    is_judged,
)
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


def test_no_set_and_other_sets_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="no set of shards"):
        PassageTable.load(tmp_path / "missing")
    make_shards(tmp_path, {}, 3, Draws())
    with pytest.raises(UsageError, match="without the column 'n_decisions'"):
        PassageTable.load(tmp_path)


LIMIT = limit_evidence(0.8)


def outcome_of(table, is_alarm=None):
    found = verdicts(table, table.is_alarm if is_alarm is None else is_alarm)
    return outcome(table, found, np.ones(len(table), bool), np.random.default_rng(0))


def test_quantiles_count_those_who_were_missed():
    late = [passage([0.9] * k + [0.1]) for k in range(8)]
    found = outcome_of(table_of(*late, passage([0.9]), passage([0.9])))
    assert found.median_s.value == 4.0
    assert found.p90_s.value == math.inf


@pytest.mark.parametrize(
    ("is_pending", "is_open", "alarms"),
    [
        # Decided at once; decided later; left with the last decision; left before it.
        ([0, 0, 0], [1, 1, 1], [True, True, True]),
        ([1, 1, 0], [1, 1, 1], [False, False, True]),
        ([1, 1, 1], [1, 1, 1], [False, False, True]),
        ([1, 1, 0], [1, 1, 0], [False, False, True]),
    ],
)
def test_pending_counts_only_as_the_last_word(is_pending, is_open, alarms):
    undecided = passage(
        [0.5] * 3, is_pending=np.array(is_pending, bool), is_open=np.array(is_open, bool)
    )
    # Another passage follows, whose gate is open: it must not be taken for the same target.
    table = table_of(undecided, passage([0.99]))
    assert (evidence(table, "fused") >= LIMIT)[:3].tolist() == alarms


def test_sweep_at_the_limit_is_the_daemons_verdict():
    table = drawn(300)
    swept = verdicts(table, evidence(table, "fused") >= LIMIT)
    shipped = verdicts(table, table.is_alarm)
    assert (swept.alarm_s == shipped.alarm_s).all()
    assert (swept.false_alarms == shipped.false_alarms).all()


@pytest.mark.parametrize("budget_h", [0.01, 0.1, 1.0, 60.0])
def test_limit_for_a_budget_keeps_it_and_no_tighter_than_needed(budget_h):
    table = drawn(400)
    score = evidence(table, "fused")
    sweep = Sweep.of(table, score)
    limit = sweep.limit_for(1 / budget_h)
    allowed = math.floor(sweep.pet_hours / budget_h)
    assert outcome_of(table, score >= limit).n_false_alarms <= allowed
    looser = score >= np.nextafter(limit, -np.inf)
    assert outcome_of(table, looser).n_false_alarms > allowed or np.isinf(np.abs(limit) * 2)


def test_one_alarm_in_exactly_the_hours_of_the_budget_is_allowed():
    pets = [passage([0.99] * 59 + [0.1 + 0.01 * k], "pet") for k in range(60)]
    sweep = Sweep.of(table_of(*pets), evidence(table_of(*pets), "fused"))
    assert sweep.pet_hours == 1.0
    assert (sweep.pet_minute >= sweep.limit_for(1.0)).sum() == 1
    assert (sweep.pet_minute >= sweep.limit_for(0.99)).sum() == 0
    assert (sweep.pet_minute >= sweep.limit_for(1e9)).sum() == 60


def windows_of(table):
    return Windows.of(table, is_judged(table) & is_in_view(table))


def test_balanced_accuracy_is_the_mean_of_both_classes_and_confusion_counts_the_likeliest():
    table = table_of(passage([0.1] * 30 + [0.9] * 10), passage([0.9] * 2, "pet"))
    assert balanced_accuracy(table, windows_of(table), np.random.default_rng(0)).value == (
        pytest.approx((29 / 39 + 1) / 2)  # the first window's middle is before it enters
    )
    other = passage([0.9, 0.9], "other", p_pet=np.zeros(2), p_other=np.full(2, 0.9))
    found = confusion(table_of(passage([0.1, 0.9]), passage([0.9], "pet"), other))
    assert found["human"] == {"human": 1, "pet": 1, "other": 0}
    assert found["pet"] == {"human": 0, "pet": 1, "other": 0}
    assert found["other"] == {"human": 0, "pet": 0, "other": 2}
    assert found["empty"] == {"human": 0, "pet": 0, "other": 0}


def baselines_of(table):
    found = baselines(table, windows_of(table), np.random.default_rng(0))
    return {b["name"]: b for b in found}


def test_feature_that_tells_without_a_direction_is_found_out():
    rng = np.random.default_rng(3)
    near_and_far = [(*rng.choice([0.6, 2.9], 1), "human") for _ in range(100)]
    between = [(1.7, "pet") for _ in range(100)]
    table = table_of(
        *(
            passage([0.5] * 4, label, target_range_m=r + 0.2 * rng.normal(size=4), enters_s=0.5)
            for r, label in near_and_far + between
        )
    )
    found = baselines_of(table)["range"]
    assert found["auc"].value < 0.6
    assert found["auc_binned"] > 0.95
    assert not found["is_below"]
