"""Figures: everything the report says of one table, before it is drawn or written."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2train.judge.estimates import Estimate, Reliability, reliability
from x2train.judge.groups import Group, groups
from x2train.judge.table import LABELS, PassageTable
from x2train.judge.verdicts import (
    BUDGET_HOURS,
    PET_LIMIT,
    Outcome,
    Policy,
    Sweep,
    Verdicts,
    evidence,
    intrusions,
    limit_evidence,
    outcome,
    verdicts,
)
from x2train.judge.windows import (
    Baseline,
    Windows,
    balanced_accuracy,
    baselines,
    confusion,
    human_score,
    is_in_view,
    is_judged,
)

_BUDGET_H = 60.0
"""The budget that the groups and the comparison are given at."""
_WORST = 20  # passages with a picture: as many as are looked at


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """One operating point."""

    name: str
    policy: str
    budget_h: float
    pet_limit: float
    is_resolved: bool
    outcome: Outcome


@dataclass(frozen=True, slots=True)
class WindowFigures:
    """What the network says of single windows of people and pets."""

    n_human: int
    n_pet: int
    auc: Estimate
    auc_all_open: Estimate
    auc_fused: Estimate
    balanced_accuracy: Estimate
    confusion: dict[str, dict[str, int]]


@dataclass(frozen=True, slots=True)
class Worst:
    """A passage that is, or nearly is, on the wrong side."""

    index: int
    margin: float
    is_wrong: bool


@dataclass(frozen=True, slots=True, eq=False)
class Figures:
    """The whole evaluation of one table; each part is described where it is made."""

    n_passages: dict[str, int]
    pet_hours_in_swath: float
    n_never_in_swath: int
    n_invalid: int
    points: tuple[OperatingPoint, ...]
    agreement: float
    windows: WindowFigures
    baselines: tuple[Baseline, ...]
    reliability: dict[str, Reliability]
    groups: dict[str, tuple[Group, ...]]
    worst: tuple[Worst, ...]
    found: tuple[Verdicts, Verdicts]
    sweeps: dict[Policy, Sweep]

    @property
    def is_matched(self) -> bool:
        """Whether no required feature alone tells people from pets: the set counts."""
        return all(b.is_below for b in self.baselines if b.is_required)

    @property
    def shipped(self) -> Outcome:
        """What the daemon does as it is."""
        return self.points[0].outcome

    @property
    def at_budget(self) -> Outcome:
        """What fused evidence does at one false alarm per 60 pet-hours."""
        return next(p.outcome for p in self.points if p.budget_h == _BUDGET_H)


def figures(table: PassageTable, seed: int) -> Figures:
    """Evaluate a table; `seed` is that of the draws for the intervals."""
    rng = np.random.default_rng(seed)
    everything = np.ones(len(table), np.bool_)
    shipped = verdicts(table, table.is_alarm)
    own = outcome(table, shipped, everything, rng)
    points = [OperatingPoint("as shipped", "shipped", np.nan, PET_LIMIT, True, own)]
    sweeps: dict[Policy, Sweep] = {}
    scores: dict[Policy, NDArray[np.float64]] = {}
    budget: Verdicts = shipped
    for policy in ("fused", "window"):
        score = scores[policy] = evidence(table, policy)
        sweep = sweeps[policy] = Sweep.of(table, score)
        limits = [(np.nan, limit_evidence(PET_LIMIT))]
        resolved = [h for h in BUDGET_HOURS if h == _BUDGET_H or h <= sweep.pet_hours]
        limits += [(h, sweep.limit_for(1 / h)) for h in resolved]
        for budget_h, limit in limits:
            found = verdicts(table, score >= limit)
            if policy == "fused" and budget_h == _BUDGET_H:
                budget = found
            points.append(
                OperatingPoint(
                    _name(policy, budget_h),
                    policy,
                    budget_h,
                    float(1 / (1 + np.exp(np.clip(limit, -700, 700)))),
                    bool(np.isnan(budget_h) or sweep.pet_hours >= budget_h),
                    outcome(table, found, everything, rng),
                )
            )
    at_limit = verdicts(table, scores["fused"] >= limit_evidence(PET_LIMIT))
    same = at_limit.is_alarm == shipped.is_alarm
    judged = is_judged(table)
    windows = Windows.of(table, judged & is_in_view(table))
    pets = table.label == "pet"
    return Figures(
        n_passages={k: int((table.label == k).sum()) for k in LABELS if k in table.label},
        pet_hours_in_swath=float(np.nansum((table.leaves_s - table.enters_s)[pets])) / 3600,
        n_never_in_swath=int(((table.label == "human") & ~intrusions(table)).sum()),
        n_invalid=int((table.is_open & ~judged).sum()),
        points=tuple(points),
        agreement=float(same.mean()) if len(table) else float("nan"),
        windows=_window_figures(table, windows, scores["fused"], rng),
        baselines=baselines(table, windows, rng),
        reliability=_reliability(table, judged, rng),
        groups=groups(table, (shipped, budget), rng),
        worst=_worst(table, scores["fused"], shipped),
        found=(shipped, budget),
        sweeps=sweeps,
    )


def _name(policy: Policy, budget_h: float) -> str:
    whose = "fused evidence" if policy == "fused" else "single windows"
    if np.isnan(budget_h):
        return f"{whose} at the limit {PET_LIMIT:g}"
    return f"{whose}, one false alarm in {budget_h:g} pet-hours"


def _window_figures(
    table: PassageTable, windows: Windows, fused: NDArray[np.float64], rng: np.random.Generator
) -> WindowFigures:
    score = human_score(table)
    every = Windows.of(table, is_judged(table))
    settled = Windows.of(table, is_in_view(table) & (fused > -np.inf))
    # log 0 - log 1 is infinite, and as good a score as any; the ranking only compares.
    largest = np.finfo(float).max
    score = np.clip(score, -largest, largest)
    return WindowFigures(
        n_human=int(windows.is_human.sum()),
        n_pet=int((~windows.is_human).sum()),
        auc=windows.auc(score[windows.row], rng),
        auc_all_open=every.auc(score[every.row], rng),
        auc_fused=settled.auc(fused[settled.row], rng),
        balanced_accuracy=balanced_accuracy(table, windows, rng),
        confusion=confusion(table),
    )


def _reliability(
    table: PassageTable, judged: NDArray[np.bool_], rng: np.random.Generator
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


def _worst(
    table: PassageTable, score: NDArray[np.float64], shipped: Verdicts
) -> tuple[Worst, ...]:
    entered = table.t_s >= np.nan_to_num(table.enters_s, nan=0.0)[table.passage]
    most = np.full(len(table), -np.inf)
    np.maximum.at(most, table.passage[entered], score[entered])
    over = most - limit_evidence(PET_LIMIT)
    people = intrusions(table)
    no_people = table.label != "human"
    margin = np.where(people, over, -over)
    is_wrong = np.where(people, ~shipped.is_alarm, shipped.false_alarms > 0)
    picked = []
    for side in (people, no_people):
        rows = np.flatnonzero(side)
        # The wrong first, then by how narrow it was.
        order = np.lexsort((margin[rows], ~is_wrong[rows]))
        picked.append(rows[order].tolist())
    half = _WORST // 2
    n_people = min(len(picked[0]), max(half, _WORST - len(picked[1])))
    chosen = picked[0][:n_people] + picked[1][: _WORST - n_people]
    return tuple(Worst(k, float(margin[k]), bool(is_wrong[k])) for k in chosen)
