from dataclasses import replace

import numpy as np
import pytest
import torch

from radard.errors import UsageError
from x2train.thesis import fit as thesis_fit
from x2train.thesis.fit import affine, fit, output_error, scaling_of
from x2train.thesis.sets import CellData

pytestmark = [pytest.mark.integration, pytest.mark.usefixtures("one_thread")]
SHORT = {"layers": (8, 4), "pretrain_epochs": (2, 2), "output_epochs": 2, "epochs": 12}
FEW = {"look_every": 4, "repeats": 3, "batch": 20}
QUICK = thesis_fit.FitSettings(**SHORT, **FEW, decay=0.01, averaging=0.9, learning_rate=0.01)


def data(n, seed=0, n_in=12):
    """Two classes that a line separates, noisily."""
    rng = np.random.default_rng(seed)
    y = np.arange(n) % 2
    x = rng.standard_normal((n, n_in)).astype(np.float32)
    x[:, 0] += 3 * (2 * y - 1)
    return CellData(x, y, np.ones(n, np.float32))


TRAIN, STOP = data(200), data(40, seed=1)


def result(settings, **kwargs):
    return fit(TRAIN, STOP, settings, **kwargs)


def same(one, other):
    np.testing.assert_array_equal(one.scores, other.scores)
    for key, value in one.net.state_dict().items():
        assert torch.equal(value, other.net.state_dict()[key])


def test_repeats_meet_nowhere():
    """Every version of the batched network is a network of its own."""
    net = thesis_fit.RepeatedMlp(3, (5, 4, 2), "relu", seed=1)
    x = torch.randn(7, 5)
    together = net(x)
    for k in range(3):
        h = torch.relu(x @ net.weights[0][k] + net.biases[0][k])
        torch.testing.assert_close(together[k], h @ net.weights[1][k] + net.biases[1][k])
    together[1].sum().backward()
    assert net.weights[0].grad is not None
    assert not net.weights[0].grad[[0, 2]].any()
    torch.testing.assert_close(
        affine(x, net.weights[0], net.biases[0])[2],
        affine(x.expand(3, 7, 5), net.weights[0], net.biases[0])[2],
    )


def test_errors_against_their_formulas():
    logits = torch.randn(2, 6, 2, dtype=torch.float64)
    y = torch.tensor([0, 1, 1, 0, 1, 0])
    p = torch.softmax(logits, -1)
    truth = torch.stack([p[k, range(6), y] for k in range(2)])
    entropy = -truth.log().mean(dim=1).sum().item()
    square = (1 - truth).square().mean(1).sum().item()
    assert output_error(logits, y, "cross-entropy") == pytest.approx(entropy)
    assert output_error(logits, y, "mse") == pytest.approx(square)
    one = logits[..., 1:] - logits[..., :1]
    assert output_error(one, y, "cross-entropy") == pytest.approx(entropy)


def test_scalings(monkeypatch):
    monkeypatch.setattr("x2train.thesis.fit._TYPE1", 6)
    x = np.random.default_rng(0).random((300, 10)).astype(np.float32) * 0.01
    x[:, 9] = 0.5  # never changes
    mean, scale = scaling_of(x, "none")
    assert not mean.any()
    assert (scale == 1).all()
    mean, scale = scaling_of(x, "each")
    z = (x - mean) * scale
    assert np.abs(z[:, :9].std(axis=0) - 1).max() < 1e-3
    assert not z[:, 9].any()
    mean, scale = scaling_of(x, "block")
    assert np.mean((x * scale)[:, :4] ** 2) == pytest.approx(1, rel=1e-5)
    assert np.mean((x * scale)[:, 4:] ** 2) == pytest.approx(1, rel=1e-5)
    assert np.unique(scale).size == 2
    for how in ("each", "block"):
        assert np.isfinite(scaling_of(np.zeros((4, 8), np.float32), how)[1]).all()


@pytest.mark.parametrize(
    "changes",
    [
        *({}, {"activation": "sigmoid", "learning_rate": 0.05}, {"activation": "tanh"}),
        *({"n_outputs": 1}, {"error": "mse"}, {"n_outputs": 1, "error": "mse"}),
        *({"optimiser": "momentum", "decay": 0.0}, {"optimiser": "lbfgs", "decay": 1e-3}),
        {"sparsity": 0.1},
        {"sparsity": 0.1, "activation": "sigmoid", "learning_rate": 0.05},
        {"layers": (6,), "pretrain_epochs": (2,)},
        *({"pretrain_epochs": (), "output_epochs": 0}, {"scaling": "each"}, {"averaging": 0.0}),
    ],
)
def test_every_switch_learns(changes):
    p = result(replace(QUICK, **changes)).predict(data(200, seed=2).x)
    assert p.shape == (3, 200, 2)
    np.testing.assert_allclose(p.sum(axis=2), 1)
    assert ((p.argmax(axis=2) == data(200).y).mean(axis=1) > 0.9).all()


def test_same_seed_same_result_and_the_best_look_is_kept():
    told = []
    same(result(QUICK, tell=lambda *now: told.append(now)), result(QUICK))
    stages = [(what.partition(",")[0], *far) for what, *far in told]
    assert stages == [("whole", epoch, 12) for epoch in (0, 4, 8, 12)]
    assert not np.array_equal(result(QUICK).scores, result(replace(QUICK, seed=1)).scores)
    fitted = result(replace(QUICK, pretrain_epochs=(), output_epochs=0))
    p = fitted.predict(STOP.x)
    score = -np.log(np.take_along_axis(p, STOP.y[None, :, None], 2)[..., 0]).mean(axis=1)
    np.testing.assert_allclose(score, fitted.scores[1:].min(axis=0), rtol=1e-5)
    assert (fitted.best_looks >= 1).all()
    truth = p[:, STOP.y == 1, 1].mean(axis=1)
    np.testing.assert_allclose(fitted.confidence[fitted.best_looks, range(3), 1], truth, rtol=1e-5)


def test_training_ends_when_no_repeat_gains():
    noise = data(60)
    noise = replace(noise, y=np.random.default_rng(0).integers(0, 2, 60))
    greedy = replace(QUICK, epochs=400, look_every=10, patience=2, learning_rate=0.05, decay=0.0)
    fitted = fit(noise, replace(STOP, y=STOP.y[::-1].copy()), greedy)
    assert len(fitted.scores) < 40
    assert (fitted.best_looks < len(fitted.scores) - 2).all()


def test_retraining_goes_on_from_what_was_learnt():
    first = result(QUICK)
    again = result(replace(QUICK, learning_rate=1e-4, epochs=4), start=first)
    assert len(again.scores) == 2
    p = first.predict(STOP.x)
    score = -np.log(np.take_along_axis(p, STOP.y[None, :, None], 2)[..., 0]).mean(axis=1)
    np.testing.assert_allclose(again.scores[0], score, rtol=1e-5)
    assert np.abs(again.scores[1] - again.scores[0]).max() < 0.05


WRONG = {"layers": (100, 0), "learning_rate": float("nan"), "momentum": 1.0, "decay": -1}
WRONG |= {"averaging": 1, "sparsity": -0.1}


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        *(({key: value}, key) for key, value in WRONG.items()),
        ({"pretrain_epochs": (500,)}, "none, or one a layer"),
        ({"pretrain_epochs": (5, -1)}, "none below 0"),
        ({"epochs": 50}, "at least look_every"),
        ({"patience": 0, "seed": -1}, "patience = 0.*seed = -1"),
        ({"batch": 0, "repeats": 0}, "batch = 0.*repeats = 0"),
    ],
)
def test_settings_that_make_no_sense_are_all_named_in_one_line(wrong, says):
    with pytest.raises(UsageError, match=says) as caught:
        thesis_fit.fit_settings("sigmoid", **wrong)
    assert "\n" not in str(caught.value)
