"""Figures with 95 % intervals: shares, rates per hour, and what only resampling can tell."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

CONFIDENCE = 0.95  # as usual
REPLICATES = 200  # chosen: a report takes seconds
_TAIL = (1 - CONFIDENCE) / 2


@dataclass(frozen=True, slots=True)
class Estimate:
    """A figure and its interval; NaN or infinite where nothing is known."""

    # the figure, and the ends of its 95 % interval
    value: float
    low: float
    high: float


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


def wilson(count: int, total: int) -> Estimate:
    """Return count / total with the score interval of Wilson (1927).

    It is shorter than that of Clopper and Pearson and holds the truth in 95 % of cases on the
    average of shares, not for every one; of a total of zero everything is possible.
    """
    if total == 0:
        return Estimate(np.nan, 0.0, 1.0)
    z = float(stats.norm.ppf(1 - _TAIL))
    p = count / total
    middle = (p + z**2 / (2 * total)) / (1 + z**2 / total)
    half = z / (1 + z**2 / total) * float(np.sqrt(p * (1 - p) / total + (z / (2 * total)) ** 2))
    return Estimate(p, max(0.0, middle - half), min(1.0, middle + half))


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
        return Estimate(0.0, 0.0, float(-np.log(1 - CONFIDENCE)) / hours)
    low = stats.chi2.ppf(_TAIL, 2 * count) / 2
    high = stats.chi2.ppf(1 - _TAIL, 2 * count + 2) / 2
    return Estimate(count / hours, float(low) / hours, float(high) / hours)


def resampled(
    statistic: Callable[[NDArray[np.float64]], float],
    n_passages: int,
    rng: np.random.Generator,
    replicates: int = REPLICATES,
) -> Estimate:
    """Return a statistic with a percentile interval of passages drawn with replacement.

    Windows of one passage resemble each other, so the passage is what is drawn (a cluster
    bootstrap). A figure that no draw changes, such as an AUC of exactly 1, has an interval
    of no width: it then says less than the number of passages.

    Parameters
    ----------
    statistic : callable
        Weights of the passages, shape (n_passages,), to the figure; NaN is left out.
    n_passages : int
        How many there are.
    rng : Generator
        For the draws.
    replicates : int
        How often to draw.
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
