import dataclasses
from dataclasses import replace

import pytest

from radard.judge.classifier import Probabilities
from radard.judge.decision import invalid_decision, judge
from tests.radar_helpers import dwell_of, noise


@pytest.mark.parametrize(
    ("human", "pet", "other", "label", "alarm"),
    [
        (0.1, 0.9, 0.0, "pet", False),
        (0.2, 0.8, 0.0, "human", True),  # the limit must be exceeded
        (0.15, 0.05, 0.8, "other", False),
        (0.1, 0.5, 0.4, "pet", False),
        (0.1, 0.45, 0.45, "human", True),  # a bit of both: nothing that is known
        (0.34, 0.33, 0.33, "human", True),  # resembles nothing: counts as a human
        (0.4, 0.6, 0.0, "human", True),  # likely a pet, but not likely enough
        (1.0, 0.0, 0.0, "human", True),
        (0.0, 0.5, 0.5, "pet", False),
    ],
)
def test_the_rule(human, pet, other, label, alarm):
    assert judge(Probabilities(human, pet, other), 0.8) == (label, alarm)


def test_a_window_that_cannot_be_judged_says_nothing_but_why():
    dwell = dwell_of(noise(10))
    made = invalid_decision(dwell, "12 lost", seq=7)
    assert (made.seq, made.t_s) == (7, dwell.t_s)
    assert (made.gate, made.fault) == ("invalid", "12 lost")
    assert (made.reading, made.window, made.fused, made.label) == (None, None, None, "invalid")
    assert (made.alarm, made.frames, made.dropped) == (False, len(dwell.frames), 0)
    assert invalid_decision(replace(dwell, n_lost=4), "").frames == len(dwell.frames) - 4
    assert made.t_mono_s == dwell.t_mono_s
    assert invalid_decision(dwell, "").seq == 0
    fields = {f.name: f.default for f in dataclasses.fields(made)}
    assert (fields["tracks"], fields["fault"], fields["t_mono_s"]) == ((), "", 0.0)
