"""What installations know of windows, and what training hides of it."""

import numpy as np
import pytest
import torch

from radard.judge.installation import N_INSTALLATION
from x2train.sets.known import ADULT_DB, hidden_more, known_of

NEEDED = ("frame_rate_hz", "height_m", "tilt_deg", "echo_db", "level_db", "passage")


def windows(n=400, per_passage=4):
    rng = np.random.default_rng(1)
    made = {name: rng.uniform(1, 3, n) for name in NEEDED} | {"is_physical": np.ones(n, bool)}
    made["passage"] = np.arange(n) // per_passage
    for name in ("height_m", "tilt_deg", "level_db"):
        made[name] = np.repeat(made[name][::per_passage], per_passage)
    made["frame_rate_hz"] = np.full(n, 120.0)
    made["echo_db"] = made["level_db"] + ADULT_DB
    return made | {"label": np.zeros(n, np.int64)}


def test_a_passage_knows_the_same_all_along():
    made = windows()
    known = known_of(made)
    assert known.shape == (400, N_INSTALLATION)
    assert (known[:, 0] == 1).all()
    by_passage = known.reshape(100, 4, N_INSTALLATION)
    assert (by_passage == by_passage[:, :1]).all()
    for k in (1, 5):
        assert 0.4 < by_passage[:, 0, k].mean() < 0.8
    assert (known[:, 1] == known[:, 3]).all()  # a mount is known as a whole


def test_an_adult_is_as_strong_as_an_adult_to_two_decibels():
    known = known_of(windows())
    strength = known[known[:, 5] == 1, 6] * 10
    assert abs(strength.mean()) < 1
    assert strength.std() == pytest.approx(2.0, abs=0.6)


def test_fewer_know_the_level_where_size_says_nothing_of_the_echo():
    shares = [
        known_of(windows(4000) | {"is_physical": np.full(4000, is_physical)})[:, 5].mean()
        for is_physical in (True, False)
    ]
    assert shares == pytest.approx([0.6, 0.04], abs=0.02)


def test_an_echo_that_is_not_there_has_no_strength():
    made = windows()
    made["echo_db"] = np.full(400, np.nan)
    assert (known_of(made)[:, 5:] == 0).all()


def test_a_passage_draws_the_same_in_any_company():
    made = windows()
    some = {key: values[100:120] for key, values in made.items()}
    np.testing.assert_array_equal(known_of(made)[100:120], known_of(some))


def test_training_hides_value_and_mark_together_but_never_the_rate():
    rng = torch.Generator().manual_seed(0)
    hidden = hidden_more(torch.ones(4000, N_INSTALLATION), rng)
    assert (hidden[:, 0] == 1).all()
    for k in (1, 3, 5):
        assert torch.equal(hidden[:, k], hidden[:, k + 1])
        assert hidden[:, k].mean() == pytest.approx(0.85, abs=0.03)
