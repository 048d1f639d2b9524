"""Results of one training: accuracies, cross-entropy, confusion, of every repeat."""

import statistics
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2train.thesis.sets import CellData

IN_VIEW = 0.25  # of the time: half a second
_MIN_P = 1e-12  # its logarithm is finite


@dataclass(frozen=True, slots=True)
class SetResult:
    """Scores of the repeats on one set of elements."""

    n: int
    total: tuple[float, ...]
    class1: tuple[float, ...]
    class2: tuple[float, ...]
    cross_entropy: tuple[float, ...]
    confusion: tuple[tuple[tuple[int, int], tuple[int, int]], ...]

    @property
    def median(self) -> float:
        """Median of the repeats' total accuracy."""
        return statistics.median(self.total)


@dataclass(frozen=True, slots=True)
class CellResult:
    """What one configuration reached on one set of the thesis."""

    name: str
    label: str  # what differs from the thesis' configuration; its activation in the main tables
    best: int  # which repeat had the best score while it trained
    epochs: tuple[int, ...]  # looks that were best, of each repeat
    # the thesis' 500 elements, fresh ones, and those of the fresh ones in the swath for at least
    # a quarter of the time
    evaluation: SetResult
    fresh: SetResult
    in_view: SetResult
    stopped_by: str  # what the score was computed on
    settings: Mapping[str, Any] = field(default_factory=dict)
    # of every look and repeat: cross-entropy, and the mean probability of the true class of pets
    # and of people, on what stopped the training; the first before it began
    scores: tuple[tuple[float, ...], ...] = ()
    confidence: tuple[tuple[tuple[float, ...], ...], ...] = ()


def of_truth(
    p: NDArray[np.float64], y: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return probabilities of the true classes, (n_repeats, n), and repeats' cross-entropy."""
    truth = np.take_along_axis(p, y[None, :, None], axis=2)[..., 0]
    return truth, -np.log(np.maximum(truth, _MIN_P)).mean(axis=1)


def judged(p: NDArray[np.float64], y: NDArray[np.int64]) -> SetResult:
    """Return what probabilities of shape (n_repeats, n, 2) are worth."""
    said = p.argmax(axis=2)
    right = said == y
    confusion = tuple(
        tuple(tuple(int(((row == out) & (y == true)).sum()) for true in (0, 1)) for out in (0, 1))
        for row in said
    )

    def percent(which: NDArray[np.bool_] | slice) -> tuple[float, ...]:
        return tuple(float(round(100 * r[which].mean(), 2)) for r in right)

    return SetResult(
        len(y),
        percent(slice(None)),
        percent(y == 0),
        percent(y == 1),
        tuple(float(round(v, 4)) for v in of_truth(p, y)[1]),
        confusion,  # type: ignore[arg-type]
    )


def seen(data: CellData, p: NDArray[np.float64]) -> SetResult:
    """Return what they are worth on the elements that are in view long enough."""
    which = data.in_view >= IN_VIEW
    return judged(p[:, which], data.y[which])
