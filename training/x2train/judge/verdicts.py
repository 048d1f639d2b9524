"""Verdicts: which passages alarm, when, and what that is at every other limit and sensitivity.

The evidence for a human is ln((1 - q) / q) with q the fused p_pet + p_other; the alarm limit q <=
0.8 is evidence >= -1.39. A pending decision counts only where it is the last word.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from radard.alarm.panel import AlarmPanel, AlarmPolicy, Sight
from radard.alarm.sensitivity import SENSITIVITIES, alarm_policy
from radard.config.config import Config
from radard.config.sections import AlarmSection
from radard.judge.bundle import Bundle, EvidenceSettings
from radard.judge.classifier import Probabilities
from radard.judge.decision import Verdict, pet_limit_of
from x2train.judge.estimates import Estimate, per_hour, resampled, share
from x2train.judge.table import PassageTable

PET_LIMIT = 0.8  # the thesis' rule, and every bundle's
BUDGET_HOURS = (1.0, 10.0, 60.0, 180.0)  # one false alarm in so many pet-hours
EPISODE_S = 60.0  # a passage's alarms in one minute are one: the first calls somebody
Policy: TypeAlias = Literal["fused", "window"]
_TINY = 1e-300  # its logarithm is finite
_Float = NDArray[np.float64]
_Bool = NDArray[np.bool_]


def evidence(table: PassageTable, policy: Policy) -> _Float:
    """Return the evidence for a human, per decision; -inf where nothing can alarm."""
    quiet = table.fused_quiet if policy == "fused" else table.p_pet + table.p_other
    counts = table.is_open & np.isfinite(quiet)
    q = np.clip(np.where(counts, quiet, 1.0), _TINY, 1 - np.finfo(float).eps / 2)
    score = np.where(counts, np.log1p(-q) - np.log(q), -np.inf)
    if policy == "window":
        return score
    is_last = np.append(table.passage[1:] != table.passage[:-1], True)[: len(score)]
    follows_open = np.append(table.is_open[1:], False)[: len(score)] & ~is_last
    undecided = table.is_pending & ~follows_open
    settled = np.where(table.is_pending & ~(undecided & is_last), -np.inf, score)
    # The alarm for a target that left undecided comes with the decision that misses it.
    moved = np.flatnonzero(undecided & ~is_last)
    settled[moved + 1] = np.maximum(settled[moved + 1], score[moved])
    return settled


def limit_evidence(pet_limit: float) -> float:
    """Return the least evidence that alarms at a pet limit."""
    return float(np.log1p(-pet_limit) - np.log(pet_limit))


@dataclass(frozen=True, slots=True, eq=False)
class Verdicts:
    """What a policy says about every passage."""

    # (n_passages,): from entering the swath to the first alarm at or after that; infinite
    # without one. From the start of the passage for bodies that never enter, and for none.
    alarm_s: _Float
    false_alarms: NDArray[np.int64]  # (n_passages,): minutes with an alarm

    @property
    def is_alarm(self) -> _Bool:
        """Whether there is an alarm at all after entering."""
        return np.isfinite(self.alarm_s)


def verdicts(table: PassageTable, is_alarm: _Bool) -> Verdicts:
    """Return the verdicts on passages from those on decisions, shape (n_decisions,)."""
    begins_s = np.nan_to_num(table.enters_s, nan=0.0)
    since_s = table.t_s - begins_s[table.passage]
    first_s = np.full(len(table), np.inf)
    hits = is_alarm & (since_s >= 0)
    np.minimum.at(first_s, table.passage[hits], since_s[hits])
    passage, _ = _minutes(table, is_alarm)
    return Verdicts(first_s, np.bincount(passage, minlength=len(table)).astype(np.int64))


def intrusions(table: PassageTable) -> _Bool:
    """Return which passages are people who were in the swath."""
    people: _Bool = table.label == "human"
    return people & np.isfinite(table.enters_s)


def hours(table: PassageTable, chosen: _Bool) -> float:
    """Return how long the chosen passages last together."""
    return float(table.duration_s[chosen].sum()) / 3600


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Misses and false alarms at every limit."""

    intrusion: _Float  # (n_intrusions,): most evidence of each after it entered, ascending
    # (n_minutes,): most evidence of each minute of the pets that has any, ascending
    pet_minute: _Float
    pet_hours: float  # how long the pets were there

    @classmethod
    def of(cls, table: PassageTable, score: _Float) -> "Sweep":
        """Return the sweep of the evidence of every decision."""
        entered = table.t_s >= np.nan_to_num(table.enters_s, nan=0.0)[table.passage]
        most = np.full(len(table), -np.inf)
        np.maximum.at(most, table.passage[entered], score[entered])
        chosen = score > -np.inf
        passage, minute = _minutes(table, chosen)
        peak = np.full(len(passage), -np.inf)
        np.maximum.at(peak, minute, score[chosen])
        pets = table.label == "pet"
        return cls(
            np.sort(most[intrusions(table)]), np.sort(peak[pets[passage]]), hours(table, pets)
        )

    def limit_for(self, false_alarms_per_hour: float) -> float:
        """Return the least evidence to ask for so that the pets stay within a budget."""
        # Of 60 h at one in 60 h one alarm is allowed; 1e-9 for hours summed in seconds.
        allowed = int(self.pet_hours * false_alarms_per_hour + 1e-9)
        if allowed >= len(self.pet_minute):
            return float(np.nextafter(-np.inf, 0.0))
        return float(np.nextafter(self.pet_minute[-1 - allowed], np.inf))

    def curve(self) -> tuple[_Float, _Float]:
        """Return false alarms per pet-hour, ascending, and the miss rate at each."""
        limits = np.append(np.unique(self.pet_minute)[::-1], np.nextafter(-np.inf, 0.0))
        # Just above each level, and below the last.
        limits[:-1] = np.nextafter(limits[:-1], np.inf)
        false = len(self.pet_minute) - np.searchsorted(self.pet_minute, limits)
        missed = np.searchsorted(self.intrusion, limits)
        return false / max(self.pet_hours, 1e-9), missed / max(len(self.intrusion), 1)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Misses and false alarms of a policy on people and pets."""

    # people who entered the swath; those without an alarm from then on
    n_intrusions: int
    n_missed: int
    miss_rate: Estimate
    # time to alarm from entering, over all intrusions: a missed one takes for ever
    median_s: Estimate
    p90_s: Estimate
    pet_hours: float  # how long the pets were there
    n_false_alarms: int  # minutes of theirs with an alarm
    false_alarms_per_hour: Estimate  # per pet-hour


def outcome(
    table: PassageTable, found: Verdicts, chosen: _Bool, rng: np.random.Generator
) -> Outcome:
    """Return how the chosen passages, shape (n_passages,), came out."""
    people = intrusions(table) & chosen
    pets = (table.label == "pet") & chosen
    n_missed = int((people & ~found.is_alarm).sum())
    n_false = int(found.false_alarms[pets].sum())
    pet_hours = hours(table, pets)
    taken_s = np.sort(found.alarm_s[people])
    return Outcome(
        n_intrusions=int(people.sum()),
        n_missed=n_missed,
        miss_rate=share(n_missed, int(people.sum())),
        median_s=quantile_s(taken_s, 0.5, rng),
        p90_s=quantile_s(taken_s, 0.9, rng),
        pet_hours=pet_hours,
        n_false_alarms=n_false,
        false_alarms_per_hour=per_hour(n_false, pet_hours),
    )


def quantile_s(taken_s: _Float, level: float, rng: np.random.Generator) -> Estimate:
    """Return the time within which so many have alarmed; `taken_s` ascends, NaN of nobody."""

    def quantile(weight: _Float) -> float:
        if len(taken_s) == 0:
            return float("nan")
        reached = np.cumsum(weight) >= level * weight.sum()
        return float(taken_s[int(reached.argmax())])

    return resampled(quantile, len(taken_s), rng)


def _minutes(table: PassageTable, chosen: _Bool) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the passage of every minute with a chosen decision, and the minute of each."""
    begins = np.minimum(table.first[:-1], max(len(table.t_s) - 1, 0))[table.passage[chosen]]
    minute = ((table.t_s[chosen] - table.t_s[begins]) // EPISODE_S).astype(np.int64)
    stride = int(minute.max(initial=0)) + 1
    keys, which = np.unique(table.passage[chosen] * stride + minute, return_inverse=True)
    return keys // stride, which


def levels(table: PassageTable, bundle: Bundle) -> Iterator[tuple[str, Verdicts]]:
    """Yield what every sensitivity makes of a bundle's own policy; false are alarms that began.

    The daemon's own panel turns verdicts into alarms, with the numbers of its default
    configuration; only who saw what is read from a table instead of a stream.
    """
    for name in SENSITIVITIES[bundle.policy]:
        section = AlarmSection.model_validate({"sensitivity": name})
        limit = pet_limit_of(Config(alarm=section), bundle)
        ruled = table if limit == bundle.pet_limit else rules(table, bundle, limit)
        yield name, _followed(ruled, alarm_policy(section, bundle.policy), limit)


def rules(table: PassageTable, bundle: Bundle, pet_limit: float) -> PassageTable:
    """Return the verdicts of policy 'fused' under another limit, on the evidence that was."""
    evidence = EvidenceSettings.from_mapping(bundle.evidence)
    verdict = Verdict(pet_limit, evidence, Config().decision.decide_within_s)
    is_alarm, is_pending = np.zeros((2, len(table.t_s)), bool)
    for k, passage in enumerate(table.passage):
        if k == 0 or passage != table.passage[k - 1]:
            verdict.reset()
        quiet = float(table.fused_quiet[k])
        if np.isnan(quiet):
            is_alarm[k] = verdict.leave()
            continue
        most = float(table.fused_most[k])
        fused = Probabilities(1 - quiet, most, quiet - most)
        label, is_alarm[k] = verdict.judge(fused, float(table.t_s[k]))
        is_pending[k] = label == "pending"
    return replace(table, is_alarm=is_alarm, is_pending=is_pending)


def _followed(table: PassageTable, policy: AlarmPolicy, pet_limit: float) -> Verdicts:
    """Return for every passage the time to alarm, and how many alarms began."""
    enters_s = np.nan_to_num(table.enters_s, nan=0.0)
    taken_s = np.full(len(table), np.inf)
    begun = np.zeros(len(table), np.int64)
    # Who is a hit and who is seen, as `sight_of` has it without zones; under policy 'window' the
    # daemon's fused value is that of the window.
    p_human = np.nan_to_num(1 - table.fused_quiet, nan=0.0)
    by_rule = np.isfinite(table.fused_quiet) & (p_human >= 1 - pet_limit - 1e-9)
    hit = table.is_alarm & (~by_rule | (p_human >= policy.p_on))
    seen = hit | table.is_alarm | table.is_pending | (p_human > policy.p_off)
    panel, at = AlarmPanel(policy), -1
    for k, passage in enumerate(table.passage):
        if passage != at:
            panel, at = AlarmPanel(policy), passage
        t_s = float(table.t_s[k])
        steps = panel.on_sight(t_s, Sight(bool(hit[k]), bool(seen[k])))
        begun[at] += sum(step.kind == "new" for step in steps)
        if panel.state == "alarm" and t_s >= enters_s[at]:
            taken_s[at] = min(taken_s[at], t_s - enters_s[at])
    return Verdicts(taken_s, begun)
