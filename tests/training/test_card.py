"""The card: rates of an evaluation, entered into a bundle and told by `radard explain`."""

import json
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest

from radard.alarm.panel import AlarmPanel
from radard.alarm.sensitivity import SENSITIVITIES, alarm_policy
from radard.alarm.zones import sight_of
from radard.cli import main
from radard.commands.explain import explained
from radard.config.config import load_config
from radard.config.sections import AlarmSection, ZonesSection
from radard.judge.bundle import load_bundle, read_card
from tests.alarm_helpers import decision
from tests.report_helpers import drawn, drawn_passages, passage, table_of
from x2train.bundle.writing import evaluation_of, write_card
from x2train.judge.verdicts import intrusions, levels, outcome, rules, verdicts


@pytest.fixture(scope="module")
def table():
    missed = [passage([0.95, 0.6, 0.95, 0.9]) for _ in range(9)]
    gone = [passage([0.95] * 9) for _ in range(5)]
    return rules(table_of(*drawn_passages(300, skill=2.0), *missed, *gone), bundle(), 0.8)


@pytest.fixture
def own(tmp_path):
    models = resources.files("radard.models")
    for suffix in (".json", ".onnx", ".md"):
        (tmp_path / f"own{suffix}").write_bytes((models / f"balanced{suffix}").read_bytes())
    raw = json.loads((tmp_path / "own.json").read_text())
    raw.pop("evaluation", None)
    (tmp_path / "own.json").write_text(json.dumps(raw))
    return tmp_path / "own.onnx"


def bundle(decides="fused"):
    return replace(load_bundle("balanced"), policy=decides)


def of(table, decides="fused"):
    everything, rng = np.ones(len(table), bool), np.random.default_rng(0)
    return {
        name: (outcome(table, found, everything, rng), found)
        for name, found in levels(table, bundle(decides))
    }


def test_one_verdict_of_one_is_what_was_shipped(table):
    early = table.is_alarm & (table.t_s < np.nan_to_num(table.enters_s)[table.passage])
    # An alarm that is on already when somebody comes in is one for them as well.
    table = replace(table, is_alarm=table.is_alarm & ~early)
    found = verdicts(table, table.is_alarm)
    people, pets = intrusions(table), table.label == "pet"
    normal, verdict = of(table)["normal"]
    assert normal.n_intrusions == people.sum() > 50
    value, low, high = normal.miss_rate
    assert value == pytest.approx((people & ~found.is_alarm).sum() / people.sum())
    assert np.array_equal(verdict.false_alarms[pets] > 0, found.false_alarms[pets] > 0)
    assert 0 < value < 0.5
    assert low < value < high


def test_verdicts_under_another_limit_are_those_of_the_pipeline(table):
    # As the daemon does: undecided for up to 3 s, an alarm for whoever leaves undecided.
    assert table.is_pending.any()
    surer = rules(table, bundle(), 0.9)
    settled = ~table.is_pending & ~surer.is_pending & np.isfinite(table.fused_quiet)
    assert np.array_equal(table.is_alarm[settled], (table.fused_quiet <= 0.8)[settled])
    assert np.array_equal(surer.is_alarm[settled], (table.fused_quiet <= 0.9)[settled])
    # Like a pet and like a thing, and less than half like either: an alarm under any limit.
    mixed = rules(replace(table, fused_most=table.fused_quiet / 2), bundle(), 0.9)
    assert (mixed.is_alarm | mixed.is_pending)[table.fused_quiet < 1].all()


@pytest.mark.parametrize("decides", ["window", "fused"])
@pytest.mark.parametrize("name", ["low", "normal"])
def test_alarms_are_those_of_the_daemon_on_the_same_decisions(decides, name):
    table = drawn(60, seed=3, skill=2.0)
    policy = alarm_policy(AlarmSection(sensitivity=name), decides)
    begun = 0
    for k in range(len(table)):
        panel = AlarmPanel(policy)
        for row in np.flatnonzero(table.passage == k):
            sight = sight_of(decision_of(table, row), policy, ZonesSection(), 0.8)
            steps = panel.on_sight(float(table.t_s[row]), sight)
            begun += sum(s.kind == "new" for s in steps) * int(table.label[k] == "pet")
    level, _ = of(table, decides)[name]
    assert level.n_false_alarms == begun


def test_the_card_is_written_twice_and_read(own, table):
    made = evaluation_of(table, bundle(), "train-export evaluate --card")
    before = load_bundle(str(own))
    for _ in range(2):
        assert write_card(str(own), made) == own.with_suffix(".json")
    assert load_bundle(str(own)) == before
    text = own.with_suffix(".md").read_text()
    assert text.count("## As an alarm") == 1
    assert "| normal |" in text
    card = read_card(str(own))
    assert (card.policy, card.passages) == ("fused", 314)
    assert list(card.sensitivities) == list(SENSITIVITIES["fused"])
    normal = card.sensitivities["normal"]
    assert normal.missed[0] == pytest.approx(of(table)["normal"][0].miss_rate.value, rel=1e-3)
    assert card.metrics["parameters"] > 0


def test_explain_prints_the_rates_of_the_policy(own, table, capsys):
    write_card(str(own), evaluation_of(table, bundle(), "train-export evaluate --card"))
    assert main(["explain", "--model", str(own), "--sensitivity", "low"]) == 0
    text = capsys.readouterr().out
    (row,) = [line for line in text.splitlines() if line.startswith("> ")]
    assert row.split()[1] == "low"
    missed = of(table)["low"][0].miss_rate
    assert f"{100 * missed.value:.2g} % ({100 * missed.low:.2g} to" in row
    assert "made by: train-export evaluate --card" in text
    assert "are not known" not in text
    text = told(own, alarm={"confirm_k": 2})
    assert "alarm.confirm_k given: the rates then differ" in text
    text = told(own, decision={"pet_limit": 0.9, "decide_within_s": 2})
    assert "decision.pet_limit, decision.decide_within_s given" in text
    assert "gate.false_alarms_per_day given" in told(own, gate={"false_alarms_per_day": 4})
    # What counts is the threshold of the evaluation, where it is known.
    made = evaluation_of(table, bundle(), "x") | {"gate": {"false_alarms_per_day": 4.0}}
    write_card(str(own), made)
    assert "are not known" not in told(own, gate={"false_alarms_per_day": 4})
    assert "gate.false_alarms_per_day given" in told(own)
    assert "every window a draw of its own" in told(own, decision={"policy": "window"})


def told(model, **sections):
    options = {"model": {"name": str(model)}, **sections}
    return "\n".join(explained(load_config(environ={}, options=options), pass_s=5))


def test_a_garbled_evaluation_is_told(own, capsys):
    sidecar = own.with_suffix(".json")
    raw = json.loads(sidecar.read_text())
    for wrong in ({}, {"policy": "fused"}, [], {"sensitivities": {"low": {}}}):
        sidecar.write_text(json.dumps(raw | {"evaluation": wrong}))
        assert main(["explain", "--model", str(own)]) != 0
        assert ": evaluation" in capsys.readouterr().err


def decision_of(table, row):
    quiet = table.fused_quiet[row]
    human = None if np.isnan(quiet) else 1 - quiet
    label = "pending" if table.is_pending[row] else "human"
    alarm = bool(table.is_alarm[row])
    return decision(float(table.t_s[row]), human, alarm=alarm, range_m=1.0, label=label)
