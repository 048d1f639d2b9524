"""Intervals: published values, and whether they hold the truth as often as they say."""

import math

import numpy as np
import pytest
from scipy import stats

from x2train.report.intervals import per_hour, resampled, share, wilson
from x2train.report.ranking import Ranking


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    [
        # 1 - 0.025 ** (1 / n), the closed form for none and for all.
        (0, 10, 0.0, 1 - 0.025 ** (1 / 10)),
        (10, 10, 0.025 ** (1 / 10), 1.0),
        (0, 1000, 0.0, 1 - 0.025 ** (1 / 1000)),
    ],
)
def test_share_of_none_and_of_all(count, total, low, high):
    found = share(count, total)
    assert found.value == count / total
    assert (found.low, found.high) == pytest.approx((low, high))


@pytest.mark.parametrize(("count", "total"), [(1, 10), (5, 10), (3, 1000), (999, 1000)])
def test_ends_of_a_share_are_just_not_rejected(count, total):
    found = share(count, total)
    assert stats.binom.sf(count - 1, total, found.low) == pytest.approx(0.025)
    assert stats.binom.cdf(count, total, found.high) == pytest.approx(0.025)


@pytest.mark.parametrize(("count", "total"), [(0, 8), (1, 10), (5, 10), (8, 8), (999, 1000)])
def test_ends_of_wilson_are_where_the_score_test_turns(count, total):
    found = wilson(count, total)
    z = stats.norm.ppf(0.975)
    for end in (found.low, found.high):
        if 0 < end < 1:
            off = (count / total - end) / math.sqrt(end * (1 - end) / total)
            assert abs(off) == pytest.approx(z)
    assert found.low <= found.value <= found.high
    assert (wilson(0, 8).low, wilson(8, 8).high) == pytest.approx((0, 1))


def test_wilson_of_nothing_is_not_known():
    found = wilson(0, 0)
    assert math.isnan(found.value)
    assert (found.low, found.high) == (0.0, 1.0)


def test_share_of_nothing_is_not_known():
    found = share(0, 0)
    assert math.isnan(found.value)
    assert (found.low, found.high) == (0.0, 1.0)


def test_no_alarm_in_h_hours_is_less_than_three_over_h():
    found = per_hour(0, 180.0)
    assert found.value == 0
    assert found.high == pytest.approx(-math.log(0.05) / 180)
    assert found.high == pytest.approx(3 / 180, rel=0.002)


@pytest.mark.parametrize("count", [1, 5, 100])
def test_ends_of_a_rate_are_just_not_rejected(count):
    found = per_hour(count, 2.0)
    assert found.value == count / 2
    assert stats.poisson.sf(count - 1, 2 * found.low) == pytest.approx(0.025)
    assert stats.poisson.cdf(count, 2 * found.high) == pytest.approx(0.025)


def test_rate_without_hours_is_not_known():
    found = per_hour(0, 0.0)
    assert math.isnan(found.value)
    assert found.high == math.inf


@pytest.mark.parametrize("p", [0.002, 0.02, 0.3])
def test_shares_hold_the_truth(p):
    total = 500
    counts = np.arange(total + 1)
    holds = np.array([share(k, total).low <= p <= share(k, total).high for k in counts])
    assert stats.binom.pmf(counts, total, p)[holds].sum() >= 0.95


@pytest.mark.parametrize("mean", [0.5, 3.0, 30.0])
def test_rates_hold_the_truth(mean):
    counts = np.arange(200)
    holds = np.array([per_hour(k, 10).low <= mean / 10 <= per_hour(k, 10).high for k in counts])
    # With no lower end of its own, a count of zero is allowed 5 % instead of 2.5 %.
    assert stats.poisson.pmf(counts, mean)[holds].sum() >= 0.925


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


def test_resampling_is_that_of_its_seed():
    values = np.arange(20.0)

    def mean(weight):
        return float(weight @ values / weight.sum())

    first, again, other = (resampled(mean, 20, np.random.default_rng(k)) for k in (1, 1, 2))
    assert first == again
    assert first != other
    assert first.value == 9.5


def test_resampling_nothing_or_the_unknown():
    rng = np.random.default_rng(0)
    for n in (0, 5):
        found = resampled(lambda _: math.nan, n, rng)
        assert math.isnan(found.value)
        assert math.isnan(found.low)


def test_draws_without_a_figure_are_left_out():
    rng = np.random.default_rng(0)
    found = resampled(lambda w: 1.0 if w[0] else math.nan, 2, rng)
    assert (found.value, found.low, found.high) == (1.0, 1.0, 1.0)


def test_infinite_draws_are_no_trouble():
    times = np.array([1.0, 2.0, np.inf])
    found = resampled(lambda w: float(times[w > 0].max()), 3, np.random.default_rng(0))
    assert found.value == found.high == math.inf
    assert found.low in (1.0, 2.0)


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


def test_auc_of_one_class_is_not_known():
    assert math.isnan(Ranking(np.arange(3.0), np.ones(3, bool)).auc())
    assert math.isnan(Ranking(np.empty(0), np.empty(0, bool)).auc())


def test_rates_at_every_threshold():
    score = np.array([3.0, 2.0, 2.0, 1.0])
    threshold, false, true = Ranking(score, np.array([True, True, False, False])).rates()
    assert threshold.tolist() == [np.inf, 3, 2, 1]
    assert false.tolist() == [0, 0, 0.5, 1]
    assert true.tolist() == [0, 0.5, 1, 1]
