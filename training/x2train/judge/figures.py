"""Figures: everything the report says of one table, as JSON will hold it.

The same figures are given for all passages and by family, suite, split, and how the body moved and
was seen. Estimates stay estimates, and what is not known NaN, until the report is written.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2train.judge.estimates import Reliability, per_hour, reliability
from x2train.judge.table import LABELS, PassageTable
from x2train.judge.verdicts import (
    BUDGET_HOURS,
    PET_LIMIT,
    Outcome,
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
from x2train.judge.windows import (
    Windows,
    balanced_accuracy,
    baselines,
    confusion,
    human_score,
    is_in_view,
    is_judged,
)

_BUDGET_H = 60.0  # the budget that the groups and the comparison are given at
_WORST = 20  # passages with a picture: as many as are looked at
_FACTS = (
    *("family", "label", "split", "suite", "build"),
    *("speed_mps", "range_m", "aspect_deg", "snr_db"),
)
_EDGES = {
    "speed_mps": (0.0, 0.1, 0.3, 0.6, 1.0, 1.5, 2.2, 3.0),
    "range_m": (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0),
    "aspect_deg": (0.0, 30.0, 60.0, 90.0, 120.0, 150.0),
    "snr_db": (0.0, 6.0, 12.0, 18.0, 24.0, 30.0, 36.0),
}
"""Lower ends of the bins; what is below the first has a bin of its own."""
_MAX_BUILDS = 40  # a longer table is not read
_Bool = NDArray[np.bool_]
_Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Figures:
    """The whole evaluation of one table."""

    content: dict[str, Any]  # of the report, see report.schema.json
    worst: list[dict[str, Any]]  # passages that are, or nearly are, on the wrong side
    # what is drawn, and compared with another model
    shipped: Outcome
    found: tuple[Verdicts, Verdicts]  # as shipped, and at one false alarm in 60 pet-hours
    sweeps: dict[Policy, Sweep]
    reliability: dict[str, Reliability]


def figures(table: PassageTable, seed: int) -> Figures:
    """Evaluate a table; `seed` is that of the draws for the intervals."""
    rng = np.random.default_rng(seed)
    everything = np.ones(len(table), np.bool_)
    shipped = verdicts(table, table.is_alarm)
    own = outcome(table, shipped, everything, rng)
    points: list[dict[str, Any]] = [
        {
            "name": "as shipped",
            "policy": "shipped",
            "budget_h": np.nan,
            "pet_limit": PET_LIMIT,
            "is_resolved": True,
            "outcome": own,
        }
    ]
    sweeps: dict[Policy, Sweep] = {}
    scores: dict[Policy, _Float] = {}
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
                {
                    "name": _name(policy, budget_h),
                    "policy": policy,
                    "budget_h": budget_h,
                    "pet_limit": float(1 / (1 + np.exp(np.clip(limit, -700, 700)))),
                    "is_resolved": bool(np.isnan(budget_h) or sweep.pet_hours >= budget_h),
                    "outcome": outcome(table, found, everything, rng),
                }
            )
    at_limit = verdicts(table, scores["fused"] >= limit_evidence(PET_LIMIT))
    same = at_limit.is_alarm == shipped.is_alarm
    judged = is_judged(table)
    windows = Windows.of(table, judged & is_in_view(table))
    pets = table.label == "pet"
    of_windows = _window_figures(table, windows, scores["fused"], rng)
    alone = baselines(table, windows, rng)
    relied = _reliability(table, judged, rng)
    content = {
        "passages": {k: int((table.label == k).sum()) for k in LABELS if k in table.label},
        "pet_hours_in_swath": float(np.nansum((table.leaves_s - table.enters_s)[pets])) / 3600,
        "never_in_swath": int(((table.label == "human") & ~intrusions(table)).sum()),
        "invalid_windows": int((table.is_open & ~judged).sum()),
        "operating_points": points,
        "sweep_agreement": float(same.mean()) if len(table) else float("nan"),
        "windows": of_windows,
        "is_matched": all(b["is_below"] for b in alone if b["is_required"]),
        "baselines": alone,
        "reliability": relied,
        "groups": groups(table, (shipped, budget), rng),
    }
    worst = _worst(table, scores["fused"], shipped)
    return Figures(content, worst, own, (shipped, budget), sweeps, relied)


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
            **{name: getattr(table, name)[k].item() for name in _FACTS},
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
