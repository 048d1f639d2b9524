"""Levels: what each of the daemon's sensitivities makes of the same passages.

The daemon's own panel turns verdicts into alarms, with the numbers of its default
configuration; only who saw what is read from a table instead of a stream.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from radard.alarm.panel import AlarmPanel, AlarmPolicy, Sight
from radard.alarm.sensitivity import SENSITIVITIES, alarm_policy
from radard.config.config import Config
from radard.config.sections import AlarmSection
from radard.judge.bundle import Bundle, EvidenceSettings
from radard.judge.classifier import Probabilities
from radard.judge.decision import Verdict, pet_limit_of
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import Verdicts


def levels(table: PassageTable, bundle: Bundle) -> Iterator[tuple[str, Verdicts]]:
    """Yield what every sensitivity makes of a bundle's own policy; false are alarms that began."""
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
    hit, seen = _sights(table, policy, pet_limit)
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


def _sights(
    table: PassageTable, policy: AlarmPolicy, pet_limit: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return who is a hit and who is seen, as `sight_of` has it without zones."""
    # Under policy 'window' the daemon's fused value is that of the window.
    p_human = np.nan_to_num(1 - table.fused_quiet, nan=0.0)
    by_rule = np.isfinite(table.fused_quiet) & (p_human >= 1 - pet_limit - 1e-9)
    hit = table.is_alarm & (~by_rule | (p_human >= policy.p_on))
    return hit, hit | table.is_alarm | table.is_pending | (p_human > policy.p_off)
