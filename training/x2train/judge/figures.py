"""Figures: everything the report says of one table, as JSON will hold it.

A window, a dwell alone, counts when the gate was open and its middle lies in the time the body was
in the swath. Where a single feature tells people from pets, a network may have learned that.

The same figures are given for all passages and by family, suite, split, and how the body moved and
was seen. Estimates stay estimates, and what is not known NaN, until the report is written.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2train.judge.estimates import (
    Estimate,
    Ranking,
    Reliability,
    per_hour,
    reliability,
    resampled,
)
from x2train.judge.table import LABELS, TEXTS, PassageTable
from x2train.judge.verdicts import (
    BUDGET_HOURS,
    PET_LIMIT,
    Policy,
    Sweep,
    Verdicts,
    evidence,
    hours,
    intrusions,
    limit_evidence,
    outcome,
    verdicts,
)

_DWELL_S = 2.0  # as all bundles have it
_MATCHED_BELOW = 0.60  # AUC: hardly over chance
_BINS = 20  # enough windows in each
_BUDGET_H = 60.0  # the budget that the groups and the comparison are given at
_WORST = 20  # passages with a picture: as many as are looked at
_EDGES = {
    "speed_mps": (0.0, 0.1, 0.3, 0.6, 1.0, 1.5, 2.2, 3.0),
    "range_m": (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0),
    "aspect_deg": (0.0, 30.0, 60.0, 90.0, 120.0, 150.0),
    "snr_db": (0.0, 6.0, 12.0, 18.0, 24.0, 30.0, 36.0),
}
"""Lower ends of the bins; what is below the first has a bin of its own."""
_POINT = ("name", "policy", "budget_h", "pet_limit", "is_resolved", "outcome")
_MAX_BUILDS = 40  # a longer table is not read
_Bool = NDArray[np.bool_]
_Float = NDArray[np.float64]


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


@dataclass(frozen=True, slots=True, eq=False)
class Figures:
    """The whole evaluation of one table."""

    content: dict[str, Any]  # of the report, see report.schema.json
    # what is drawn besides, and compared with another model
    found: tuple[Verdicts, Verdicts]  # as shipped, and at one false alarm in 60 pet-hours
    sweeps: dict[Policy, Sweep]


def figures(table: PassageTable) -> Figures:
    """Evaluate a table; draws for its intervals are always the same."""
    rng = np.random.default_rng(0)
    everything = np.ones(len(table), np.bool_)
    shipped = verdicts(table, table.is_alarm)
    own = outcome(table, shipped, everything, rng)
    points: list[tuple[Any, ...]] = [("as shipped", "shipped", np.nan, PET_LIMIT, True, own)]
    policies: tuple[Policy, ...] = ("fused", "window")
    scores = {policy: evidence(table, policy) for policy in policies}
    sweeps = {policy: Sweep.of(table, score) for policy, score in scores.items()}
    at_limit = budget = shipped
    for policy, sweep in sweeps.items():
        limits = [(np.nan, limit_evidence(PET_LIMIT))]
        resolved = [h for h in BUDGET_HOURS if h == _BUDGET_H or h <= sweep.pet_hours]
        limits += [(h, sweep.limit_for(1 / h)) for h in resolved]
        for budget_h, limit in limits:
            found = verdicts(table, scores[policy] >= limit)
            if policy == "fused":
                at_limit = found if np.isnan(budget_h) else at_limit
                budget = found if budget_h == _BUDGET_H else budget
            name = _name(policy, budget_h)
            pet_limit = float(1 / (1 + np.exp(np.clip(limit, -700, 700))))
            is_resolved = bool(np.isnan(budget_h) or sweep.pet_hours >= budget_h)
            result = outcome(table, found, everything, rng)
            points.append((name, policy, budget_h, pet_limit, is_resolved, result))
    same = at_limit.is_alarm == shipped.is_alarm
    judged = is_judged(table)
    windows = Windows.of(table, judged & is_in_view(table))
    pets = table.label == "pet"
    of_windows = _window_figures(table, windows, scores["fused"], rng)
    alone = baselines(table, windows, rng)
    content = {
        "passages": {k: int((table.label == k).sum()) for k in LABELS if k in table.label},
        "pet_hours_in_swath": float(np.nansum((table.leaves_s - table.enters_s)[pets])) / 3600,
        "never_in_swath": int(((table.label == "human") & ~intrusions(table)).sum()),
        "invalid_windows": int((table.is_open & ~judged).sum()),
        "operating_points": [dict(zip(_POINT, point, strict=True)) for point in points],
        "sweep_agreement": float(same.mean()) if len(table) else float("nan"),
        "windows": of_windows,
        "is_matched": all(b["is_below"] for b in alone if b["is_required"]),
        "baselines": alone,
        "reliability": _reliability(table, judged, rng),
        "groups": groups(table, (shipped, budget), rng),
        "worst": _worst(table, scores["fused"], shipped),
    }
    return Figures(content, (shipped, budget), sweeps)


def _name(policy: Policy, budget_h: float) -> str:
    whose = "fused evidence" if policy == "fused" else "single windows"
    if np.isnan(budget_h):
        return f"{whose} at the limit {PET_LIMIT:g}"
    return f"{whose}, one false alarm in {budget_h:g} pet-hours"


def _window_figures(
    table: PassageTable, windows: Windows, fused: _Float, rng: np.random.Generator
) -> dict[str, Any]:
    every = Windows.of(table, is_judged(table))
    settled = Windows.of(table, is_in_view(table) & (fused > -np.inf))
    # log 0 - log 1 is infinite, and as good a score as any; the ranking only compares.
    largest = np.finfo(float).max
    score = np.clip(human_score(table), -largest, largest)
    return {
        "n_human": int(windows.is_human.sum()),
        "n_pet": int((~windows.is_human).sum()),
        "auc": windows.auc(score[windows.row], rng),
        "auc_all_open": every.auc(score[every.row], rng),
        "auc_fused": settled.auc(fused[settled.row], rng),
        "balanced_accuracy": balanced_accuracy(table, windows, rng),
        "confusion": confusion(table),
    }


def _reliability(
    table: PassageTable, judged: _Bool, rng: np.random.Generator
) -> dict[str, Reliability]:
    is_human = table.label[table.passage] == "human"
    # A person outside the swath is no person to this radar.
    judged = judged & (~is_human | is_in_view(table))
    fused = judged & np.isfinite(table.fused_quiet)
    return {
        name: reliability(p[rows], is_human[rows], table.passage[rows], rng)
        for name, p, rows in (
            ("window", table.p_human, judged),
            ("fused", 1 - table.fused_quiet, fused),
        )
    }


def _worst(table: PassageTable, score: _Float, shipped: Verdicts) -> list[dict[str, Any]]:
    entered = table.t_s >= np.nan_to_num(table.enters_s, nan=0.0)[table.passage]
    most = np.full(len(table), -np.inf)
    np.maximum.at(most, table.passage[entered], score[entered])
    over = most - limit_evidence(PET_LIMIT)
    people = intrusions(table)
    margin = np.where(people, over, -over)
    is_wrong = np.where(people, ~shipped.is_alarm, shipped.false_alarms > 0)
    picked = []
    for side in (people, table.label != "human"):
        rows = np.flatnonzero(side)
        # The wrong first, then by how narrow it was.
        order = np.lexsort((margin[rows], ~is_wrong[rows]))
        picked.append(rows[order].tolist())
    n_people = min(len(picked[0]), max(_WORST // 2, _WORST - len(picked[1])))
    return [
        {
            "index": k,
            **{name: getattr(table, name)[k].item() for name in (*TEXTS, *_EDGES)},
            "is_wrong": bool(is_wrong[k]),
            "margin": float(margin[k]),
            "alarm_s": float(shipped.alarm_s[k]),
        }
        for k in picked[0][:n_people] + picked[1][: _WORST - n_people]
    ]


def groups(
    table: PassageTable, found: tuple[Verdicts, Verdicts], rng: np.random.Generator
) -> dict[str, list[dict[str, Any]]]:
    """Return the figures by everything that is known of the passages: people first."""
    by = {key: _named(getattr(table, key)) for key in ("split", "family", "suite")}
    if len(np.unique(table.build)) <= _MAX_BUILDS:
        by["build"] = _named(table.build)
    by |= {key: _binned(getattr(table, key), edges) for key, edges in _EDGES.items()}
    made = {
        key: [_group(table, name, chosen, found, rng) for name, chosen in parts]
        for key, parts in by.items()
    }
    for key in made.keys() - _EDGES.keys():
        made[key].sort(key=lambda g: (g["shipped"].n_intrusions == 0, g["shipped"].pet_hours == 0))
    return made


def _group(
    table: PassageTable,
    name: str,
    chosen: _Bool,
    found: tuple[Verdicts, Verdicts],
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Return the figures of the chosen passages; quiet: something else moves, or nothing."""
    quiet = chosen & ((table.label == "other") | (table.label == "empty"))
    quiet_hours = hours(table, quiet)
    n_quiet = int(found[0].false_alarms[quiet].sum())
    return {
        "name": name,
        "shipped": outcome(table, found[0], chosen, rng),
        "at_budget": outcome(table, found[1], chosen, rng),
        "quiet_hours": quiet_hours,
        "n_quiet_alarms": n_quiet,
        "quiet_alarms_per_hour": per_hour(n_quiet, quiet_hours),
    }


def _named(values: NDArray[np.str_]) -> Iterator[tuple[str, _Bool]]:
    return ((str(name), values == name) for name in np.unique(values) if name)


def _binned(values: _Float, edges: tuple[float, ...]) -> Iterator[tuple[str, _Bool]]:
    # NaN is in no bin: comparing it is false.
    lows, highs = (-np.inf, *edges), (*edges, np.inf)
    for low, high in zip(lows, highs, strict=True):
        chosen = (values >= low) & (values < high)
        if chosen.any():
            name = f"below {high:g}" if np.isinf(low) else f"{low:g} to {high:g}"
            yield f"{low:g} and more" if np.isinf(high) else name, chosen


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
    n, classes = windows.n_passages, (windows.is_human, ~windows.is_human)
    right = np.stack([np.bincount(windows.passage, is_right & each, n) for each in classes])
    total = np.stack([np.bincount(windows.passage, each, n) for each in classes])

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
    guess = np.array(LABELS)[p.argmax(axis=0)]
    label = table.label[table.passage[judged]]
    return {
        truth: {name: int(((label == truth) & (guess == name)).sum()) for name in LABELS[:3]}
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
