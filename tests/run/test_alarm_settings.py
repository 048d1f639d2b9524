"""Sensitivities, what they do to rates, quiet hours, and `radard explain`."""

import itertools
from datetime import UTC, datetime, timedelta

import pytest

from radard.alarm.panel import AlarmPanel, AlarmPolicy, Sight
from radard.alarm.sensitivity import alarm_policy, sensitivity_choices
from radard.cli import main
from radard.commands.explain import alarm_probability
from radard.config import quiet_hours
from radard.config.quiet_hours import QuietHours, parse_quiet, recorded_clock, time_zone
from radard.config.sections import AlarmSection
from radard.judge.bundle import read_card


def section(**values):
    return AlarmSection.model_validate(values)


@pytest.mark.parametrize(
    ("given", "k", "n", "p_on", "p_off"),
    [
        ({}, 2, 3, 0.0, 0.1),
        ({"confirm_k": 3}, 3, 3, 0.0, 0.1),
        ({"confirm_n": 8}, 2, 8, 0.0, 0.1),
        ({"confirm_n": 1}, 1, 1, 0.0, 0.1),
        ({"confirm_k": 4, "confirm_n": 6}, 4, 6, 0.0, 0.1),
        ({"p_on": 0.7, "p_off": 0.3}, 2, 3, 0.7, 0.3),
        ({"p_on": 0.05}, 2, 3, 0.05, 0.05),
    ],
)
def test_numbers_go_before_names(given, k, n, p_on, p_off):
    policy = alarm_policy(section(**given), "window")
    assert (policy.k, policy.n, policy.p_on, policy.p_off) == (k, n, p_on, p_off)


@pytest.mark.parametrize(("k", "n"), [(1, 1), (1, 4), (2, 3), (3, 5), (4, 4)])
@pytest.mark.parametrize("p", [0.0, 0.035, 0.5, 1.0])
def test_the_rate_of_k_of_n_is_that_of_the_panel(k, n, p):
    n_windows = 7
    total = 0.0
    for hits in itertools.product([0, 1], repeat=n_windows):
        panel = AlarmPanel(AlarmPolicy(k=k, n=n, latch_s=100))
        steps = [s for t, h in enumerate(hits) for s in panel.on_sight(t, Sight(bool(h), bool(h)))]
        if any(step.kind == "new" for step in steps):
            total += p ** sum(hits) * (1 - p) ** (n_windows - sum(hits))
    assert alarm_probability(p, k, n, n_windows) == pytest.approx(total, abs=1e-12)


def test_every_choice_of_sensitivity_says_what_it_costs():
    choices = sensitivity_choices(section(confirm_k=3), "fused", read_card("accurate"))
    chosen = [(c["name"], c["is_chosen"]) for c in choices]
    assert chosen == [("low", False), ("normal", True), ("high", False)]
    assert [(c["policy"]["k"], c["policy"]["n"]) for c in choices] == [(2, 3), (1, 1), (1, 1)]
    missed = [c["made"]["missed"][0] for c in choices]
    assert missed == sorted(missed, reverse=True)
    for choice in choices:
        made, costs = choice["made"], choice["costs"]
        assert f"Misses {100 * made['missed'][0]:.2g} % of people" in costs
        assert f"{100 * made['visits_with_alarm'][0]:.2g} % of pets' visits" in costs
    for other in sensitivity_choices(section(), "window", read_card("accurate")):
        assert (other["made"], "not known" in other["costs"]) == (None, True)


NIGHT = "22:00-06:30"


@pytest.mark.parametrize(
    ("text", "when", "is_in"),
    [
        (NIGHT, "2026-11-20T21:59:59", False),
        (NIGHT, "2026-11-20T22:00:00", True),
        (NIGHT, "2026-11-21T00:00:00", True),
        (NIGHT, "2026-11-21T06:29:59", True),
        (NIGHT, "2026-11-21T06:30:00", False),
        ("Mon-Fri 08:00-17:00", "2026-11-20T12:00:00", True),  # a Friday
        ("Mon-Fri 08:00-17:00", "2026-11-21T12:00:00", False),
        ("Sat,Sun 00:00-24:00", "2026-11-21T23:59:59", True),
        ("Fri 22:00-02:00", "2026-11-21T01:00:00", True),  # began on Friday
        ("Sat 22:00-02:00", "2026-11-21T01:00:00", False),
        ("Sun 22:00-02:00", "2026-11-23T01:59:00", True),
        ("Sat-Mon 10:00-11:00", "2026-11-22T10:30:00", True),
        ("Sat-Mon 10:00-11:00", "2026-11-20T10:30:00", False),
    ],
)
def test_quiet_periods(text, when, is_in):
    moment = datetime.fromisoformat(when).replace(tzinfo=UTC)
    assert QuietHours([parse_quiet(text)], UTC, lambda _t_s: moment).holds(0.0) is is_in


@pytest.mark.parametrize(
    "text", ["", "22-06", "25:00-26:00", "22:60-23:00", "Xyz 10:00-11:00", "10:00-10:00", "x" * 99]
)
def test_what_is_no_quiet_period(text):
    with pytest.raises(ValueError, match="quiet period"):
        parse_quiet(text)


def test_a_replay_has_the_clock_of_its_recording_and_its_own_zone():
    clock = recorded_clock("2026-07-01T20:30:00.000Z")
    assert clock(3600.0) == datetime(2026, 7, 1, 21, 30, tzinfo=UTC)
    hours = QuietHours([parse_quiet(NIGHT)], time_zone("Europe/Oslo"), clock)
    assert not hours.holds(-1801.0)
    assert hours.holds(0.0)
    assert recorded_clock("2026-07-01T20:30:00")(0.0) == clock(0.0)
    assert recorded_clock("")(5.0) is None
    assert not QuietHours([parse_quiet("00:00-24:00")], None, recorded_clock("")).holds(1.0)
    assert datetime.now(UTC) - quiet_hours.wall_clock(0.0) < timedelta(minutes=1)
    assert not QuietHours([], None, clock).holds(1.0)
    with pytest.raises(ValueError, match="Nowhere/Town"):
        time_zone("Nowhere/Town")


def test_explain_prints_policy_delay_and_rates_and_follows_options(capsys):
    def told(*argv):
        assert main(["explain", *argv]) == 0
        return capsys.readouterr().out

    text = told("--model", "thesis")
    assert "2 of 3 verdicts make an alarm" in text
    (row,) = [line for line in text.splitlines() if line.startswith("> normal")]

    quiet = read_card("thesis").metrics["share without alarm, human"]
    apart = 1 - alarm_probability(1 - quiet, 2, 3, 5)
    assert f"{100 * apart:.2g} %, {100 * quiet:.2g} %" in row
    assert "human missed" in text
    assert "dog false alarm" in text
    text = told("--model", "thesis", "--sensitivity", "low", "--pass-time", "3")
    assert "> low" in text
    assert "p(human) 0.5 on" in text
    assert "no verdicts" in told("--model", "none")
    assert "made by: train-export evaluate --model accurate " in told()
    assert main(["explain", "--pass-time", "0"]) == 2
