from dataclasses import replace

import numpy as np
import pytest
import torch

from x2train.thesis.own import OwnSettings, predict_maps, train_maps

pytestmark = pytest.mark.integration

QUICK = OwnSettings(channels=(2, 4, 4), hidden=8, epochs=4, batch=20, learning_rate=0.01)


@pytest.fixture(autouse=True)
def one_thread():
    """Networks this small wait for their threads, and wait long on a busy machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def maps(n, seed=0):
    """Two kinds of pictures: people have a second line in the range-time map."""
    rng = np.random.default_rng(seed)
    y = np.arange(n) % 2
    made = {
        "mu": rng.random((n, 28, 40), np.float32),
        "range_time": 0.3 * rng.random((n, 56, 40), np.float32),
    }
    made["range_time"][:, 20:24] = 1
    made["range_time"][y == 1, 30:34] = 0.8
    return made, y


def test_learns_and_says_how_far_it_is():
    told = []
    net = train_maps(*maps(200), QUICK, told.append)
    assert told == [1, 2, 3, 4]
    fresh, y = maps(101, seed=1)
    p = predict_maps(net, fresh)
    assert p.shape == (101, 2)
    np.testing.assert_allclose(p.sum(axis=1), 1)
    assert (p.argmax(axis=1) == y).mean() > 0.95


def test_same_seed_same_network_and_torchs_generator_left_alone():
    before = torch.random.get_rng_state()
    one, again = (train_maps(*maps(60), QUICK, lambda _: None) for _ in range(2))
    assert torch.equal(before, torch.random.get_rng_state())
    other = train_maps(*maps(60), replace(QUICK, seed=1), lambda _: None)
    for a, b in zip(one.parameters(), again.parameters(), strict=True):
        assert torch.equal(a, b)
    assert not torch.equal(next(one.parameters()), next(other.parameters()))
