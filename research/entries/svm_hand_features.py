"""A support vector machine on hand-made features: torso speed, limb envelope, cadence.

Source: Y. Kim and H. Ling, "Human activity classification based on micro-Doppler signatures
using a support vector machine", IEEE Trans. Geosci. Remote Sens. 47 (2009): their six features
of the spectrogram. The kernel is Gaussian, by random features (A. Rahimi and B. Recht, "Random
features for large-scale kernel machines", NIPS 2007), the loss the squared hinge.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmark_tasks import Elements

TITLE = "SVM on hand-made features"
USES_VECTOR = False
_OVER = 0.5
"""Of the map's depth of 30 dB: what is brighter belongs to the body."""
_N_RANDOM = 400
_COST = 1.0
"""Of the margin: and not tuned on any task."""


def hand_features(elements: Elements) -> NDArray[np.float64]:
    """Return the six features, shape (n, 6), in bins of Doppler and of cadence."""
    mu = elements.mu.astype(np.float64)
    n_doppler = mu.shape[1]
    rows = np.arange(n_doppler)
    torso = mu.argmax(axis=1)
    is_body = mu > _OVER
    has_body = is_body.any(axis=1)
    low = np.where(has_body, is_body.argmax(axis=1), torso)
    high = np.where(has_body, n_doppler - 1 - is_body[:, ::-1].argmax(axis=1), torso)
    width = high - low
    weight = mu / np.maximum(mu.sum(axis=1, keepdims=True), 1e-9)
    middle = (weight * rows[:, None]).sum(axis=1)
    spread = np.sqrt((weight * (rows[:, None] - middle[:, None]) ** 2).sum(axis=1))
    swing = (high - high.mean(axis=1, keepdims=True)) * np.hanning(high.shape[1])
    cadence = np.abs(np.fft.rfft(swing, axis=1))[:, 1:].argmax(axis=1) + 1
    return np.stack(
        [
            np.median(torso, axis=1),
            width.mean(axis=1),
            ((high + low) / 2 - torso).mean(axis=1),
            np.quantile(width, 0.1, axis=1),
            spread.mean(axis=1),
            cadence,
        ],
        axis=1,
    )


def scores(train: Elements, test: Elements, seed: int) -> NDArray[np.float64]:
    """Return the probability of a person for every element of `test`."""
    rng = np.random.default_rng(seed)
    x, x_test = hand_features(train), hand_features(test)
    mean, scale = x.mean(axis=0), x.std(axis=0) + 1e-9
    turn = rng.standard_normal((x.shape[1], _N_RANDOM)) / np.sqrt(x.shape[1])
    phase = rng.uniform(0, 2 * np.pi, _N_RANDOM)

    def mapped(values: NDArray[np.float64]) -> NDArray[np.float64]:
        made = np.cos((values - mean) / scale @ turn + phase) * np.sqrt(2 / _N_RANDOM)
        return np.concatenate([made, np.ones((len(values), 1))], axis=1)

    z, side = mapped(x), np.where(train.is_person, 1.0, -1.0)

    def loss(w: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        short = np.maximum(0.0, 1 - side * (z @ w))
        value = 0.5 * w @ w + _COST * (short**2).sum()
        return float(value), w - 2 * _COST * z.T @ (side * short)

    weights = minimize(loss, np.zeros(z.shape[1]), jac=True, method="L-BFGS-B").x
    return np.asarray(1 / (1 + np.exp(-2 * (mapped(x_test) @ weights))))
