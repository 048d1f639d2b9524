import pytest

from radard.classify.classifier import Probabilities
from radard.classify.decision import judge


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
    ],
)
def test_the_rule(human, pet, other, label, alarm):
    assert judge(Probabilities(human, pet, other), 0.8) == (label, alarm)
