"""Intervals: published values, and whether they hold the truth as often as they say."""

import math

import numpy as np
import pytest
from scipy import stats

from x2train.judge.estimates import Ranking, per_hour, reliability, resampled, share


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
    threshold, false, true = Ranking(score, np.array([True, True, False, False])).rates()
    assert threshold.tolist() == [np.inf, 3, 2, 1]
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
    passage_of = np.arange(len(p)) // 5
    return reliability(p, is_human, passage_of, np.random.default_rng(0))


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
