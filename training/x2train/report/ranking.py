"""Ranking: how well a score tells two classes apart, at every threshold."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

_Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Ranking:
    """Scores of two classes, sorted once and weighted as often as needed."""

    score: _Float  # (n,): higher speaks for the positive class; infinities are allowed
    is_positive: NDArray[np.bool_]
    levels: _Float = field(init=False)
    _level: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        levels, level = np.unique(self.score, return_inverse=True)
        object.__setattr__(self, "levels", levels)
        object.__setattr__(self, "_level", level)

    def auc(self, weight: _Float | None = None) -> float:
        """Return the area under the ROC curve; ties count half. NaN without both classes.

        It is the probability that a positive scores above a negative (Mann and Whitney
        1947). `weight`, shape (n,), counts every score that often.
        """
        positive, negative = self._counts(weight)
        total = positive.sum() * negative.sum()
        if total == 0:
            return float("nan")
        below = np.cumsum(negative) - negative / 2
        return float(positive @ below / total)

    def rates(self) -> tuple[_Float, _Float, _Float]:
        """Return thresholds, descending from infinity, with both rates of scores at or above.

        Returns
        -------
        threshold, false_positive, true_positive : ndarray, shape (n_levels + 1,), float64
            NaN rates for a class that is absent.
        """
        positive, negative = self._counts(None)
        threshold = np.concatenate([[np.inf], self.levels[::-1]])
        with np.errstate(invalid="ignore"):
            rates = [
                np.concatenate([[0.0], np.cumsum(counts[::-1])]) / np.float64(counts.sum())
                for counts in (negative, positive)
            ]
        return threshold, rates[0], rates[1]

    def _counts(self, weight: _Float | None) -> tuple[_Float, _Float]:
        weight = np.ones(len(self.score)) if weight is None else weight
        n = len(self.levels)
        positive = np.bincount(self._level, weight * self.is_positive, n)
        negative = np.bincount(self._level, weight * ~self.is_positive, n)
        return np.asarray(positive, np.float64), np.asarray(negative, np.float64)
