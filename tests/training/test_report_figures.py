"""The report's figures: intervals, and passages whose verdicts and windows are known."""

import math

import numpy as np
import pytest
from scipy import stats

from radard.errors import UsageError
from tests.report_helpers import drawn, passage, table_of
from tests.shard_helpers import Draws
from x2radar.errors import RecordingError
from x2train.judge import figures
from x2train.judge.estimates import Ranking, per_hour, reliability, resampled, share
from x2train.judge.table import FLAGS, NUMBERS, SERIES, TEXTS, PassageTable
from x2train.judge.verdicts import Sweep, evidence, limit_evidence, outcome, verdicts
from x2train.sets.shards import make_shards

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
    is_pending, is_open = np.array([is_pending, is_open], bool)
    undecided = passage([0.5] * 3, is_pending=is_pending, is_open=is_open)
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
    return figures.Windows.of(table, figures.is_judged(table) & figures.is_in_view(table))


def test_balanced_accuracy_is_the_mean_of_both_classes_and_confusion_counts_the_likeliest():
    table = table_of(passage([0.1] * 30 + [0.9] * 10), passage([0.9] * 2, "pet"))
    assert figures.balanced_accuracy(table, windows_of(table), np.random.default_rng(0)).value == (
        pytest.approx((29 / 39 + 1) / 2)  # the first window's middle is before it enters
    )
    other = passage([0.9, 0.9], "other", p_pet=np.zeros(2), p_other=np.full(2, 0.9))
    found = figures.confusion(table_of(passage([0.1, 0.9]), passage([0.9], "pet"), other))
    assert found["human"] == {"human": 1, "pet": 1, "other": 0}
    assert found["pet"] == {"human": 0, "pet": 1, "other": 0}
    assert found["other"] == {"human": 0, "pet": 0, "other": 2}
    assert found["empty"] == {"human": 0, "pet": 0, "other": 0}


def baselines_of(table):
    found = figures.baselines(table, windows_of(table), np.random.default_rng(0))
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


@pytest.mark.parametrize(("count", "total"), [(1, 10), (5, 10), (3, 1000), (999, 1000)])
def test_ends_of_a_share_and_of_a_rate_are_just_not_rejected(count, total):
    found = share(count, total)
    assert stats.binom.sf(count - 1, total, found.low) == pytest.approx(0.025)
    assert stats.binom.cdf(count, total, found.high) == pytest.approx(0.025)
    found = per_hour(count, 2.0)
    assert found.value == count / 2
    assert stats.poisson.sf(count - 1, 2 * found.low) == pytest.approx(0.025)
    assert stats.poisson.cdf(count, 2 * found.high) == pytest.approx(0.025)


def test_resampling_holds_the_truth_when_windows_of_a_passage_resemble_each_other():
    """By passage about 95 %; windows drawn singly would hold it far less often."""
    rng = np.random.default_rng(5)
    n_passages, n_windows, held = 40, 20, 0
    for _ in range(200):
        means = rng.normal(size=n_passages)
        values = (means[:, None] + 0.1 * rng.normal(size=(n_passages, n_windows))).mean(axis=1)
        found = resampled(lambda w, v=values: float(w @ v / w.sum()), n_passages, rng, 100)
        held += found.low <= 0 <= found.high
    assert 0.89 <= held / 200 <= 0.99


def brute_auc(score, is_positive, weight):
    total = right = 0.0
    for s, w in zip(score[is_positive], weight[is_positive], strict=True):
        for t, v in zip(score[~is_positive], weight[~is_positive], strict=True):
            total += w * v
            right += w * v * ((s > t) + 0.5 * (s == t))
    return right / total


@pytest.mark.parametrize("seed", range(4))
def test_auc_is_the_share_of_pairs_in_order(seed):
    rng = np.random.default_rng(seed)
    score = rng.integers(0, 6, 60).astype(float)
    score[:2] = np.inf, -np.inf
    is_positive = rng.random(60) < 0.4
    weight = rng.integers(0, 3, 60).astype(float)
    ranking = Ranking(score, is_positive)
    assert ranking.auc(weight) == pytest.approx(brute_auc(score, is_positive, weight))
    assert ranking.auc() == pytest.approx(brute_auc(score, is_positive, np.ones(60)))


def test_rates_at_every_threshold():
    score = np.array([3.0, 2.0, 2.0, 1.0])
    false, true = Ranking(score, np.array([True, True, False, False])).rates()
    assert false.tolist() == [0, 0, 0.5, 1]
    assert true.tolist() == [0, 0.5, 1, 1]


def test_what_is_not_known_says_so():
    rng = np.random.default_rng(0)
    for found in (share(0, 0), per_hour(0, 0.0)):
        assert math.isnan(found.value)
        assert found.low == 0.0
        assert found.high in (1.0, math.inf)
    for n in (0, 5):
        found = resampled(lambda _: math.nan, n, rng)
        assert math.isnan(found.value)
        assert math.isnan(found.low)
    assert math.isnan(Ranking(np.arange(3.0), np.ones(3, bool)).auc())
    assert math.isnan(Ranking(np.empty(0), np.empty(0, bool)).auc())
    # Nothing in H hours is less than 3 / H.
    assert per_hour(0, 180.0).high == pytest.approx(3 / 180, rel=0.002)
    # Draws without a figure are left out, infinite ones are no trouble.
    found = resampled(lambda w: 1.0 if w[0] else math.nan, 2, rng)
    assert (found.value, found.low, found.high) == (1.0, 1.0, 1.0)
    times = np.array([1.0, 2.0, np.inf])
    found = resampled(lambda w: float(times[w > 0].max()), 3, np.random.default_rng(0))
    assert found.value == found.high == math.inf
    assert found.low in (1.0, 2.0)


def reliability_of(p, is_human):
    return reliability(p, is_human, np.arange(len(p)) // 5, np.random.default_rng(0))


def test_calibrated_probabilities_have_no_error_and_others_their_distance():
    rng = np.random.default_rng(0)
    p = rng.random(20_000)
    found = reliability_of(p, rng.random(20_000) < p)
    assert found.error.value < 0.02
    assert sum(b.n for b in found.bins) == 20_000
    assert all(abs(b.share.value - b.mean_p) < 0.05 for b in found.bins)
    assert sum(b.share.low <= b.mean_p <= b.share.high for b in found.bins) >= 8
    found = reliability_of(np.full(100, 0.95), np.arange(100) % 4 > 0)
    assert found.error.value == pytest.approx(0.2)
    assert (found.bins[9].n, found.bins[9].share.value) == (100, 0.75)
    assert math.isnan(found.bins[0].mean_p)
    assert math.isnan(found.bins[0].share.value)
    # Ends of the scale are in bins.
    found = reliability_of(np.array([0.0, 1.0]), np.array([False, True]))
    assert (found.bins[0].n, found.bins[9].n, found.error.value) == (1, 1, 0.0)
    assert math.isnan(reliability_of(np.empty(0), np.empty(0, bool)).error.value)
