"""Verdicts: misses, false alarms and times to alarm of passages made by hand."""

import math

import numpy as np
import pytest

from tests.report_helpers import drawn, passage, table_of
from x2train.judge.verdicts import (
    Sweep,
    evidence,
    limit_evidence,
    outcome,
    verdicts,
)

LIMIT = limit_evidence(0.8)


def outcome_of(table, is_alarm=None):
    found = verdicts(table, table.is_alarm if is_alarm is None else is_alarm)
    return outcome(table, found, np.ones(len(table), bool), np.random.default_rng(0))


def test_perfect():
    table = table_of(
        *(passage([0.9, 0.01, 0.01]) for _ in range(10)),
        *(passage([0.99] * 60, "pet") for _ in range(60)),
    )
    found = outcome_of(table)
    assert (found.n_intrusions, found.n_missed, found.miss_rate.value) == (10, 0, 0.0)
    assert (found.n_false_alarms, found.pet_hours) == (0, 1.0)
    assert found.false_alarms_per_hour.high == pytest.approx(3, rel=0.002)
    assert found.median_s.value == found.p90_s.value == 1.0


def test_quantiles_count_those_who_were_missed():
    late = [passage([0.9] * k + [0.1]) for k in range(8)]
    found = outcome_of(table_of(*late, passage([0.9]), passage([0.9])))
    assert found.median_s.value == 4.0
    assert found.p90_s.value == math.inf


def test_alarm_before_entering_does_not_count():
    early = passage([0.1, 0.9, 0.9], enters_s=2.5)
    both = passage([0.1, 0.9, 0.1], enters_s=2.5)
    found = verdicts(table_of(early, both), table_of(early, both).is_alarm)
    assert found.alarm_s.tolist() == [math.inf, 1.5]


def test_alarms_in_one_minute_are_one():
    quiet = np.full(130, 0.9)
    quiet[[0, 1, 59, 60, 129]] = 0.1
    found = outcome_of(table_of(passage(quiet, "pet")))
    assert found.n_false_alarms == 3


def test_evidence_is_that_of_the_limit():
    table = table_of(passage([0.8, 0.800001, 0.0, 1.0, 1e-12, 1e-6]))
    score = evidence(table, "fused")
    assert ((score >= LIMIT) == [True, False, True, False, True, True]).all()
    assert np.isfinite(score).all()
    assert score[4] - score[5] == pytest.approx(math.log(1e6))


def test_closed_gates_and_missing_probabilities_are_no_evidence():
    table = table_of(passage([0.1, np.nan, 0.1], is_open=[False, True, True]))
    assert np.isneginf(evidence(table, "fused")).tolist() == [True, True, False]
    assert np.isneginf(evidence(table, "window")).tolist() == [True, True, False]


@pytest.mark.parametrize(
    ("is_pending", "is_open", "alarms"),
    [
        # Decided at once; decided later; left with the last decision; left before it.
        ([0, 0, 0], [1, 1, 1], [True, True, True]),
        ([1, 1, 0], [1, 1, 1], [False, False, True]),
        ([1, 1, 1], [1, 1, 1], [False, False, True]),
        ([1, 1, 0], [1, 1, 0], [False, False, True]),
    ],
)
def test_pending_counts_only_as_the_last_word(is_pending, is_open, alarms):
    undecided = passage(
        [0.5] * 3, is_pending=np.array(is_pending, bool), is_open=np.array(is_open, bool)
    )
    # Another passage follows, whose gate is open: it must not be taken for the same target.
    table = table_of(undecided, passage([0.99]))
    assert (evidence(table, "fused") >= LIMIT)[:3].tolist() == alarms


def test_sweep_at_the_limit_is_the_daemons_verdict():
    table = drawn(300)
    swept = verdicts(table, evidence(table, "fused") >= LIMIT)
    shipped = verdicts(table, table.is_alarm)
    assert (swept.alarm_s == shipped.alarm_s).all()
    assert (swept.false_alarms == shipped.false_alarms).all()


@pytest.mark.parametrize("budget_h", [0.01, 0.1, 1.0, 60.0])
def test_limit_for_a_budget_keeps_it_and_no_tighter_than_needed(budget_h):
    table = drawn(400)
    score = evidence(table, "fused")
    sweep = Sweep.of(table, score)
    limit = sweep.limit_for(1 / budget_h)
    allowed = math.floor(sweep.pet_hours / budget_h)
    assert outcome_of(table, score >= limit).n_false_alarms <= allowed
    looser = score >= np.nextafter(limit, -np.inf)
    assert outcome_of(table, looser).n_false_alarms > allowed or np.isinf(np.abs(limit) * 2)


def test_one_alarm_in_exactly_the_hours_of_the_budget_is_allowed():
    pets = [passage([0.99] * 59 + [0.1 + 0.01 * k], "pet") for k in range(60)]
    sweep = Sweep.of(table_of(*pets), evidence(table_of(*pets), "fused"))
    assert sweep.pet_hours == 1.0
    assert (sweep.pet_minute >= sweep.limit_for(1.0)).sum() == 1
    assert (sweep.pet_minute >= sweep.limit_for(0.99)).sum() == 0
    assert (sweep.pet_minute >= sweep.limit_for(1e9)).sum() == 60


def test_curve_has_the_outcome_of_every_limit():
    table = drawn(300, skill=1.0)
    score = evidence(table, "fused")
    sweep = Sweep.of(table, score)
    false, missed = sweep.curve()
    assert (np.diff(false) >= 0).all()
    assert (np.diff(missed) <= 0).all()
    assert false[0] == 0
    for limit in (LIMIT, -3.0, 2.0):
        found = outcome_of(table, score >= limit)
        # The curve's point with as many false alarms misses no more: it asks for no more.
        at = np.searchsorted(false, found.false_alarms_per_hour.value + 1e-9) - 1
        assert missed[at] <= found.miss_rate.value


def test_empty_table():
    found = outcome_of(table_of())
    assert (found.n_intrusions, found.n_false_alarms, found.pet_hours) == (0, 0, 0.0)
    false, missed = Sweep.of(table_of(), np.empty(0)).curve()
    assert len(false) == len(missed) == 1
