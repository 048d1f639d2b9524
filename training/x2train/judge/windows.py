"""Windows: what the network says of each dwell alone, and what simpler things would say.

A window counts when the gate was open and its middle lies in the time the body was in the swath.
Where a single feature tells people from pets, a network may have learned that.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2train.judge.estimates import Estimate, Ranking, resampled
from x2train.judge.table import LABELS, PassageTable

_DWELL_S = 2.0  # as all bundles have it
_MATCHED_BELOW = 0.60  # AUC: hardly over chance
_GUESSES = ("human", "pet", "other")
_BINS = 20  # enough windows in each
_Float = NDArray[np.float64]
_Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Windows of people and pets."""

    row: NDArray[np.int64]  # (n,): their decisions in the table
    passage: NDArray[np.int64]  # (n,): passage of each, without gaps from 0
    is_human: _Bool  # (n,): the truth: human, else pet
    n_passages: int  # how many passages have such windows

    @classmethod
    def of(cls, table: PassageTable, chosen: _Bool) -> "Windows":
        """Return those of the chosen decisions that are of people or pets."""
        label = table.label[table.passage]
        row = np.flatnonzero(chosen & ((label == "human") | (label == "pet")))
        passages, passage = np.unique(table.passage[row], return_inverse=True)
        return cls(row, passage, label[row] == "human", len(passages))

    def auc(self, score: _Float, rng: np.random.Generator) -> Estimate:
        """Return how well a score, one per window, tells people from pets."""
        known = np.isfinite(score)
        ranking = Ranking(score[known], self.is_human[known])
        passage = self.passage[known]
        return resampled(lambda w: ranking.auc(w[passage]), self.n_passages, rng)


def is_judged(table: PassageTable) -> _Bool:
    """Return which decisions have probabilities."""
    known = np.isfinite(table.p_human + table.p_pet + table.p_other)
    return np.asarray(table.is_open & known)


def is_in_view(table: PassageTable) -> _Bool:
    """Return which decisions' dwells have their middle in the time in the swath."""
    middle_s = table.t_s - _DWELL_S / 2
    enters_s, leaves_s = table.enters_s[table.passage], table.leaves_s[table.passage]
    return np.asarray((middle_s >= enters_s) & (middle_s <= leaves_s))


def human_score(table: PassageTable) -> _Float:
    """Return the log odds of human against pet and other, per decision."""
    quiet = table.p_pet + table.p_other
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.log(table.p_human) - np.log(quiet))


def balanced_accuracy(table: PassageTable, windows: Windows, rng: np.random.Generator) -> Estimate:
    """Return the mean of the shares of people and of pets that are called so."""
    quiet = (table.p_pet + table.p_other)[windows.row]
    is_right = (table.p_human[windows.row] >= quiet) == windows.is_human
    n = windows.n_passages
    right, total = (
        np.stack(
            [
                np.bincount(windows.passage, counted & of_class, n)
                for of_class in (windows.is_human, ~windows.is_human)
            ]
        )
        for counted in (is_right, np.ones_like(is_right))
    )

    def mean_share(weight: _Float) -> float:
        totals = total @ weight
        if not totals.all():
            return float("nan")
        return float(np.mean((right @ weight) / totals))

    return resampled(mean_share, n, rng)


def confusion(table: PassageTable) -> dict[str, dict[str, int]]:
    """Return how many windows of each label were called what, by the likeliest class."""
    judged = is_judged(table)
    p = np.stack([table.p_human[judged], table.p_pet[judged], table.p_other[judged]])
    guess = p.argmax(axis=0)
    label = table.label[table.passage[judged]]
    return {
        truth: {
            name: int(((label == truth) & (guess == k)).sum()) for k, name in enumerate(_GUESSES)
        }
        for truth in LABELS
    }


def baselines(
    table: PassageTable, windows: Windows, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """Return what power, range, SNR and speed achieve alone, each a dict.

    ``auc`` is that of the feature, in whichever direction is better; ``auc_binned`` of the share
    of people among windows in the same twentieth of its values, learnt on every other passage
    and asked on the rest, which finds what is not one-directional; ``is_below`` says that both
    stay below 0.60, or that the feature is not known. The set counts only if those that are
    ``is_required`` do.
    """
    passage = table.passage[windows.row]
    features = (
        ("total power", True, table.power_db[windows.row]),
        ("range-compensated power", True, table.compensated_db[windows.row]),
        ("range", True, table.target_range_m[windows.row]),
        ("SNR", True, table.snr_db[passage]),
        ("speed", False, table.speed_mps[passage]),
    )
    made = []
    for name, is_required, value in features:
        auc, binned = windows.auc(value, rng), _auc_binned(windows, value)
        if auc.value < 0.5:
            auc = Estimate(1 - auc.value, 1 - auc.high, 1 - auc.low)
        row = {"name": name, "is_required": is_required, "auc": auc, "auc_binned": binned}
        is_below = not (auc.value >= _MATCHED_BELOW or binned >= _MATCHED_BELOW)
        made.append({**row, "is_below": is_below})
    return made


def _auc_binned(windows: Windows, value: _Float) -> float:
    known = np.isfinite(value)
    value, is_human, passage = value[known], windows.is_human[known], windows.passage[known]
    is_taught = passage % 2 == 0
    if not is_taught.any():
        return float("nan")
    inner = np.quantile(value[is_taught], np.arange(1, _BINS) / _BINS)
    where = np.searchsorted(inner, value, side="right")
    total = np.bincount(where[is_taught], minlength=_BINS)
    human = np.bincount(where[is_taught], is_human[is_taught], _BINS)
    learnt = (human + 1) / (total + 2)
    return Ranking(learnt[where][~is_taught], is_human[~is_taught]).auc()
