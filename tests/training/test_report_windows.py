"""Windows: AUC, accuracy, reliability and single features where they are known."""

import math

import numpy as np
import pytest

from tests.report_helpers import drawn, passage, table_of
from x2train.judge.windows import (
    Windows,
    balanced_accuracy,
    baselines,
    confusion,
    human_score,
    is_in_view,
    is_judged,
)


def windows_of(table):
    return Windows.of(table, is_judged(table) & is_in_view(table))


def figures_of(table):
    rng = np.random.default_rng(0)
    windows = windows_of(table)
    auc = windows.auc(human_score(table)[windows.row], rng)
    return auc, balanced_accuracy(table, windows, rng)


def test_perfect_windows():
    auc, accuracy = figures_of(table_of(passage([0.1] * 5), passage([0.9] * 5, "pet")))
    assert (auc.value, accuracy.value) == (1.0, 1.0)


def test_random_windows():
    auc, accuracy = figures_of(drawn(400, skill=0.0))
    assert auc.low < 0.5 < auc.high
    assert accuracy.low < 0.5 < accuracy.high
    assert auc.high - auc.low < 0.05


def test_balanced_accuracy_is_the_mean_of_both_classes():
    table = table_of(passage([0.1] * 30 + [0.9] * 10), passage([0.9] * 2, "pet"))
    assert balanced_accuracy(table, windows_of(table), np.random.default_rng(0)).value == (
        pytest.approx((29 / 39 + 1) / 2)  # the first window's middle is before it enters
    )


@pytest.mark.parametrize("label", ["human", "pet"])
def test_one_class_alone_has_no_figures(label):
    auc, accuracy = figures_of(table_of(passage([0.5, 0.4], label, enters_s=0.5)))
    assert math.isnan(auc.value)
    assert math.isnan(accuracy.value)


def test_windows_count_while_their_middle_is_in_the_swath():
    table = table_of(passage([0.5] * 6, enters_s=3.0, leaves_s=5.0))
    # Dwells of 2 s that end at 2 to 7 s.
    assert is_in_view(table).tolist() == [False, False, True, True, True, False]


def test_windows_without_probabilities_are_left_out():
    bad = passage([np.nan] * 3 + [0.1] * 3, enters_s=0.5)
    table = table_of(bad, passage([0.9] * 3, "pet", enters_s=0.5))
    assert is_judged(table).sum() == 6
    auc, _ = figures_of(table)
    assert auc.value == 1.0


def test_confusion_counts_the_likeliest_class():
    other = passage([0.9, 0.9], "other", p_pet=np.zeros(2), p_other=np.full(2, 0.9))
    found = confusion(table_of(passage([0.1, 0.9]), passage([0.9], "pet"), other))
    assert found["human"] == {"human": 1, "pet": 1, "other": 0}
    assert found["pet"] == {"human": 0, "pet": 1, "other": 0}
    assert found["other"] == {"human": 0, "pet": 0, "other": 2}
    assert found["empty"] == {"human": 0, "pet": 0, "other": 0}


def baselines_of(table):
    found = baselines(table, windows_of(table), np.random.default_rng(0))
    return {b.name: b for b in found}


def test_matched_set_has_features_near_chance():
    found = baselines_of(drawn(600))
    assert all(b.is_below for b in found.values())
    assert all(b.auc.value >= 0.5 for b in found.values())


def test_feature_that_is_lower_for_people_is_turned_round():
    table = table_of(
        *(passage([0.5] * 4, speed_mps=1.0 + 0.01 * k, enters_s=0.5) for k in range(5)),
        *(passage([0.5] * 4, "pet", speed_mps=2.0 + 0.01 * k, enters_s=0.5) for k in range(5)),
    )
    speed = baselines_of(table)["speed"]
    assert speed.auc.value == speed.auc.low == speed.auc.high == 1.0
    assert not speed.is_required


def test_feature_that_tells_without_a_direction_is_found_out():
    rng = np.random.default_rng(3)
    near_and_far = [(*rng.choice([0.6, 2.9], 1), "human") for _ in range(100)]
    between = [(1.7, "pet") for _ in range(100)]
    table = table_of(
        *(
            passage([0.5] * 4, label, target_range_m=r + 0.2 * rng.normal(size=4), enters_s=0.5)
            for r, label in near_and_far + between
        )
    )
    found = baselines_of(table)["range"]
    assert found.auc.value < 0.6
    assert found.auc_binned > 0.95
    assert not found.is_below


def test_feature_that_is_not_known_is_no_obstacle():
    found = baselines_of(table_of(passage([0.1] * 4), passage([0.9] * 4, "pet")))
    assert math.isnan(found["SNR"].auc.value)
    assert math.isnan(found["SNR"].auc_binned)
    assert found["SNR"].is_below
