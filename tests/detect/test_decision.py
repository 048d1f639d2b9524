from dataclasses import replace

import pytest

from radard.config.config import Config
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Probabilities
from radard.judge.decision import (
    HIGH_PET_LIMIT,
    Decision,
    invalid_decision,
    judge,
    pet_limit_of,
    policy_of,
)
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


def config(given=None, policy=None, sensitivity="normal"):
    return Config(
        decision={"pet_limit": given, "policy": policy}, alarm={"sensitivity": sensitivity}
    )


@pytest.mark.parametrize("bundle", ["fast", "thesis", None])
def test_the_policy_is_the_one_given_else_the_bundles(bundle):
    made = load_bundle(bundle) if bundle else None
    own = made.policy if made else "window"
    assert policy_of(config(), made) == own
    for given in ("window", "fused"):
        assert policy_of(config(policy=given), made) == given


@pytest.mark.parametrize(
    ("given", "policy", "sensitivity", "limit"),
    [
        (None, "fused", "normal", 0.85),
        (None, "fused", "low", 0.85),
        (None, "fused", "high", HIGH_PET_LIMIT),
        (None, "window", "high", 0.85),
        (None, None, "high", HIGH_PET_LIMIT),
        (0.6, "fused", "high", 0.6),
        (0.95, None, "normal", 0.95),
    ],
)
def test_the_limit_is_the_one_given_else_the_bundles_and_more_at_high(
    given, policy, sensitivity, limit
):
    made = replace(load_bundle("fast"), pet_limit=0.85)
    assert pet_limit_of(config(given, policy, sensitivity), made) == limit
    higher = replace(made, pet_limit=0.97)
    assert pet_limit_of(config(None, "fused", "high"), higher) == 0.97
    assert pet_limit_of(config(), None) == 0.8
    assert pet_limit_of(config(None, "fused", "high"), None) == HIGH_PET_LIMIT


def test_a_window_that_cannot_be_judged_says_nothing_but_why():
    dwell = replace(dwell_of(noise(10)), n_lost=4, t_mono_s=3.0)
    says = {"gate": "invalid", "label": "invalid", "fault": "12 lost", "frames": 6, "dropped": 4}
    wanted = Decision(seq=7, t_s=dwell.t_s, t_mono_s=3.0, **says)
    assert invalid_decision(dwell, "12 lost", seq=7) == wanted
    assert not wanted.alarm
