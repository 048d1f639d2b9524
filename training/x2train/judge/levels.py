"""Levels: what each of the daemon's sensitivities makes of the same passages.

The daemon's own panel turns verdicts into alarms, with the numbers of its default
configuration; only who saw what is read from a table instead of a stream.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.alarm.panel import AlarmPanel, AlarmPolicy, Sight
from radard.alarm.sensitivity import SENSITIVITIES, alarm_policy
from radard.config.config import Config
from radard.config.sections import AlarmSection
from radard.judge.bundle import Bundle, EvidenceSettings
from radard.judge.classifier import Probabilities
from radard.judge.decision import Verdict, pet_limit_of
from x2train.judge.estimates import Estimate, per_hour, share
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import hours, intrusions, quantile_s


@dataclass(frozen=True, slots=True)
class Level:
    """Misses, times to alarm and false alarms at one sensitivity."""

    name: str
    n_intrusions: int  # people who came in
    missed: Estimate  # share of them without an alarm from then on
    # time from coming in to the alarm for half and for 90 % of them, a missed one taking for
    # ever
    half_s: Estimate
    most_s: Estimate
    n_visits: int  # passages of pets
    visits_with_alarm: Estimate
    pet_hours: float  # how long they last together
    alarms_per_pet_hour: Estimate  # alarms that began, per hour of that


def levels(table: PassageTable, bundle: Bundle, rng: np.random.Generator) -> tuple[Level, ...]:
    """Return what every sensitivity makes of a bundle's own policy."""
    made = []
    for name in SENSITIVITIES[bundle.policy]:
        section = AlarmSection.model_validate({"sensitivity": name})
        limit = pet_limit_of(Config(alarm=section), bundle)
        ruled = Ruled(table.is_alarm, table.is_pending, limit)
        if limit != bundle.pet_limit:
            ruled = rules(table, bundle, limit)
        made.append(_level(table, name, alarm_policy(section, bundle.policy), ruled, rng))
    return tuple(made)


@dataclass(frozen=True, slots=True, eq=False)
class Ruled:
    """Verdicts on all decisions of a table."""

    is_alarm: NDArray[np.bool_]
    is_pending: NDArray[np.bool_]
    pet_limit: float


def rules(table: PassageTable, bundle: Bundle, pet_limit: float) -> Ruled:
    """Return the verdicts of policy 'fused' under another limit, on the evidence that was."""
    human_limit = EvidenceSettings.from_mapping(bundle.evidence).human_limit
    within_s = Config().decision.decide_within_s
    verdict = Verdict(pet_limit, human_limit, within_s)
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
    return Ruled(is_alarm, is_pending, pet_limit)


def _level(
    table: PassageTable, name: str, policy: AlarmPolicy, ruled: Ruled, rng: np.random.Generator
) -> Level:
    taken_s, begun = _followed(table, policy, ruled)
    people, pets = intrusions(table), table.label == "pet"
    n_people, n_pets = int(people.sum()), int(pets.sum())
    pet_hours = hours(table, pets)
    sorted_s = np.sort(taken_s[people])
    return Level(
        name,
        n_people,
        share(int(np.isinf(sorted_s).sum()), n_people),
        quantile_s(sorted_s, 0.5, rng),
        quantile_s(sorted_s, 0.9, rng),
        n_pets,
        share(int((begun[pets] > 0).sum()), n_pets),
        pet_hours,
        per_hour(int(begun[pets].sum()), pet_hours),
    )


def _followed(
    table: PassageTable, policy: AlarmPolicy, ruled: Ruled
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return for every passage the time to alarm, and how many alarms began."""
    enters_s = np.nan_to_num(table.enters_s, nan=0.0)
    taken_s = np.full(len(table), np.inf)
    begun = np.zeros(len(table), np.int64)
    hit, seen = _sights(table, policy, ruled)
    panel, at = AlarmPanel(policy), -1
    for k, passage in enumerate(table.passage):
        if passage != at:
            panel, at = AlarmPanel(policy), passage
        t_s = float(table.t_s[k])
        steps = panel.on_sight(t_s, Sight(bool(hit[k]), bool(seen[k])))
        begun[at] += sum(step.kind == "new" for step in steps)
        if panel.state == "alarm" and t_s >= enters_s[at]:
            taken_s[at] = min(taken_s[at], t_s - enters_s[at])
    return taken_s, begun


def _sights(
    table: PassageTable, policy: AlarmPolicy, ruled: Ruled
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return who is a hit and who is seen, as `sight_of` has it without zones."""
    # Under policy 'window' the daemon's fused value is that of the window.
    p_human = np.nan_to_num(1 - table.fused_quiet, nan=0.0)
    by_rule = np.isfinite(table.fused_quiet) & (p_human >= 1 - ruled.pet_limit - 1e-9)
    hit = ruled.is_alarm & (~by_rule | (p_human >= policy.p_on))
    return hit, hit | ruled.is_alarm | ruled.is_pending | (p_human > policy.p_off)
