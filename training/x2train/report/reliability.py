"""Reliability diagram: observed frequency per bin of predicted probability."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2train.report.intervals import Estimate, resampled

BINS = 10  # as usual (Guo et al. 2017 have 15)


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
    p: NDArray[np.float64],
    is_human: NDArray[np.bool_],
    passage: NDArray[np.int64],
    rng: np.random.Generator,
) -> Reliability:
    """Return the observed share of people per bin of predicted probability, shape (n,), finite.

    `passage`, shape (n,), is what is drawn again for the intervals.
    """
    passages, which = np.unique(passage, return_inverse=True)
    n = len(passages)
    cell = which * BINS + np.minimum((p * BINS).astype(np.int64), BINS - 1)
    # Sums of each passage in each bin: a draw of passages is then one product.
    count, total, human = (
        np.bincount(cell, weight, n * BINS).reshape(n, BINS) for weight in (None, p, is_human)
    )

    def error(weight: NDArray[np.float64]) -> float:
        n_all = weight @ count.sum(axis=1)
        return float(np.abs(weight @ (total - human)).sum() / n_all) if n_all else float("nan")

    def share_of(k: int) -> Estimate:
        def value(weight: NDArray[np.float64]) -> float:
            n_bin = weight @ count[:, k]
            return float(weight @ human[:, k] / n_bin) if n_bin else float("nan")

        return resampled(value, n, rng)

    sums = total.sum(axis=0), count.sum(axis=0)
    return Reliability(
        tuple(
            Bin(int(m), float(s / m) if m else float("nan"), share_of(k))
            for k, (s, m) in enumerate(zip(*sums, strict=True))
        ),
        resampled(error, n, rng),
    )
