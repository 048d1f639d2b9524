"""What every training has: epochs to tell of, its end, and what calibrates its answers.

A temperature scales logits; a discount says how much overlapping windows count, fitted on passages
that training never saw.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from radard.judge.bundle import EvidenceSettings
from radard.judge.classifier import Probabilities
from radard.judge.evidence import Evidence

Array = NDArray[np.float64]
Net = TypeVar("Net")
_DISCOUNTS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  # tried: 1 for independent windows
_LARGEST_STEP_S = 1.5  # windows are 1 s apart while the gate is open


@dataclass(frozen=True, slots=True)
class Epoch:
    """Progress of a training; None where nothing is kept apart to validate on."""

    number: int
    loss: float
    validation_loss: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Trained(Generic[Net]):
    """A network, and the temperature that calibrates it."""

    net: Net
    temperature: float


def cross_entropy(logits: Array, y: NDArray[np.int64]) -> float:
    """Return the mean negative log-likelihood of classes y, shape (n,)."""
    return float(-log_softmax(logits, axis=1)[np.arange(len(y)), y].mean())


def temperature_of(logits: Array, y: NDArray[np.int64]) -> float:
    """Return the temperature with the lowest cross-entropy, to 1 %."""
    grid = np.geomspace(0.25, 8, 350)
    losses = [cross_entropy(logits / t, y) for t in grid]
    return float(round(grid[int(np.argmin(losses))], 3))


def first_windows(columns: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
    """Return where the gate has opened, of windows of sets in the order of the stream, (n,)."""
    step_s = np.diff(np.asarray(columns["t_s"], np.float64), prepend=-np.inf)
    new = np.diff(columns["passage"], prepend=-1) != 0
    return np.asarray(new | (step_s > _LARGEST_STEP_S) | (step_s <= 0))


def fused(p: Array, is_first: NDArray[np.bool_], settings: EvidenceSettings) -> Array:
    """Return the fused probability of a person after every window, shape (n,).

    `p` are calibrated probabilities, shape (n, 3), in the order in which the daemon would see the
    windows; `is_first`, shape (n,), is where the gate has opened: nothing was known before.
    """
    evidence, out = Evidence(settings), np.empty(len(p))
    for k, (row, is_new) in enumerate(zip(p, is_first, strict=True)):
        if is_new:
            evidence.reset()
        out[k] = evidence.add(Probabilities(*row.tolist())).human
    return out


def log_loss(p_human: Array, is_human: NDArray[np.bool_]) -> float:
    """Return the mean negative log-likelihood, people and others weighing the same."""
    p = np.clip(np.where(is_human, p_human, 1 - p_human), 1e-9, 1.0)
    return float(-0.5 * (np.log(p[is_human]).mean() + np.log(p[~is_human]).mean()))


def fit_evidence(
    p: Array, is_first: NDArray[np.bool_], is_human: NDArray[np.bool_]
) -> EvidenceSettings:
    """Return the settings with the discount of the lowest log loss of the fused value."""
    tried = [EvidenceSettings(discount=discount) for discount in _DISCOUNTS]
    return min(tried, key=lambda s: log_loss(fused(p, is_first, s), is_human))
