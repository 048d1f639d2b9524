"""How much overlapping windows count: the discount, fitted on passages that training never saw."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.judge.bundle import EvidenceSettings
from radard.judge.classifier import Probabilities, softmax
from radard.judge.evidence import Evidence

Array = NDArray[np.float64]
_DISCOUNTS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  # tried: 1 for independent windows
_LARGEST_STEP_S = 1.5  # windows are 1 s apart while the gate is open


@dataclass(frozen=True, slots=True, eq=False)
class Sequences:
    """Windows in the order in which the daemon would see them."""

    p: Array  # (n, 3): calibrated probabilities
    is_human: NDArray[np.bool_]
    is_first: NDArray[np.bool_]  # (n,): where the gate has opened: nothing was known before


def sequences(
    logits: Array,
    temperature: float,
    *,
    label: NDArray[np.int64],
    passage: NDArray[np.int64],
    t_s: Array,
) -> Sequences:
    """Return windows of sets as sequences; logits (n, 3) are divided by the temperature."""
    p = np.stack([softmax(row / temperature) for row in logits])
    return Sequences(p, label == 0, first_windows(passage, t_s))


def first_windows(passage: NDArray[np.int64], t_s: Array) -> NDArray[np.bool_]:
    """Return where the gate has opened, of windows as in `sequences`."""
    step_s = np.diff(t_s, prepend=-np.inf)
    new = np.diff(passage, prepend=-1) != 0
    return np.asarray(new | (step_s > _LARGEST_STEP_S) | (step_s <= 0))


def fused(windows: Sequences, settings: EvidenceSettings) -> Array:
    """Return the fused probability of a person after every window, shape (n,)."""
    evidence, out = Evidence(settings), np.empty(len(windows.p))
    for k, (row, is_first) in enumerate(zip(windows.p, windows.is_first, strict=True)):
        if is_first:
            evidence.reset()
        out[k] = evidence.add(Probabilities(*(float(v) for v in row))).human
    return out


def log_loss(p_human: Array, is_human: NDArray[np.bool_]) -> float:
    """Return the mean negative log-likelihood, people and others weighing the same."""
    p = np.clip(np.where(is_human, p_human, 1 - p_human), 1e-9, 1.0)
    return float(-0.5 * (np.log(p[is_human]).mean() + np.log(p[~is_human]).mean()))


def fit_evidence(windows: Sequences, start: EvidenceSettings) -> EvidenceSettings:
    """Return the settings with the discount of the lowest log loss of the fused value."""
    tried = [
        EvidenceSettings(
            discount=d,
            most=start.most,
            prior_human=start.prior_human,
            human_limit=start.human_limit,
        )
        for d in _DISCOUNTS
    ]
    return min(tried, key=lambda s: log_loss(fused(windows, s), windows.is_human))
