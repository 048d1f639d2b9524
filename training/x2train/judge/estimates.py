"""Figures with 95 % intervals: shares, rates per hour, and what only resampling can tell.

Also how well a score tells two classes apart (`Ranking`), and how far probabilities can be relied
on (`reliability`).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import stats

_CONFIDENCE = 0.95  # as usual
_REPLICATES = 200  # a report takes seconds
_BINS = 10  # of a reliability diagram, as usual (Guo et al. 2017 have 15)
_TAIL = (1 - _CONFIDENCE) / 2
_Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A figure and its interval; NaN or infinite where nothing is known."""

    # the figure, and the ends of its 95 % interval
    value: float
    low: float
    high: float

    def __iter__(self) -> Iterator[float]:
        yield from (self.value, self.low, self.high)


def share(count: int, total: int) -> Estimate:
    """Return count / total with the interval of Clopper and Pearson (1934).

    It holds the truth in at least 95 % of cases, for any count; of a total of zero
    everything is possible.

    >>> missed = share(2, 100)
    >>> missed.value, round(missed.low, 4), round(missed.high, 4)
    (0.02, 0.0024, 0.0704)
    """
    if total == 0:
        return Estimate(np.nan, 0.0, 1.0)
    low = stats.beta.ppf(_TAIL, count, total - count + 1) if count > 0 else 0.0
    high = stats.beta.ppf(1 - _TAIL, count + 1, total - count) if count < total else 1.0
    return Estimate(count / total, float(low), float(high))


def per_hour(count: int, hours: float) -> Estimate:
    """Return count / hours with the exact interval of a Poisson count (Garwood 1936).

    Nothing in H hours means less than -ln(0.05) / H, about 3 / H, at 95 %: there is no lower
    end to share the error with.

    >>> none = per_hour(0, 10.0)
    >>> none.low, round(none.high, 4)
    (0.0, 0.2996)
    """
    if hours <= 0:
        return Estimate(np.nan, 0.0, np.inf)
    if count == 0:
        return Estimate(0.0, 0.0, float(-np.log(1 - _CONFIDENCE)) / hours)
    low = stats.chi2.ppf(_TAIL, 2 * count) / 2
    high = stats.chi2.ppf(1 - _TAIL, 2 * count + 2) / 2
    return Estimate(count / hours, float(low) / hours, float(high) / hours)


def resampled(
    statistic: Callable[[_Float], float],
    n_passages: int,
    rng: np.random.Generator,
    replicates: int = _REPLICATES,
) -> Estimate:
    """Return a statistic with a percentile interval of passages drawn with replacement.

    `statistic` takes weights of the passages, shape (n_passages,); NaN is left out. Windows of one
    passage resemble each other, so the passage is what is drawn (a cluster bootstrap). A figure
    that no draw changes, such as an AUC of exactly 1, has an interval of no width: it then says
    less than the number of passages.
    """
    value = statistic(np.ones(n_passages))
    if n_passages == 0 or np.isnan(value):
        return Estimate(value, np.nan, np.nan)
    picks = (rng.integers(n_passages, size=n_passages) for _ in range(replicates))
    draws = np.array(
        [statistic(np.bincount(pick, minlength=n_passages).astype(float)) for pick in picks]
    )
    draws = draws[~np.isnan(draws)]
    if len(draws) == 0:
        return Estimate(value, np.nan, np.nan)
    # Not interpolated: a time to alarm may be infinite, and inf - inf is not a number.
    low, high = np.quantile(draws, [_TAIL, 1 - _TAIL], method="inverted_cdf")
    return Estimate(value, float(low), float(high))


class Ranking:
    """Scores of two classes, (n,), sorted once and weighted as often as needed.

    A higher one speaks for the positive class; infinities are allowed.
    """

    def __init__(self, score: _Float, is_positive: NDArray[np.bool_]) -> None:
        levels, self._level = np.unique(score, return_inverse=True)
        self._n_levels, self._is_positive = len(levels), is_positive

    def auc(self, weight: _Float | None = None) -> float:
        """Return the ROC curve's area (Mann and Whitney 1947), ties half; NaN of one class."""
        positive, negative = self._counts(weight)
        total = positive.sum() * negative.sum()
        if total == 0:
            return float("nan")
        below = np.cumsum(negative) - negative / 2
        return float(positive @ below / total)

    def rates(self) -> tuple[_Float, _Float]:
        """Return false and true positives above every level from infinity down."""
        positive, negative = (
            np.concatenate([[0.0], np.cumsum(counts[::-1])]) / counts.sum()
            for counts in self._counts(None)
        )
        return negative, positive

    def _counts(self, weight: _Float | None) -> tuple[_Float, _Float]:
        weight = np.ones(len(self._level)) if weight is None else weight
        positive = np.bincount(self._level, weight * self._is_positive, self._n_levels)
        negative = np.bincount(self._level, weight * ~self._is_positive, self._n_levels)
        return np.asarray(positive, np.float64), np.asarray(negative, np.float64)


@dataclass(frozen=True, slots=True)
class Bin:
    """Probabilities of one tenth of the scale."""

    n: int
    mean_p: float
    share: Estimate


@dataclass(frozen=True, slots=True)
class Reliability:
    """A reliability diagram and its error."""

    bins: tuple[Bin, ...]  # from 0 to 1, equally wide
    # expected calibration error: mean distance of share and probability (Guo et al. 2017)
    error: Estimate


def reliability(
    p: _Float, is_human: NDArray[np.bool_], passage: NDArray[np.int64], rng: np.random.Generator
) -> Reliability:
    """Return the observed share of people per bin of predicted probability, shape (n,), finite."""
    passages, which = np.unique(passage, return_inverse=True)
    n = len(passages)
    cell = which * _BINS + np.minimum((p * _BINS).astype(np.int64), _BINS - 1)
    # Sums of each passage in each bin: a draw of passages is then one product.
    count, total, human = (
        np.bincount(cell, weight, n * _BINS).reshape(n, _BINS) for weight in (None, p, is_human)
    )

    def error(weight: _Float) -> float:
        n_all = weight @ count.sum(axis=1)
        return float(np.abs(weight @ (total - human)).sum() / n_all) if n_all else float("nan")

    def share_of(weight: _Float, k: int) -> float:
        n_bin = weight @ count[:, k]
        return float(weight @ human[:, k] / n_bin) if n_bin else float("nan")

    shares = [resampled(partial(share_of, k=k), n, rng) for k in range(_BINS)]
    sums = total.sum(axis=0), count.sum(axis=0)
    return Reliability(
        tuple(
            Bin(int(m), float(s / m) if m else float("nan"), observed)
            for s, m, observed in zip(*sums, shares, strict=True)
        ),
        resampled(error, n, rng),
    )
